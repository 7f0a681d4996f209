// A device that is unplugged and comes back while a servo runs.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <memory>
#include <thread>
#include <vector>

#include <palpate/device/servo_thread.h>
#include <palpate/device/watchdog.h>
#include "device/servo/reconnecting_device.h"
#include "device/simulated/packet_device.h"
#include "device/simulated/simulated_link.h"
#include "tests/device/helpers.h"
#include "tests/device/rig.h"

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

TEST(ReconnectingDevice, TenTimesInRealTimeWhileTheServoTicks) {
  const MonotonicClock clock;
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
  for (int round = 0; round < 10; ++round) {
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
  EXPECT_EQ(bench.device.times_back(), 10u);
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
  DeviceState read() noexcept override {
    DeviceState state;
    state.status = gone ? ReadStatus::kLost : ReadStatus::kFresh;
    return state;
  }
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
  explicit SlowBench(const VirtualClock& clock)
      : device(inner), plane(0.5), servo(plane, {}, device, clock, geometry::RigidTransform{}) {}
  SlowDevice inner;
  ReconnectingDevice device;
  SpringPlane plane;
  Servo servo;
};

TEST(ReconnectingDevice, OpenedForItsLimitsFirstItIsNotOpenedTwice) {
  VirtualClock clock;
  SlowBench bench(clock);
  ASSERT_TRUE(bench.device.open());
  EXPECT_EQ(bench.device.limits().force_max_n, 3.3);
  ASSERT_TRUE(bench.servo.start());
  EXPECT_EQ(bench.inner.opened, 1);
  clock.advance(1e-3);
  (void)bench.servo.tick();
  bench.servo.stop();
  EXPECT_EQ(bench.inner.closed, 1);
}

TEST(ReconnectingDevice, TheTickInWhichItIsGoneStillSendsAndLaterOnesDoNot) {
  VirtualClock clock;
  SlowBench bench(clock);
  ASSERT_TRUE(bench.servo.start());
  for (int i = 0; i < 3; ++i) {
    clock.advance(1e-3);
    (void)bench.servo.tick();
  }
  const int before = bench.inner.sent;
  bench.inner.gone = true;
  for (int i = 0; i < 5; ++i) {
    clock.advance(1e-3);
    (void)bench.servo.tick();
  }
  EXPECT_EQ(bench.inner.sent, before + 1);
  EXPECT_TRUE(bench.device.lost());
}

TEST(ReconnectingDevice, AnotherDeviceThatComesBackIsRefused) {
  VirtualClock clock;
  SlowBench bench(clock);
  ASSERT_TRUE(bench.servo.start());
  bench.inner.gone = true;
  clock.advance(1e-3);
  (void)bench.servo.tick();
  bench.inner.gone = false;
  bench.inner.said.force_max_n = 12.0;
  EXPECT_TRUE(refused(bench.device.reopen(), "other limits"));
  EXPECT_TRUE(bench.device.lost());
  EXPECT_EQ(bench.device.limits().force_max_n, 3.3);
  bench.inner.said.force_max_n = 3.3;
  EXPECT_TRUE(bench.device.reopen());
  EXPECT_TRUE(bench.device.here());
}

TEST(ReconnectingDevice, WhatEndsWhileItIsBeingOpenedIsClosedByWhoOpenedIt) {
  VirtualClock clock;
  SlowBench bench(clock);
  ASSERT_TRUE(bench.servo.start());
  bench.inner.gone = true;
  clock.advance(1e-3);
  (void)bench.servo.tick();
  bench.inner.gone = false;
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
  VirtualClock clock;
  SlowBench bench(clock);
  ASSERT_TRUE(bench.servo.start());
  std::atomic<bool> ending{false};
  std::thread cutter([&] {
    while (!ending) bench.device.cut_force();
  });
  while (bench.inner.cut == 0) std::this_thread::yield();
  for (int i = 0; i < 200; ++i) {
    bench.inner.gone = true;
    clock.advance(1e-3);
    (void)bench.servo.tick();
    bench.inner.gone = false;
    ASSERT_TRUE(bench.device.reopen());
    clock.advance(1e-3);
    EXPECT_EQ(bench.servo.tick().state.status, ReadStatus::kFresh);
  }
  ending = true;
  cutter.join();
  EXPECT_FALSE(bench.inner.cut_while_opening);
}

}  // namespace
}  // namespace palpate::device
