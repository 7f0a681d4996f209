// A device that is unplugged and comes back while a servo runs.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>
#include <utility>

#include <palpate/device/loop_histogram.h>
#include <palpate/device/servo_thread.h>
#include <palpate/device/watchdog.h>
#include "device/servo/reconnecting_device.h"
#include "device/simulated/packet_device.h"
#include "device/simulated/simulated_link.h"
#include "tests/device/helpers.h"
#include "tests/device/rig.h"
#include "toolkit/core/random.h"

namespace palpate::device {
namespace {

constexpr double kPressStiffness = 0.5;

/// A board that is unplugged at each of these times after each opening, with a hand that presses.
struct ReplugBench {
  explicit ReplugBench(const Clock& clock, std::vector<LinkFault> faults = {})
      : script(press_script()),
        link(board, script, clock, {}, std::move(faults)),
        inner(link, clock),
        device(inner),
        plane(kPressStiffness) {
    governed.soft_start_s = 0.05;
    governed.user_limit_n = 3.3;
  }
  [[nodiscard]] double held_n() const {
    return std::abs(PacketDeviceOptions{}.n_per_count * board.held()[2]);
  }
  HandScript script;
  SimulatedBoard board;
  SimulatedLink link;
  PacketDevice inner;
  ReconnectingDevice device;
  SpringPlane plane;
  GovernorOptions governed;
};

TEST(ReconnectingDevice, TenTimesInOneSessionOnAVirtualClock) {
  VirtualClock clock;
  // Each opening lasts 0.3 s.
  ReplugBench bench(clock, {LinkFault{LinkFault::Kind::kUnplugged, 0.3, 1.0}});
  Servo servo(bench.plane, bench.governed, bench.device, clock, geometry::RigidTransform{});
  ASSERT_TRUE(servo.start(Vec3(0.0, 0.0, 1.0)));
  constexpr int kTimes = 10;
  for (int round = 0; round <= kTimes; ++round) {
    // Until it is gone: force was there, and none after the fault.
    double most_n = 0.0;
    Tick tick;
    for (int i = 0; i < 1000 && !bench.device.lost(); ++i) {
      clock.advance(1e-3);
      tick = servo.tick();
      most_n = std::max(most_n, bench.held_n());
    }
    EXPECT_NEAR(most_n, 1.0, 0.05) << round;
    EXPECT_EQ(tick.fault, Fault::kLost);
    EXPECT_FALSE(bench.board.holds_force());
    if (round == kTimes) break;
    // Gone: ticks go on, and opening it fails while it is not there.
    EXPECT_FALSE(bench.device.reopen());
    for (int i = 0; i < 20; ++i) {
      clock.advance(1e-3);
      EXPECT_EQ(servo.tick().state.status, ReadStatus::kLost);
    }
    bench.board.plug();
    ASSERT_TRUE(bench.device.reopen());
    EXPECT_TRUE(bench.device.here());
    // Back, and pressed, and nobody has armed it.
    for (int i = 0; i < 100; ++i) {
      clock.advance(1e-3);
      tick = servo.tick();
      EXPECT_EQ(tick.fault, Fault::kLost) << "latched";
      EXPECT_FALSE(bench.board.holds_force());
    }
    EXPECT_EQ(tick.state.status, ReadStatus::kFresh);
    servo.rearm();
    // A soft start: no more than its share of the force in any tick.
    for (int i = 1; i <= 10; ++i) {
      clock.advance(1e-3);
      tick = servo.tick();
      EXPECT_EQ(tick.fault, Fault::kNone);
      EXPECT_LE(bench.held_n(), 1.0 * i * 1e-3 / bench.governed.soft_start_s + 0.01) << i;
    }
  }
  EXPECT_EQ(bench.device.times_back(), static_cast<std::uint64_t>(kTimes));
  servo.stop();
}

TEST(ReconnectingDevice, InRealTimeWhileTheServoTicks) {
  const MonotonicClock clock;
  constexpr int kRounds = 3;
  ReplugBench bench(clock);
  // What the machine does is no fault of it.
  bench.governed.late_zero_s = bench.governed.latch_late_s = bench.governed.silence_s = 60.0;
  bench.governed.jump_mm_per_s = 1e6;
  Servo servo(bench.plane, bench.governed, bench.device, clock, geometry::RigidTransform{});
  ServoThreadOptions options;
  options.free_mm = Vec3(0.0, 0.0, 1.0);
  auto thread = ServoThread::create(servo, clock, options).value();
  Heartbeat heart;
  servo.watched_by(&heart);
  Watchdog watchdog(bench.device, heart, {1.0, 1e-3});
  ASSERT_TRUE(watchdog.start());
  ASSERT_TRUE(thread->start());
  for (int round = 0; round < kRounds; ++round) {
    ASSERT_TRUE(comes([&] { return bench.held_n() > 0.5; })) << round;
    bench.board.unplug(clock.now_ns());
    ASSERT_TRUE(comes([&] { return bench.device.lost(); }));
    EXPECT_FALSE(bench.device.reopen()) << "it is not there";
    EXPECT_FALSE(bench.board.holds_force());
    bench.board.plug();
    ASSERT_TRUE(comes([&] { return bench.device.reopen().ok() && bench.device.here(); }));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_FALSE(bench.board.holds_force()) << "not armed";
    thread->request_rearm();
  }
  EXPECT_EQ(bench.device.times_back(), std::uint64_t{kRounds});
  thread->stop();
  watchdog.stop();
  servo.watched_by(nullptr);
  EXPECT_FALSE(bench.board.holds_force());
}

/// Opens when told to, counts, and has limits that can change.
class SlowDevice final : public Device {
 public:
  std::string name() const override { return "slow"; }
  Status open() override {
    opening = true;
    while (hold) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    opening = false;
    ++opened;
    return Done{};
  }
  void close() noexcept override { ++closed; }
  DeviceLimits limits() const noexcept override { return said; }
  DeviceState read() noexcept override { return {.status = gone ? ReadStatus::kLost : ReadStatus::kFresh}; }
  void send(GovernedForce) noexcept override { ++sent; }
  bool cut_force() noexcept override {
    if (opening) cut_while_opening = true;
    ++cut;
    return true;
  }
  DeviceLimits said{3.3, {Vec3::Constant(-100.0), Vec3::Constant(100.0)}, 0.01, 1000.0};
  std::atomic<bool> hold{false}, opening{false}, gone{false}, cut_while_opening{false};
  std::atomic<int> opened{0}, closed{0}, sent{0}, cut{0};
};

struct SlowBench {
  SlowBench() : device(inner), plane(0.5), servo(plane, {}, device, clock, geometry::RigidTransform{}) {}
  Tick tick() {
    clock.advance(1e-3);
    return servo.tick();
  }
  /// Gone in a tick, and there again to be opened.
  void lose() {
    inner.gone = true;
    (void)tick();
    inner.gone = false;
  }
  VirtualClock clock;
  SlowDevice inner;
  ReconnectingDevice device;
  SpringPlane plane;
  Servo servo;
};

TEST(ReconnectingDevice, OpenedForItsLimitsFirstItIsNotOpenedTwice) {
  SlowBench bench;
  ASSERT_TRUE(bench.device.open());
  EXPECT_EQ(bench.device.limits().force_max_n, 3.3);
  ASSERT_TRUE(bench.servo.start());
  EXPECT_EQ(bench.inner.opened, 1);
  (void)bench.tick();
  bench.servo.stop();
  EXPECT_EQ(bench.inner.closed, 1);
}

TEST(ReconnectingDevice, TheTickInWhichItIsGoneStillSendsAndLaterOnesDoNot) {
  SlowBench bench;
  ASSERT_TRUE(bench.servo.start());
  for (int i = 0; i < 3; ++i) (void)bench.tick();
  const int before = bench.inner.sent;
  bench.inner.gone = true;
  for (int i = 0; i < 5; ++i) (void)bench.tick();
  EXPECT_EQ(bench.inner.sent, before + 1);
  EXPECT_TRUE(bench.device.lost());
}

TEST(ReconnectingDevice, AnotherDeviceThatComesBackIsRefused) {
  SlowBench bench;
  ASSERT_TRUE(bench.servo.start());
  bench.lose();
  bench.inner.said.force_max_n = 12.0;
  EXPECT_TRUE(refused(bench.device.reopen(), "other limits"));
  EXPECT_TRUE(bench.device.lost());
  EXPECT_EQ(bench.device.limits().force_max_n, 3.3);
  bench.inner.said.force_max_n = 3.3;
  EXPECT_TRUE(bench.device.reopen());
  EXPECT_TRUE(bench.device.here());
}

TEST(ReconnectingDevice, WhatEndsWhileItIsBeingOpenedIsClosedByWhoOpenedIt) {
  SlowBench bench;
  ASSERT_TRUE(bench.servo.start());
  bench.lose();
  bench.inner.hold = true;
  const int closed_before = bench.inner.closed;
  std::thread other([&] { EXPECT_TRUE(bench.device.reopen()); });
  while (!bench.inner.opening) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_FALSE(bench.device.cut_force()) << "nobody else may touch it";
  bench.servo.stop();
  EXPECT_EQ(bench.inner.closed, closed_before + 1) << "before it was opened again, and not by the servo";
  bench.inner.hold = false;
  other.join();
  EXPECT_FALSE(bench.device.here());
  EXPECT_FALSE(bench.device.lost());
  EXPECT_EQ(bench.inner.closed, closed_before + 2);
  EXPECT_FALSE(bench.inner.cut_while_opening);
}

TEST(ReconnectingDevice, CuttingForceNeverMeetsAnOpening) {
  SlowBench bench;
  ASSERT_TRUE(bench.servo.start());
  std::atomic<bool> ending{false};
  std::thread cutter([&] {
    while (!ending) bench.device.cut_force();
  });
  while (bench.inner.cut == 0) std::this_thread::yield();
  for (int i = 0; i < 200; ++i) {
    bench.lose();
    ASSERT_TRUE(bench.device.reopen());
    EXPECT_EQ(bench.tick().state.status, ReadStatus::kFresh);
  }
  ending = true;
  cutter.join();
  EXPECT_FALSE(bench.inner.cut_while_opening);
}

// ---- Durations in bins against the durations themselves.

using Histogram = DurationHistogram;

std::int64_t nearest_rank_of(std::vector<std::int64_t> values, double share) {
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(values.size())));
  return values[std::max<std::size_t>(rank, 1) - 1];
}

TEST(DurationHistogram, BinsFollowEachOtherWithoutGapAndStayNarrow) {
  for (std::size_t bin = 0; bin + 1 < Histogram::kBins; ++bin) {
    const std::uint64_t top = Histogram::top_of(bin);
    ASSERT_EQ(Histogram::bin_of(top), bin);
    ASSERT_EQ(Histogram::bin_of(top + 1), bin + 1);
    const std::uint64_t least = bin == 0 ? 0 : Histogram::top_of(bin - 1) + 1;
    ASSERT_LE((top - least) * Histogram::kPerOctave, least) << "wider than the stated error";
  }
  EXPECT_EQ(Histogram::bin_of(~std::uint64_t{0}), Histogram::kBins - 1);
}

TEST(DurationHistogram, PercentilesAreThoseOfTheSortedSamplesWithinTheStatedError) {
  constexpr std::uint64_t kSeed = 7;
  SCOPED_TRACE(kSeed);
  Random random(kSeed);
  for (const double spread : {0.0, 0.3, 1.0, 3.0}) {
    Histogram histogram;
    std::vector<std::int64_t> samples;
    for (int i = 0; i < 20'001; ++i) {
      samples.push_back(static_cast<std::int64_t>(std::exp(std::log(5e4) + spread * random.normal())));
      histogram.count(samples.back());
    }
    const DurationStatistics all = histogram.statistics();
    for (const auto& [share, found] :
         {std::pair{0.5, all.p50_ns}, std::pair{0.99, all.p99_ns}, std::pair{0.999, all.p999_ns}}) {
      const std::int64_t truth = nearest_rank_of(samples, share);
      ASSERT_GE(found, truth) << share << " spread " << spread;
      ASSERT_LE(static_cast<double>(found - truth),
                static_cast<double>(truth) / static_cast<double>(Histogram::kPerOctave))
          << share << " spread " << spread;
    }
    EXPECT_EQ(all.count, samples.size());
    EXPECT_EQ(all.min_ns, *std::min_element(samples.begin(), samples.end()));
    EXPECT_EQ(all.max_ns, *std::max_element(samples.begin(), samples.end()));
    const std::int64_t sum = std::accumulate(samples.begin(), samples.end(), std::int64_t{0});
    EXPECT_DOUBLE_EQ(all.mean_ns, static_cast<double>(sum) / static_cast<double>(samples.size()));
  }
}

TEST(DurationHistogram, NothingNegativeAndTooLongAllHaveTheirPlace) {
  Histogram histogram;
  EXPECT_EQ(histogram.statistics().count, 0u);
  EXPECT_EQ(histogram.statistics().max_ns, 0);
  EXPECT_EQ(histogram.statistics().p50_ns, 0);
  histogram.count(-5);
  EXPECT_EQ(histogram.statistics().p50_ns, 0);
  constexpr std::int64_t kHourNs = 3'600'000'000'000;
  histogram.count(kHourNs);
  histogram.count(2 * kHourNs);
  const DurationStatistics all = histogram.statistics();
  EXPECT_EQ(all.count, 3u);
  EXPECT_EQ(all.min_ns, 0);
  EXPECT_EQ(all.max_ns, 2 * kHourNs);
  EXPECT_EQ(all.p999_ns, 2 * kHourNs) << "the last bin has no end: the largest is told";
}

TEST(DurationHistogram, AReaderBesideTheLoopSeesWholeNumbersThatFitEachOther) {
  constexpr std::uint64_t kCounts = 100'000;
  Histogram histogram;
  std::atomic<bool> done{false};
  std::uint64_t wrong = 0, back = 0, reads = 0, last = 0;
  std::thread reader([&] {
    while (!done.load() || reads == 0) {
      const DurationStatistics seen = histogram.statistics();
      ++reads;
      back += seen.count < last ? 1u : 0u;
      last = seen.count;
      if (seen.count == 0) continue;
      const bool fits = seen.count <= kCounts && seen.p50_ns <= seen.p99_ns && seen.p99_ns <= seen.p999_ns &&
                        seen.p999_ns <= seen.max_ns && seen.max_ns <= 1'000'000 && seen.min_ns <= seen.p50_ns;
      wrong += fits ? 0u : 1u;
    }
  });
  for (std::uint64_t i = 0; i < kCounts; ++i)
    histogram.count(static_cast<std::int64_t>(i * 7919 % 1'000'001));
  done.store(true);
  reader.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_EQ(back, 0u);
  EXPECT_EQ(histogram.statistics().count, kCounts);
}

TEST(DurationHistogram, StretchesForAPictureHoldEverythingOnce) {
  DurationHistogram histogram;
  EXPECT_TRUE(histogram.bins().empty());
  const std::vector<std::int64_t> counted = {0, 7, 8, 31, 32, 39, 40, 1000, 1'000'000, 123'456'789};
  for (const std::int64_t ns : counted) histogram.count(ns);
  const std::vector<DurationBin> bins = histogram.bins();
  std::uint64_t all = 0;
  for (std::size_t i = 0; i < bins.size(); ++i) {
    all += bins[i].count;
    if (i > 0) {
      EXPECT_EQ(bins[i].from_ns, bins[i - 1].to_ns + 1);
    }
    std::uint64_t within = 0;
    for (const std::int64_t ns : counted)
      if (ns >= bins[i].from_ns && ns <= bins[i].to_ns) ++within;
    EXPECT_EQ(bins[i].count, within) << bins[i].from_ns;
    EXPECT_LE(bins[i].to_ns + 1 - bins[i].from_ns, std::max<std::int64_t>(8, bins[i].from_ns / 4));
  }
  EXPECT_EQ(all, counted.size());
  EXPECT_EQ(bins.front().from_ns, 0);
  EXPECT_GT(bins.back().count, 0u);
}

}  // namespace
}  // namespace palpate::device
