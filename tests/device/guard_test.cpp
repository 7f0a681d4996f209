// The guard process and the end of a program, in child processes that die in every way. The board stands in
// memory that they share, and holds its torque for ever unless it is told.
#include <palpate/device/guard.h>

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <optional>
#include <string>
#include <thread>

#include <palpate/clock.h>
#include <palpate/stop_callback.h>
#include "device/simulated/packet_device.h"
#include "experiments/benchmarks/death_trial.h"
#include "tests/device/helpers.h"

namespace palpate::device {
namespace {

constexpr timespec kShort{0, 1'000'000};

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

#ifdef PALPATE_STD_THREADS
#define SKIP_UNDER_TSAN() GTEST_SKIP() << "ThreadSanitizer cannot be forked"
#else
#define SKIP_UNDER_TSAN() static_cast<void>(0)
#endif

TEST(Guard, WithoutOneTheTorqueIsHeldForEver) {
  SKIP_UNDER_TSAN();
  Child child({.guarded = false});
  child.send(SIGKILL);
  EXPECT_TRUE(WIFSIGNALED(child.status()));
  for (int i = 0; i < 100; ++i) ::nanosleep(&kShort, nullptr);
  EXPECT_TRUE(child.board().holds_force()) << "this is what the guard is for";
}

class EveryDeath : public testing::TestWithParam<int> {};

TEST_P(EveryDeath, IsFollowedByZero) {
  SKIP_UNDER_TSAN();
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
  SKIP_UNDER_TSAN();
  SharedBoard shared = SharedBoard::create().value();
  Packet command;
  command.kind = PacketKind::kCommand;
  command.counts = {0, 0, 900};
  Guard guard = Guard::start([&shared] {
                  shared.board().command(PacketDevice::zero_command(), 0);
                  return true;
                }).value();
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE}) ::kill(guard.pid(), number);
  for (int i = 0; i < 20; ++i) ::nanosleep(&kShort, nullptr);
  EXPECT_TRUE(guard.alive());
  EXPECT_NE(::getsid(guard.pid()), ::getsid(0)) << "not in the group that Ctrl-C reaches";
  shared.board().command(encoded(command), 0);
  guard.stop();
  EXPECT_FALSE(shared.board().holds_force()) << "a normal end, too";
  EXPECT_FALSE(guard.alive());
}

TEST(Guard, TriesAgainUntilTheDeviceIsFree) {
  SKIP_UNDER_TSAN();
  SharedBoard shared = SharedBoard::create().value();
  Packet command;
  command.kind = PacketKind::kCommand;
  command.counts = {0, 0, 900};
  shared.board().command(encoded(command), 0);
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
  SKIP_UNDER_TSAN();
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
  SKIP_UNDER_TSAN();
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
