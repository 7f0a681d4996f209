#include "experiments/benchmarks/death_trial.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <csignal>
#include <optional>
#include <utility>

#include <palpate/clock.h>
#include <palpate/device/servo.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include "device/simulated/packet_device.h"
#include "device/simulated/simulated_link.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::device {
namespace {

constexpr double kPressWallNPerMm = 0.5, kPressDepthMm = 2.0;
constexpr double kPressSoftStartS = 0.02;
constexpr double kPressedN = 0.5;  // of 1 N: the soft start has begun, so there is a force to release
// Beyond any delay of a busy machine: only the guard may end the loop.
constexpr double kPressPatienceS = 60.0, kPressJumpMmPerS = 1e6;
constexpr int kNoServo = 3;  // exit code of a child that failed to start
constexpr timespec kLookAgain{0, 50'000};

class PressedWall final : public render::SceneFreeRenderer {
 public:
  render::Frame step(const Vec3& hip_mm, double) noexcept override {
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    frame.contact = hip_mm.z() < 0.0;
    if (frame.contact) frame.force_n.z() = -kPressWallNPerMm * hip_mm.z();
    return frame;
  }
  render::Description describe() const override { return {"wall", "", "", "constant", {}}; }
};

/// Waits for the condition; false on timeout.
template <class Condition>
bool comes_to_be(const Condition& condition, double patience_s) {
  const Stopwatch watch;
  while (!condition()) {
    if (watch.ms() > 1e3 * patience_s) return false;
    ::nanosleep(&kLookAgain, nullptr);
  }
  return true;
}

}  // namespace

void press_for_ever(SimulatedBoard& board, const PressOptions& options) {
  const rlimit none{0, 0};
  ::setrlimit(RLIMIT_CORE, &none);
  const MonotonicClock clock;
  Result<HandScript> script = HandScript::create("press", {0.0, kPressSoftStartS},
                                                 {Vec3{0.0, 0.0, 1.0}, Vec3{0.0, 0.0, -kPressDepthMm}},
                                                 HandScript::Between::kMinimumJerk);
  const auto zero = [&board, &clock, &script] {
    SimulatedLink fresh(board, *script, clock);  // the guard's own handle
    return fresh.submit(PacketDevice::zero_command());
  };
  Heartbeat alone;
  std::optional<Guard> guard;
  if (options.guarded) {
    Result<Guard> started = Guard::start(zero, options.guard);
    if (!started) ::_exit(kNoServo);
    guard.emplace(std::move(started).value());
  }
  SimulatedLink link(board, *script, clock, {.rate_hz = options.rate_hz});
  PacketDevice device(link, clock);
  PressedWall wall;
  GovernorOptions governed;
  governed.period_s = 1.0 / options.rate_hz;
  governed.soft_start_s = kPressSoftStartS;
  governed.late_zero_s = governed.latch_late_s = governed.silence_s = kPressPatienceS;
  governed.jump_mm_per_s = kPressJumpMmPerS;
  Servo servo(wall, governed, device, clock, {});
  servo.watched_by(guard ? &guard->heartbeat() : &alone);
  if (!servo.start()) ::_exit(kNoServo);
  const timespec period{0, std::lround(1e9 / options.rate_hz)};
  for (;;) {
    static_cast<void>(servo.tick());
    ::nanosleep(&period, nullptr);
  }
}

Result<DeathOutcome> run_death(int signal, const PressOptions& options, double patience_s) {
  PALPATE_ASSIGN(const SharedBoard shared, SharedBoard::create());
  SimulatedBoard& board = shared.board();
  pid_t child = -1;
  {
    const auto hold = block_stop();
    child = ::fork();
    if (child == 0) {
      forget_stop_callbacks();
      press_for_ever(board, options);
    }
  }
  if (child < 0) return Error{"no process could be forked", "close other programs"};
  DeathOutcome outcome;
  const double n_per_count = PacketDeviceOptions{}.n_per_count;
  outcome.pressed = comes_to_be([&] { return n_per_count * board.held()[2] > kPressedN; }, patience_s);
  const Stopwatch watch;
  ::kill(child, signal);
  if (comes_to_be([&] { return !board.holds_force(); }, patience_s)) outcome.zero_ms = watch.ms();
  ::kill(child, SIGKILL);
  while (::waitpid(child, nullptr, 0) < 0 && errno == EINTR) {
  }
  // The guard holds a reference to the board and may still be working.
  if (options.guarded) static_cast<void>(comes_to_be([&] { return !board.holds_force(); }, patience_s));
  return outcome;
}

}  // namespace palpate::device
