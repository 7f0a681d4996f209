// Heartbeat, watchdog, and every way in which a servo ends, in one process. In real time nothing is asserted
// but what no load can change.
#include <palpate/device/watchdog.h>

#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cctype>
#include <cmath>
#include <csignal>
#include <new>
#include <optional>

#include <palpate/clock.h>
#include <palpate/device/guard.h>
#include <palpate/device/scheduling.h>
#include <palpate/device/servo.h>
#include <palpate/progress.h>
#include "device/simulated/packet_device.h"
#include "device/simulated/simulated_link.h"
#include "experiments/benchmarks/fault_trial.h"
#include "tests/device/helpers.h"
#include "tests/device/rig.h"

namespace palpate::device {
namespace {

constexpr std::int64_t kMsNs = 1'000'000;

// What scheduling.h says to users is what is asked for.
static_assert(Watchdog::kPriority == kWatchdogPriority);

/// Counts what it is told to cut.
class CutDevice final : public Device {
 public:
  [[nodiscard]] std::string name() const override { return "cut"; }
  [[nodiscard]] Status open() override { return Done{}; }
  void close() noexcept override {}
  [[nodiscard]] DeviceLimits limits() const noexcept override { return {}; }
  [[nodiscard]] DeviceState read() noexcept override { return {}; }
  void send(GovernedForce) noexcept override {}
  bool cut_force() noexcept override { return ++cuts > 0; }
  std::atomic<int> cuts{0};
};

struct WatchRig {
  CutDevice device;
  Heartbeat heart;
  Watchdog watchdog{device, heart};
  std::int64_t now_ns = 0;
  void look(int times = 1) {
    for (int i = 0; i < times; ++i) watchdog.look(now_ns += kMsNs);
  }
};

TEST(Watchdog, NothingHappensWhileTheHeartBeatsOrNothingIsExpected) {
  WatchRig rig;
  rig.look(1000);  // before the first beat
  for (int i = 0; i < 1000; ++i) {
    rig.heart.beat();
    rig.look(9);
  }
  rig.heart.rest();
  rig.look(1000);
  EXPECT_EQ(rig.device.cuts, 0);
  EXPECT_FALSE(rig.heart.tripped());
}

TEST(Watchdog, StillForOverTenMillisecondsItCutsLatchesAndGoesOnCutting) {
  WatchRig rig;
  rig.heart.beat();
  rig.look(11);  // seen at 1 ms, still there at 11
  EXPECT_FALSE(rig.heart.tripped());
  rig.look();
  EXPECT_TRUE(rig.heart.tripped());
  EXPECT_EQ(rig.device.cuts, 1);
  EXPECT_EQ(rig.watchdog.tripped_ns(), 12 * kMsNs);
  rig.heart.beat();  // it came back, and may have been about to send
  rig.look(5);
  EXPECT_EQ(rig.device.cuts, 6);
  EXPECT_EQ(rig.watchdog.trips(), 1u);
  rig.heart.rearm();
  rig.heart.beat();
  rig.look(5);
  EXPECT_EQ(rig.device.cuts, 6) << "armed again by hand";
  rig.look(20);
  EXPECT_EQ(rig.watchdog.trips(), 2u);
}

TEST(Watchdog, LateItselfItCutsAtOnceButBlamesNobodyYet) {
  WatchRig rig;
  rig.heart.beat();
  rig.look(2);
  rig.now_ns += 30 * kMsNs;  // the machine stood still
  rig.look();
  EXPECT_EQ(rig.device.cuts, 1);
  EXPECT_FALSE(rig.heart.tripped());
  EXPECT_EQ(rig.watchdog.late_looks(), 1u);
  rig.look(12);
  EXPECT_TRUE(rig.heart.tripped()) << "the servo did not come back";
}

TEST(Watchdog, RefusesTimesThatWatchNothing) {
  CutDevice device;
  Heartbeat heart;
  for (const WatchdogOptions& wrong : {WatchdogOptions{0.01, 0.0}, WatchdogOptions{0.01, 0.005},
                                       WatchdogOptions{5.0, 0.001}, WatchdogOptions{std::nan(""), 0.001}}) {
    Watchdog watchdog(device, heart, wrong);
    EXPECT_FALSE(watchdog.start());
  }
}

TEST(WatchdogThread, CutsForALoopThatStandsStillAndEndsWhenTold) {
  CutDevice device;
  Heartbeat heart;
  Watchdog watchdog(device, heart);
  ASSERT_TRUE(watchdog.start());
  heart.beat();
  // It latches first and cuts next, and may be put off between the two: both are waited for.
  while (!heart.tripped() || device.cuts == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  watchdog.stop();
  const int cuts = device.cuts;
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_EQ(device.cuts, cuts);
  EXPECT_EQ(watchdog.trips(), 1u);
}

TEST(WatchdogThread, EndedWhileAServoRunsItCutsALastTime) {
  CutDevice device;
  Heartbeat heart;
  {
    Watchdog watchdog(device, heart, {0.5, 0.001});
    ASSERT_TRUE(watchdog.start());
    heart.beat();
  }
  EXPECT_GE(device.cuts, 1);
}

// ---- every end of a servo

/// A servo that presses on a board that outlives it.
struct Pressed {
  explicit Pressed(SimulatedBoard& pressed) : board(pressed) {
    servo.emplace(wall, quick(), device, clock, DeviceMap{});
    servo->watched_by(&heart);
    EXPECT_TRUE(servo->start().ok());
    for (int i = 0; i < 100; ++i) next();
    EXPECT_GT(board.held()[2], 900);
  }
  static GovernorOptions quick() { return {.soft_start_s = 0.02}; }
  void next() {
    clock.advance(1e-3);
    tick = servo->tick();
  }
  SimulatedBoard& board;
  VirtualClock clock;
  HandScript script = press_script();
  SimulatedLink link{board, script, clock};
  PacketDevice device{link, clock};
  SpringPlane wall{0.5};
  Heartbeat heart;
  std::optional<Servo> servo;
  Tick tick;
};

TEST(ServoEnds, StoppedItSendsZero) {
  SimulatedBoard board;
  Pressed rig(board);
  rig.servo->stop();
  EXPECT_FALSE(board.holds_force());
  EXPECT_FALSE(rig.heart.expected());
  rig.servo->stop();
  rig.servo->rearm();
  rig.next();
  EXPECT_FALSE(board.holds_force()) << "nothing comes after it";
}

TEST(ServoEnds, DestroyedOrLeftByAnExceptionItSendsZero) {
  SimulatedBoard board;
  {
    Pressed pressed(board);
    pressed.servo.reset();  // alone: its device, which would send zero too, is still there
    EXPECT_FALSE(board.holds_force());
  }
  try {
    const Pressed pressed(board);
    throw std::bad_alloc();
  } catch (const std::bad_alloc&) {
  }
  EXPECT_FALSE(board.holds_force());
}

TEST(ServoEnds, ADeviceWhoseLimitsAreNoneIsClosedAgain) {
  PacketDeviceOptions none;
  none.limits.force_max_n = 0.0;
  VirtualClock clock;
  SimulatedBoard board;
  const HandScript script = press_script();
  SimulatedLink link(board, script, clock);
  PacketDevice device(link, clock, none);
  SpringPlane wall(0.5);
  Servo servo(wall, {}, device, clock, {});
  EXPECT_TRUE(refused(servo.start(), "force limit"));
  EXPECT_EQ(device.read().status, ReadStatus::kLost) << "closed";
  EXPECT_EQ(servo.governor(), nullptr);
}

TEST(ServoEnds, ATrippedHeartIsObeyedInTheNextTickAndArmedByHand) {
  SimulatedBoard board;
  Pressed rig(board);
  rig.heart.trip();
  rig.next();
  EXPECT_FALSE(board.holds_force());
  EXPECT_EQ(rig.tick.fault, Fault::kStalled);
  for (int i = 0; i < 50; ++i) rig.next();
  EXPECT_FALSE(board.holds_force());
  rig.servo->rearm();
  EXPECT_FALSE(rig.heart.tripped());
  for (int i = 0; i < 50; ++i) rig.next();
  EXPECT_GT(board.held()[2], 900);
}

// ---- the whole chain on a virtual clock

class EveryTrial : public testing::TestWithParam<std::size_t> {};

TEST_P(EveryTrial, EndsWithoutForceWithinTwoFramesOfItsDetection) {
  const TrialFault& fault = trial_faults()[GetParam()];
  for (const double rate_hz : {1000.0, 4000.0}) {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      SCOPED_TRACE(testing::Message() << fault.name << ", " << rate_hz << " Hz, seed " << seed);
      const TrialOutcome outcome = run_trial(fault, {rate_hz, seed, false}).value();
      ASSERT_NEAR(outcome.force_before_n, 1.0, 1e-2) << "or nothing could be let go";
      if (fault.harmless) {
        ASSERT_EQ(outcome.fault, Fault::kNone) << fault_name(outcome.fault);
        ASSERT_NEAR(outcome.force_at_end_n, 1.0, 1e-2);
        continue;
      }
      ASSERT_EQ(outcome.fault, fault.expected) << fault_name(outcome.fault);
      ASSERT_EQ(outcome.force_at_end_n, 0.0);
      ASSERT_LE(outcome.frames_to_zero, 2);
      ASSERT_LE(outcome.zero_after_ms, 2e3 / rate_hz);
      // Silence takes 20 ms by definition, and a period to see it; the watchdog 10 ms and its looks.
      ASSERT_LE(outcome.detected_ms, 20.0 + 2e3 / rate_hz);
      ASSERT_LE(outcome.zero_ms, 20.0 + 4e3 / rate_hz);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Faults, EveryTrial, testing::Range(std::size_t{0}, trial_faults().size()),
                         [](const auto& instance) {
                           std::string name = trial_faults()[instance.param].name;
                           for (char& c : name)
                             if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
                           return name;
                         });

// With the watchdog's thread beside the servo's, on the machine's clock: what must end does end, however busy
// the machine is.
TEST(TrialInRealTime, AStuckRendererEndsWithoutForce) {
  for (const TrialFault& fault : trial_faults()) {
    if (fault.where != TrialFault::Where::kStuck && fault.where != TrialFault::Where::kRenderer) continue;
    const TrialOutcome outcome = run_trial(fault, {1000.0, 1, true}).value();
    EXPECT_NE(outcome.fault, Fault::kNone) << fault.name;
    EXPECT_EQ(outcome.force_at_end_n, 0.0) << fault.name;
  }
}

// ---- The guard process and the end of a program, in child processes that die in every way. The board stands
// in memory that they share, and holds its torque for ever unless it is told.

constexpr timespec kShort{0, 1'000'000};

/// A command of a force.
PacketBytes pressing() {
  return encoded(Packet{.kind = PacketKind::kCommand, .counts = {0, 0, 900}});
}

/// A child that presses; gone with this.
class Child {
 public:
  explicit Child(const PressOptions& options = {}) : shared_(SharedBoard::create().value()) {
    pid_ = ::fork();
    if (pid_ == 0) press_for_ever(board(), options);
    EXPECT_TRUE(comes([&] { return board().holds_force(); })) << "it presses";
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (!reaped_) {
      ::kill(pid_, SIGKILL);
      (void)status();
    }
  }
  void send(int number) const { ::kill(pid_, number); }
  int status() {
    int status = 0;
    if (!reaped_) ::waitpid(pid_, &status, 0);
    reaped_ = true;
    return status;
  }
  [[nodiscard]] SimulatedBoard& board() const { return shared_.board(); }

 private:
  SharedBoard shared_;
  pid_t pid_ = -1;
  bool reaped_ = false;
};

TEST(Guard, WithoutOneTheTorqueIsHeldForEver) {
  PALPATE_SKIP_FORKS();
  Child child({.guarded = false});
  child.send(SIGKILL);
  EXPECT_TRUE(WIFSIGNALED(child.status()));
  for (int i = 0; i < 100; ++i) ::nanosleep(&kShort, nullptr);
  EXPECT_TRUE(child.board().holds_force()) << "this is what the guard is for";
}

class EveryDeath : public testing::TestWithParam<int> {};

TEST_P(EveryDeath, IsFollowedByZero) {
  PALPATE_SKIP_FORKS();
  Child child;
  child.send(GetParam());
  (void)child.status();
  EXPECT_TRUE(comes([&] { return !child.board().holds_force(); })) << "signal " << GetParam();
}

INSTANTIATE_TEST_SUITE_P(Signals, EveryDeath,
                         testing::Values(SIGKILL, SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGINT, SIGTERM, SIGHUP,
                                         SIGXCPU),
                         [](const auto& instance) { return "signal_" + std::to_string(instance.param); });

TEST(Guard, SurvivesWhatIsSentToItAndStillAnswers) {
  PALPATE_SKIP_FORKS();
  SharedBoard shared = SharedBoard::create().value();
  Guard guard = Guard::start([&shared] {
                  shared.board().command(PacketDevice::zero_command(), 0);
                  return true;
                }).value();
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE}) ::kill(guard.pid(), number);
  for (int i = 0; i < 20; ++i) ::nanosleep(&kShort, nullptr);
  EXPECT_TRUE(guard.alive());
  EXPECT_NE(::getsid(guard.pid()), ::getsid(0)) << "not in the group that Ctrl-C reaches";
  shared.board().command(pressing(), 0);
  guard.stop();
  EXPECT_FALSE(shared.board().holds_force()) << "a normal end, too";
  EXPECT_FALSE(guard.alive());
}

TEST(Guard, TriesAgainUntilTheDeviceIsFree) {
  PALPATE_SKIP_FORKS();
  SharedBoard shared = SharedBoard::create().value();
  shared.board().command(pressing(), 0);
  int tries = 0;  // the guard's own copy counts
  Guard guard = Guard::start([&shared, tries]() mutable {
                  if (++tries < 5) return false;
                  shared.board().command(PacketDevice::zero_command(), 0);
                  return true;
                }).value();
  static_cast<void>(tries);
  guard.stop();
  EXPECT_FALSE(shared.board().holds_force());
}

TEST(Guard, AStoppedProgramIsKilledWhereThatIsAllowedAndLeftWhereNot) {
  PALPATE_SKIP_FORKS();
  {
    Child stopped({.guarded = true, .guard = {.kill_after_s = 0.5}});
    stopped.send(SIGSTOP);
    EXPECT_TRUE(comes([&] { return !stopped.board().holds_force(); }));
    EXPECT_EQ(WTERMSIG(stopped.status()), SIGKILL);
  }
  for (const GuardOptions& leaves : {GuardOptions{}, GuardOptions{.kill_after_s = 0.05, .debugger = true}}) {
    Child stopped({.guarded = true, .guard = leaves});
    stopped.send(SIGSTOP);
    for (int i = 0; i < 300; ++i) ::nanosleep(&kShort, nullptr);
    EXPECT_TRUE(stopped.board().holds_force()) << "as it must where killing is off";
    stopped.send(SIGKILL);
    EXPECT_TRUE(comes([&] { return !stopped.board().holds_force(); }));
  }
}

TEST(Guard, RefusesOptionsThatAreNotRight) {
  EXPECT_FALSE(Guard::start({}, {}));
  EXPECT_FALSE(Guard::start([] { return true; }, {.kill_after_s = -1.0}));
  EXPECT_FALSE(Guard::start([] { return true; }, {.kill_after_s = std::nan("")}));
}

// A stop of the program (Ctrl-C): its actions are run by a thread of their own while the servo goes on, and
// the process ends right after. No guard here.
TEST(ServoEnds, AStopOfTheProgramSendsZeroThatStays) {
  PALPATE_SKIP_FORKS();
  SharedBoard shared = SharedBoard::create().value();
  const pid_t child = ::fork();
  if (child == 0) {
    // The servo in a thread of its own, as in a program; the list belongs to this process.
    std::thread([&shared] { press_for_ever(shared.board(), {.guarded = false}); }).detach();
    if (!comes([&shared] { return shared.board().holds_force(); })) ::_exit(3);
    const std::string said = run_stop_callbacks();
    ::_exit(said.empty() ? 0 : 4);
  }
  int status = -1;
  ::waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
  EXPECT_FALSE(shared.board().holds_force());
}

}  // namespace
}  // namespace palpate::device
