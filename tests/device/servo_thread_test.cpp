// The loop on a virtual clock and on a thread of its own. No test here asserts how fast anything was.
#include <palpate/device/servo_thread.h>

#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cmath>
#include <optional>
#include <utility>

#include <palpate/device/scheduling.h>
#include <palpate/progress.h>
#include "device/simulated/simulated_arm.h"
#include "device/simulated/simulated_device.h"
#include "tests/device/helpers.h"
#include "tests/device/rig.h"
#include "toolkit/core/random.h"

#if defined(__SSE2__)
#include <immintrin.h>

#endif

namespace palpate::device {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

// ---- due times

TEST(DueTimes, AreThoseOfTheDefinitionAndTakeSkipsWholePeriods) {
  constexpr std::uint64_t kSeed = 3;
  SCOPED_TRACE(kSeed);
  Random random(kSeed);
  for (const std::int64_t rate : {500, 999, 1000, 3000, 4000, 7001, 8000}) {
    DueTimes due(rate);
    constexpr std::int64_t kBegin = 12'345;
    due.begin(kBegin);
    std::int64_t tick = 0;
    for (int i = 0; i < 5'000; ++i) {
      ASSERT_EQ(due.due_ns(), kBegin + tick * kSecond / rate) << rate << " Hz, tick " << tick;
      const double late_periods = random.uniform() < 0.8 ? random.uniform() : random.uniform(0.0, 40.0);
      const std::int64_t now = due.due_ns() + std::llround(late_periods * 1e9 / static_cast<double>(rate));
      std::int64_t last = tick;  // of all that are due by now
      while (kBegin + (last + 1) * kSecond / rate <= now) ++last;
      ASSERT_EQ(due.take(now), static_cast<std::uint64_t>(last - tick)) << rate << " Hz, tick " << tick;
      tick = last + 1;
    }
  }
}

TEST(DueTimes, DoNotDriftOrOverflowInAMonth) {
  DueTimes due(7001);
  due.begin(0);
  constexpr std::int64_t kMonth = std::int64_t{30} * 24 * 3600;
  EXPECT_EQ(due.take(kMonth * kSecond), static_cast<std::uint64_t>(kMonth * 7001));
  EXPECT_EQ(due.due_ns(), kMonth * kSecond + kSecond / 7001);
}

// ---- the loop

struct Seen final : TickObserver {
  explicit Seen(std::size_t room) { ticks.reserve(room); }
  void took(const Tick& tick) noexcept override {
    if (ticks.size() < ticks.capacity()) ticks.push_back(tick);
    if (stop_at > 0 && ticks.size() == stop_at) thread->request_stop();
  }
  std::vector<Tick> ticks;
  std::size_t stop_at = 0;
  ServoThread* thread = nullptr;
};

DeviceLimits sim_limits() {
  return {3.3, {Vec3::Constant(-80), Vec3::Constant(80)}, 0.055, 1000.0};
}

/// From 1 mm above the plane to 2 mm below it, and there.
trace::ProbePath pressing() {
  trace::ProbePath path;
  path.name = "press";
  for (int i = 0; i <= 400; ++i) {
    path.t_s.push_back(i * 1e-3);
    path.hip_mm.emplace_back(0.0, 0.0, std::max(-2.0, 1.0 - 0.03 * i));
  }
  return path;
}

/// A servo on any clock.
template <class SomeClock>
struct Bench {
  explicit Bench(std::int64_t rate_hz = 1000, trace::ProbePath played = pressing(),
                 std::vector<ScriptedFault> faults = {})
      : path(std::move(played)), device(path, clock, sim_limits(), 100'000, std::move(faults)), plane(0.5) {
    GovernorOptions governed{.period_s = 1.0 / static_cast<double>(rate_hz)};
    servo.emplace(plane, governed, device, clock, geometry::RigidTransform{});
  }
  /// The last thing that the device heard.
  [[nodiscard]] bool release_contact() const {
    return !device.is_open() && device.held_n() == Vec3::Zero() &&
           (device.sent().empty() || device.sent().back().force_n == Vec3::Zero());
  }

  SomeClock clock;
  trace::ProbePath path;
  SimulatedDevice device;
  SpringPlane plane;
  std::optional<Servo> servo;
};

TEST(ServoLoop, ATickLateBySeveralPeriodsIsOneTick) {
  Bench<VirtualClock> bench;
  Seen seen(100);
  const std::array<TickObserver*, 1> observers = {&seen};
  auto loop = ServoLoop::create(*bench.servo, bench.clock, 1000, observers).value();
  ASSERT_TRUE(bench.servo->start());
  loop->begin();
  const auto at = [&](std::int64_t t_us) {
    bench.clock.advance_to(t_us * 1000);
    return loop->tick();
  };
  EXPECT_TRUE(at(0).restarted);
  EXPECT_EQ(at(1'000).missed, 0u);
  EXPECT_EQ(at(2'999).missed, 0u) << "late by less than a period";
  EXPECT_EQ(loop->due().due_ns(), 3'000'000);
  EXPECT_EQ(at(3'000).missed, 0u);
  const Tick late = at(9'500);
  EXPECT_EQ(late.due_ns, 4'000'000);
  EXPECT_EQ(late.missed, 5u);
  EXPECT_EQ(loop->due().due_ns(), 10'000'000) << "no burst";
  EXPECT_EQ(at(10'000).missed, 0u);
  const LoopStatistics all = loop->histograms().statistics();
  EXPECT_EQ(all.ticks, 6u);
  EXPECT_EQ(all.missed, 5u);
  EXPECT_EQ(all.overruns, 0u);
  EXPECT_EQ(all.lateness.max_ns, 5'500'000);
  EXPECT_EQ(all.period.max_ns, 6'500'000);
  EXPECT_EQ(all.period.count, 4u) << "neither before the first tick nor over a restart";
  ASSERT_EQ(seen.ticks.size(), 6u);
  EXPECT_EQ(seen.ticks[4].missed, 5u);
}

TEST(ServoLoop, RearmsWhenAskedTo) {
  Bench<VirtualClock> bench;
  auto loop = ServoLoop::create(*bench.servo, bench.clock, 1000).value();
  ASSERT_TRUE(bench.servo->start());
  loop->begin();
  EXPECT_TRUE(loop->tick().rearmed) << "a start arms";
  bench.clock.advance_to(loop->due().due_ns());
  EXPECT_FALSE(loop->tick().rearmed);
  loop->request_rearm();
  bench.clock.advance_to(loop->due().due_ns());
  EXPECT_TRUE(loop->tick().rearmed);
  bench.clock.advance_to(loop->due().due_ns());
  EXPECT_FALSE(loop->tick().rearmed) << "asked once, done once";
}

TEST(ServoLoop, RefusesWhatItCannotRun) {
  Bench<VirtualClock> bench;
  for (const std::int64_t rate : {0, 499, 8001, -1000})
    EXPECT_TRUE(refused(ServoLoop::create(*bench.servo, bench.clock, rate), "500 to 8000"));
  const std::vector<TickObserver*> many(ServoLoop::kMaxObservers + 1, nullptr);
  EXPECT_FALSE(ServoLoop::create(*bench.servo, bench.clock, 1000, many));
}

/// The same plane under the same simulated hand, driven by both.
TEST(ServoLoop, AcceleratedItIsTheSameAsTheClosedLoop) {
  const ArmOptions arm = arm_models().front();
  const Hand hand = hand_models()[1];
  const HandScript script =
      HandScript::create("press", {0.0, 0.2, 0.5}, {Vec3{0, 0, 5}, Vec3{0, 0, 5}, Vec3{0, 0, -3}},
                         HandScript::Between::kStraight)
          .value();
  LoopOptions options;
  options.duration_s = 1.0;
  VirtualClock clock;
  SpringPlane plane(0.5);
  SimulatedArm plant(arm, hand, script, clock);
  const LoopRun expected = run_loop(plane, plant, clock, options).value();
  ASSERT_EQ(expected.fault, Fault::kNone);

  VirtualClock again_clock;
  SpringPlane again_plane(0.5);
  SimulatedArm again(arm, hand, script, again_clock);
  GovernorOptions governed;
  governed.user_limit_n = again.limits().force_max_n;
  governed.soft_start_s = options.soft_start_s;
  governed.jump_mm_per_s = 5000.0 + 2.0 * again.limits().resolution_mm / options.period_s;
  governed.edge_share = governed.fade_from_mm_per_s = 0.0;
  Servo servo(again_plane, governed, again, again_clock, {});
  Seen seen(expected.sent_n.size() + 10);
  const std::array<TickObserver*, 1> observers = {&seen};
  auto loop = ServoLoop::create(servo, again_clock, 1000, observers).value();
  ASSERT_TRUE(servo.start());
  EXPECT_EQ(run_accelerated(*loop, again_clock, kSecond, [] { return true; }), expected.sent_n.size());
  servo.stop();
  ASSERT_EQ(seen.ticks.size(), expected.sent_n.size());
  bool touched = false;
  for (std::size_t i = 0; i < seen.ticks.size(); ++i) {
    ASSERT_EQ(seen.ticks[i].sent_n, expected.sent_n[i]) << i;
    ASSERT_EQ(seen.ticks[i].state.position_mm, expected.measured.hip_mm[i]) << i;
    touched = touched || seen.ticks[i].sent_n != Vec3::Zero();
  }
  EXPECT_TRUE(touched);
  const LoopStatistics all = loop->histograms().statistics();
  EXPECT_EQ(all.ticks, expected.sent_n.size());
  EXPECT_EQ(all.missed, 0u);
  EXPECT_EQ(all.lateness.max_ns, 0);
  EXPECT_EQ(all.period.min_ns, 1'000'000);
  EXPECT_EQ(all.period.max_ns, 1'000'000);
}

// ---- the thread

void rest(int ms) {
  std::this_thread::sleep_for(std::chrono::milliseconds(ms));
}

class ServoThreadRates : public testing::TestWithParam<std::int64_t> {};

TEST_P(ServoThreadRates, EveryPeriodIsATickOrCountedAsMissed) {
  const std::int64_t rate = GetParam(), period = kSecond / rate;
  Bench<MonotonicClock> bench(rate);
  Seen seen(10'000), second(10'000);
  const std::array<TickObserver*, 2> observers = {&seen, &second};
  auto thread = ServoThread::create(*bench.servo, bench.clock, {rate, {}, {}, true}, observers).value();
  ASSERT_TRUE(thread->start());
  EXPECT_TRUE(thread->running());
  for (int i = 0; i < 30; ++i) {
    rest(10);
    const LoopStatistics live = thread->histograms().statistics();
    EXPECT_LE(live.lateness.p50_ns, live.lateness.max_ns);
  }
  thread->stop();
  EXPECT_FALSE(thread->running());
  EXPECT_TRUE(bench.release_contact());
  const std::vector<Tick>& ticks = seen.ticks;
  ASSERT_GT(ticks.size(), 2u);
  EXPECT_EQ(second.ticks.size(), ticks.size());
  std::uint64_t missed = ticks[0].missed;
  EXPECT_TRUE(ticks[0].restarted);
  for (std::size_t i = 1; i < ticks.size(); ++i) {
    ASSERT_GT(ticks[i].t_ns, ticks[i - 1].t_ns);
    ASSERT_GE(ticks[i].t_ns, ticks[i].due_ns + static_cast<std::int64_t>(ticks[i].missed) * period)
        << "early";
    missed += ticks[i].missed;
    if (i == 1) continue;  // the restart began the due times anew
    ASSERT_EQ(ticks[i].due_ns - ticks[i - 1].due_ns,
              static_cast<std::int64_t>(ticks[i - 1].missed + 1) * period)
        << i;
  }
  const LoopStatistics all = thread->histograms().statistics();
  EXPECT_EQ(all.ticks, ticks.size());
  EXPECT_EQ(all.missed, missed);
  EXPECT_EQ(all.exchange.count, all.ticks);
  EXPECT_LE(all.step.count, all.ticks - 1) << "the restart is no frame's time";
  EXPECT_GE(thread->steal_percent(), 0.0);
  EXPECT_FALSE(thread->mode().text().empty());
}

INSTANTIATE_TEST_SUITE_P(Hz, ServoThreadRates, testing::Values(1000, 4000),
                         [](const auto& instance) { return std::to_string(instance.param); });

TEST(ServoThread, StopsFromEveryState) {
  {
    SCOPED_TRACE("never started");
    Bench<MonotonicClock> bench;
    auto thread = ServoThread::create(*bench.servo, bench.clock, {}).value();
    thread->stop();
    EXPECT_FALSE(thread->running());
    EXPECT_TRUE(bench.release_contact());
  }
  {
    SCOPED_TRACE("stopped at once, twice, and not to be started again");
    Bench<MonotonicClock> bench;
    auto thread = ServoThread::create(*bench.servo, bench.clock, {}).value();
    ASSERT_TRUE(thread->start());
    EXPECT_FALSE(thread->start());
    thread->stop();
    EXPECT_TRUE(bench.release_contact());
    thread->stop();
    EXPECT_FALSE(thread->start());
    EXPECT_TRUE(bench.release_contact());
  }
  {
    SCOPED_TRACE("destroyed while it runs, in contact");
    Bench<MonotonicClock> bench;
    auto thread = ServoThread::create(*bench.servo, bench.clock, {}).value();
    ASSERT_TRUE(thread->start());
    rest(150);
    thread.reset();
    EXPECT_TRUE(bench.release_contact());
    EXPECT_GT(bench.device.sent().size(), 1u);
  }
  {
    SCOPED_TRACE("told to by an observer");
    Bench<MonotonicClock> bench;
    Seen seen(100);
    const std::array<TickObserver*, 1> observers = {&seen};
    auto thread = ServoThread::create(*bench.servo, bench.clock, {}, observers).value();
    seen.thread = thread.get();
    seen.stop_at = 7;
    ASSERT_TRUE(thread->start());
    while (thread->running()) rest(1);
    EXPECT_TRUE(bench.release_contact()) << "before anybody joined it";
    EXPECT_EQ(seen.ticks.size(), 7u);
    thread->stop();
  }
  {
    SCOPED_TRACE("a device that does not open");
    Bench<MonotonicClock> bench(1000, trace::ProbePath{});
    auto thread = ServoThread::create(*bench.servo, bench.clock, {}).value();
    EXPECT_FALSE(thread->start());
    EXPECT_FALSE(thread->running());
    EXPECT_TRUE(bench.release_contact());
    thread->stop();
  }
}

// Who never sleeps under SCHED_FIFO is stopped by the kernel, for 50 ms: a period is let go before that.
TEST(ServoThread, WorkThatLeavesTooLittleSleepCostsAPeriodNowAndThen) {
  constexpr std::int64_t kBusyNs = 950'000;  // of 1 ms
  constexpr std::size_t kTicks = 200;
  struct Burner final : TickObserver {
    void took(const Tick& tick) noexcept override {
      while (clock->now_ns() < tick.t_ns + kBusyNs) {
      }
      missed += tick.missed;
      if (++ticks == kTicks) thread->request_stop();
    }
    const Clock* clock = nullptr;
    ServoThread* thread = nullptr;
    std::size_t ticks = 0;
    std::uint64_t missed = 0;
  } burner;
  Bench<MonotonicClock> bench;
  const std::array<TickObserver*, 1> observers = {&burner};
  auto thread = ServoThread::create(*bench.servo, bench.clock, {}, observers).value();
  burner.clock = &bench.clock;
  burner.thread = thread.get();
  ASSERT_TRUE(thread->start());
  while (thread->running()) rest(1);
  thread->stop();
  EXPECT_EQ(burner.ticks, kTicks);
  // Of each period a twentieth is left to sleep and a tenth is owed: after twenty ticks at most one is let
  // go. Half of that is asked for; a loaded machine only adds to it.
  EXPECT_GE(burner.missed, kTicks / 40);
}

TEST(ServoThread, AfterAFaultItIsRearmedFromAnotherThread) {
  // Gone for a moment that is longer than any test machine stalls.
  Bench<MonotonicClock> bench(1000, pressing(), {{ScriptedFault::Kind::kLost, 0.02, 0.08, Vec3::Zero()}});
  struct Watch final : TickObserver {
    void took(const Tick& tick) noexcept override {
      if (tick.fault != Fault::kNone) faulted.store(true);
      if (faulted.load() && tick.rearmed && tick.fault == Fault::kNone) rearmed.store(true);
    }
    std::atomic<bool> faulted{false}, rearmed{false};
  } watch;
  const std::array<TickObserver*, 1> observers = {&watch};
  auto thread = ServoThread::create(*bench.servo, bench.clock, {}, observers).value();
  ASSERT_TRUE(thread->start());
  while (!watch.faulted.load()) rest(1);
  while (!watch.rearmed.load()) {
    thread->request_rearm();
    rest(5);
  }
  thread->stop();
  EXPECT_TRUE(bench.release_contact());
}

TEST(ServoThread, AProgramToldToStopTakesTheForceAwayFirst) {
  EXPECT_EXIT(
      {
        Bench<MonotonicClock> bench;
        auto thread = ServoThread::create(*bench.servo, bench.clock, {}).value();
        if (!thread->start()) ::_exit(2);
        rest(50);
        (void)run_stop_callbacks();
        // At once, as the command ends then; ThreadSanitizer would miss the joining of the thread.
        ::syscall(SYS_exit_group, bench.release_contact() && !thread->running() ? 0 : 1);
      },
      testing::ExitedWithCode(0), "");
}

// ---- What the kernel tells about itself, and that what is said to be obtained was obtained.

TEST(Scheduling, TheKindOfAKernelIsReadFromWhatItSays) {
  EXPECT_EQ(kernel_kind_of("1", "#1 SMP PREEMPT_DYNAMIC"), KernelKind::kRealTime);
  EXPECT_EQ(kernel_kind_of("", "#1 SMP PREEMPT_RT Debian 6.1.90-1"), KernelKind::kRealTime);
  EXPECT_EQ(kernel_kind_of("", "#1 SMP PREEMPT RT Wed"), KernelKind::kRealTime) << "before Linux 5.4";
  EXPECT_EQ(kernel_kind_of("0", "#1 SMP PREEMPT_DYNAMIC @0"), KernelKind::kDynamic);
  EXPECT_EQ(kernel_kind_of("", "#1 SMP PREEMPT Mon"), KernelKind::kPreempt);
  EXPECT_EQ(kernel_kind_of("", "#1 SMP Debian 5.10"), KernelKind::kVoluntary);
  EXPECT_EQ(kernel_kind_of("", ""), KernelKind::kUnknown);
}

TEST(Scheduling, StealIsTheEighthColumnOfTheCpuAskedFor) {
  const std::string stat =
      "cpu  10 20 30 40 50 60 70 80 5 6\ncpu0 1 2 3 4 5 6 7 8 0 0\ncpu1 0 0 0 0 0 0 0 1\nintr 5\n";
  const StealTimes all = steal_times_of(stat, -1), first = steal_times_of(stat, 0);
  EXPECT_EQ(all.steal, 80u);
  EXPECT_EQ(all.total, 360u) << "guest times are in user times already";
  EXPECT_EQ(first.steal, 8u);
  EXPECT_EQ(first.total, 36u);
  EXPECT_EQ(steal_times_of(stat, 1).steal, 1u);
  EXPECT_EQ(steal_times_of(stat, 2).total, 0u);
  EXPECT_EQ(steal_times_of("", -1).total, 0u);
  EXPECT_DOUBLE_EQ(steal_percent({80, 360}, {90, 380}), 50.0);
  EXPECT_DOUBLE_EQ(steal_percent({80, 360}, {80, 360}), 0.0);
  EXPECT_DOUBLE_EQ(steal_percent({80, 360}, {70, 380}), 0.0) << "counters of some kernels go back";
}

TEST(Scheduling, WhatIsSaidToBeObtainedIsWhatTheThreadHas) {
  SchedulingMode mode;
  int policy = -1, priority = -1, cpu = -1, slack_lines = 0;
  std::thread thread([&] {
    enter_real_time({}, mode);
    policy = ::sched_getscheduler(0) & ~SCHED_RESET_ON_FORK;
    sched_param found{};
    ::sched_getparam(0, &found);
    priority = found.sched_priority;
    cpu = ::sched_getcpu();
  });
  thread.join();
  EXPECT_EQ(mode.fifo, policy == SCHED_FIFO) << mode.text();
  EXPECT_EQ(mode.priority, priority);
  if (mode.pinned_cpu >= 0) {
    EXPECT_EQ(mode.pinned_cpu, cpu);
  }
  EXPECT_GE(mode.cpus, 1);
  EXPECT_FALSE(mode.kernel_release.empty());
  EXPECT_EQ(mode.fifo, mode.not_obtained.empty()) << "what was not obtained is said";
  for (const std::string& sentence : mode.not_obtained)
    slack_lines += sentence.find("--doctor") != std::string::npos ? 1 : 0;
  EXPECT_EQ(slack_lines, mode.fifo ? 0 : 1) << "with its remedy";
  EXPECT_TRUE(says(mode.text(), mode.fifo ? "SCHED_FIFO 80" : "SCHED_OTHER"));
}

TEST(Scheduling, WhatIsNotAskedForIsNotTaken) {
  SchedulingOptions none{0, false, false, false, -1};
  SchedulingMode mode;
  std::thread thread([&] {
    const ProcessRealTime process(none, mode);
    enter_real_time(none, mode);
    EXPECT_EQ(::sched_getscheduler(0), SCHED_OTHER);
  });
  thread.join();
  EXPECT_FALSE(mode.fifo);
  EXPECT_FALSE(mode.memory_locked);
  EXPECT_FALSE(mode.latency_held);
  EXPECT_EQ(mode.pinned_cpu, -1);
  EXPECT_TRUE(mode.not_obtained.empty());
  EXPECT_EQ(mode.timer_slack_ns, 1);
  EXPECT_TRUE(says(mode.text(), " on any CPU"));
}

#if defined(__SSE2__)
TEST(Scheduling, FloatingPointIsThatOfEveryReplayWhateverTheCallerHad) {
  constexpr unsigned kFlushToZero = 0x8000, kDenormalsAreZero = 0x0040, kRoundUp = 0x4000;
  SchedulingMode mode;
  std::thread thread([&] {
    _mm_setcsr(_mm_getcsr() | kFlushToZero | kDenormalsAreZero | kRoundUp);
    enter_real_time({0, false, false, false, -1}, mode);
    EXPECT_EQ(_mm_getcsr() & (kFlushToZero | kDenormalsAreZero | kRoundUp), 0u);
  });
  thread.join();
  EXPECT_FALSE(mode.denormals_flushed);
}
#endif

}  // namespace
}  // namespace palpate::device
