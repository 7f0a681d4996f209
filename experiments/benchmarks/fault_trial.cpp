#include "experiments/benchmarks/fault_trial.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include <palpate/clock.h>
#include <palpate/device/servo.h>
#include <palpate/device/watchdog.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include "device/simulated/packet_device.h"
#include "device/simulated/simulated_link.h"
#include "toolkit/core/random.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::device {
namespace {

constexpr double kTrialSoftStartS = 0.05;  // ends before the fault
constexpr double kWrongAtS = 0.12;
constexpr double kAfterS = 0.15;  // exceeds every limit and the ramp after lateness
constexpr double kWallNPerMm = 0.5, kDepthMm = 2.0;
constexpr double kTrialNsPerS = 1e9;
constexpr double kLookS = 1e-3;  // the watchdog's period on virtual time

using Kind = LinkFault::Kind;

TrialFault on_link(const char* name, Kind kind, Fault expected) {
  return {name, TrialFault::Where::kLink, static_cast<int>(kind), 1.0, false, expected};
}
TrialFault short_on_link(const char* name, Kind kind, double lasts_s) {
  return {name, TrialFault::Where::kLink, static_cast<int>(kind), lasts_s, true, Fault::kNone};
}

/// Time source: a virtual clock that is advanced, or the real clock with waiting.
class TrialTime {
 public:
  explicit TrialTime(bool real) : real_(real) {}
  [[nodiscard]] const Clock& clock() const noexcept {
    return real_ ? static_cast<const Clock&>(machine_) : virtual_;
  }
  [[nodiscard]] double now_s() const noexcept { return clock().now_s(); }
  /// A watchdog's time on this clock.
  [[nodiscard]] double of_look(std::int64_t look_ns) const noexcept {
    return 1e-9 * static_cast<double>(real_ ? look_ns - machine_.start_ns() : look_ns);
  }
  /// Busy-waits until then.
  void spin_until(double t_s) {
    if (!real_) return wait_until(t_s);
    while (machine_.now_s() < t_s) {
    }
  }
  /// Waits until then; virtual time runs due watchdog checks meanwhile.
  void wait_until(double t_s) {
    if (real_) {
      const std::int64_t until_ns = machine_.start_ns() + std::llround(t_s * kTrialNsPerS);
      const auto per_s = static_cast<std::int64_t>(kTrialNsPerS);
      const timespec until{static_cast<time_t>(until_ns / per_s), static_cast<long>(until_ns % per_s)};
      ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
      return;
    }
    while (look && next_look_s_ <= t_s) {
      virtual_.advance_to(std::llround(next_look_s_ * kTrialNsPerS));
      next_look_s_ += kLookS;
      look(virtual_.now_ns());
    }
    virtual_.advance_to(std::llround(t_s * kTrialNsPerS));
  }
  std::function<void(std::int64_t)> look;  ///< the watchdog's, on virtual time

 private:
  bool real_;
  MonotonicClock machine_;
  VirtualClock virtual_;
  double next_look_s_ = 0.0;
};

/// A half space.
class PressedWall : public render::SceneFreeRenderer {
 public:
  render::Frame step(const Vec3& hip_mm, double) noexcept override {
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    frame.contact = hip_mm.z() < 0.0;
    if (frame.contact) frame.force_n.z() = -kWallNPerMm * hip_mm.z();
    return frame;
  }
  render::Description describe() const override { return {"wall", "", "", "constant", {}}; }
};

/// The same, failing on request.
class TrialWall final : public PressedWall {
 public:
  TrialWall(TrialTime& time, const TrialFault& fault, const double& wrong_s)
      : time_(time), fault_(fault), wrong_s_(wrong_s) {}
  render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    render::Frame frame = PressedWall::step(hip_mm, t_s);
    if (t_s < wrong_s_) return frame;
    if (fault_.where == TrialFault::Where::kRenderer)
      frame.force_n.setConstant(std::numeric_limits<double>::quiet_NaN());
    if (fault_.where == TrialFault::Where::kStuck) time_.spin_until(wrong_s_ + fault_.lasts_s);
    return frame;
  }

 private:
  TrialTime& time_;
  const TrialFault& fault_;
  const double& wrong_s_;
};

/// A hand that goes into the wall within so many seconds and stays.
HandScript press_within(double seconds) {
  return HandScript::create("press", {0.0, seconds}, {Vec3{0.0, 0.0, 1.0}, Vec3{0.0, 0.0, -kDepthMm}},
                            HandScript::Between::kMinimumJerk)
      .value();
}

double force_of(const SimulatedBoard& board, double n_per_count) noexcept {
  const SimulatedBoard::Counts counts = board.held();
  return n_per_count *
         Vec3{static_cast<double>(counts[0]), static_cast<double>(counts[1]), static_cast<double>(counts[2])}
             .norm();
}

std::vector<LinkFault> link_faults(const TrialFault& fault, double wrong_s) {
  if (fault.where != TrialFault::Where::kLink) return {};
  return {LinkFault{static_cast<Kind>(fault.kind), wrong_s, fault.lasts_s}};
}

/// A trial's parts in order of dependency.
struct Stand {
  Stand(const TrialFault& fault, const TrialOptions& options, double wrong_s_in)
      : wrong_s(wrong_s_in),
        period_s(1.0 / options.rate_hz),
        time(options.real_time),
        hand(press_within(kTrialSoftStartS)),
        link(board, hand, time.clock(),
             {options.rate_hz, device_options.mm_per_count, Packet::kHomed, options.seed},
             link_faults(fault, wrong_s)),
        device(link, time.clock(), device_options),
        wall(time, fault, wrong_s),
        servo(wall, governed(), device, time.clock(), {}),
        watchdog(device, heart) {}

  [[nodiscard]] GovernorOptions governed() const {
    GovernorOptions options;
    options.period_s = period_s;
    options.soft_start_s = kTrialSoftStartS;
    return options;
  }

  double wrong_s, period_s;
  double next_s = 0.0;  ///< next tick
  TrialTime time;
  HandScript hand;
  SimulatedBoard board;
  PacketDeviceOptions device_options;
  SimulatedLink link;
  PacketDevice device;
  TrialWall wall;
  Heartbeat heart;
  Servo servo;
  Watchdog watchdog;
};

/// Notes the first detection, by the servo in its tick or by the watchdog.
void note_detection(const Stand& stand, const Tick& tick, TrialOutcome& outcome) {
  if (tick.fault == Fault::kNone || outcome.fault != Fault::kNone) return;
  outcome.fault = tick.fault;
  const double seen_s =
      stand.watchdog.trips() > 0 ? stand.time.of_look(stand.watchdog.tripped_ns()) : stand.time.now_s();
  outcome.detected_ms = 1e3 * (seen_s - stand.wrong_s);
}

/// Runs ticks until `until_s`; skips those late by over a period.
void run_until(Stand& stand, double until_s, const TrialFault& fault, TrialOutcome& outcome) {
  while (stand.next_s < until_s) {
    stand.time.wait_until(stand.next_s);
    const double now_s = stand.time.now_s();
    if (fault.where == TrialFault::Where::kLate && now_s >= stand.wrong_s)
      stand.time.wait_until(stand.wrong_s + fault.lasts_s);  // happens once: later the time is past
    const bool detected = outcome.fault != Fault::kNone;
    const Tick tick = stand.servo.tick();
    if (detected && stand.board.holds_force()) ++outcome.frames_to_zero;
    note_detection(stand, tick, outcome);
    const double behind_s = std::max(0.0, stand.time.now_s() - stand.next_s - stand.period_s);
    stand.next_s += stand.period_s * (1.0 + std::ceil(behind_s / stand.period_s));
  }
}

}  // namespace

const std::vector<TrialFault>& trial_faults() {
  using Where = TrialFault::Where;
  static const std::vector<TrialFault> kAll = {
      on_link("silent", Kind::kSilent, Fault::kSilence),
      on_link("short packets", Kind::kShort, Fault::kGarbled),
      on_link("garbled packets", Kind::kGarbled, Fault::kGarbled),
      on_link("late packets, 30 ms", Kind::kLate, Fault::kSilence),
      on_link("lost packets, 999 of 1000", Kind::kLost, Fault::kSilence),
      on_link("duplicated packets", Kind::kDuplicated, Fault::kSilence),
      on_link("unplugged", Kind::kUnplugged, Fault::kLost),
      on_link("homing lost", Kind::kUnhomed, Fault::kHomingLost),
      on_link("position jumps by 60 mm", Kind::kJump, Fault::kJump),
      {"renderer answers NaN", Where::kRenderer, 0, 1.0, false, Fault::kNonFiniteForce},
      {"renderer stuck for 60 ms", Where::kStuck, 0, 0.060, false, Fault::kStalled},
      {"servo not run for 60 ms", Where::kLate, 0, 0.060, false, Fault::kStalled},
      short_on_link("silent for 10 ms", Kind::kSilent, 0.010),
      short_on_link("one packet garbled", Kind::kGarbled, 0.0),
      short_on_link("one packet short", Kind::kShort, 0.0),
      short_on_link("one packet again", Kind::kDuplicated, 0.0),
      {"servo not run for 8 ms", Where::kLate, 0, 0.008, true, Fault::kNone},
  };
  return kAll;
}

Result<TrialOutcome> run_trial(const TrialFault& fault_in, const TrialOptions& options) {
  Random random(options.seed);
  TrialFault fault = fault_in;
  const double period_s = 1.0 / options.rate_hz;
  if (fault.where == TrialFault::Where::kLink && fault.lasts_s == 0.0) fault.lasts_s = period_s;
  Stand stand(fault, options, kWrongAtS + period_s * random.uniform());
  TrialOutcome outcome;
  stand.servo.watched_by(&stand.heart);
  stand.next_s = stand.time.now_s();
  stand.wrong_s += stand.next_s;  // the link counts from here
  PALPATE_TRY(stand.servo.start());
  if (options.real_time) {
    PALPATE_TRY(stand.watchdog.start());
  } else {
    stand.time.look = [&stand](std::int64_t now_ns) { stand.watchdog.look(now_ns); };
  }
  run_until(stand, stand.wrong_s, fault, outcome);
  outcome.force_before_n = force_of(stand.board, stand.device_options.n_per_count);
  run_until(stand, stand.wrong_s + kAfterS, fault, outcome);
  outcome.force_at_end_n = force_of(stand.board, stand.device_options.n_per_count);
  if (!stand.board.holds_force()) {
    outcome.zero_ms = 1e-6 * static_cast<double>(stand.board.zeroed_ns()) - 1e3 * stand.wrong_s;
    outcome.zero_after_ms = std::max(0.0, outcome.zero_ms - outcome.detected_ms);
  }
  outcome.late_looks = stand.watchdog.late_looks();
  stand.watchdog.stop();
  return outcome;
}

namespace {

constexpr double kPressSoftStartS = 0.02;
constexpr double kPressedN = 0.5;  // of 1 N: the soft start has begun, so there is a force to release
// Beyond any delay of a busy machine: only the guard may end the loop.
constexpr double kPressPatienceS = 60.0, kPressJumpMmPerS = 1e6;
constexpr int kNoServo = 3;  // exit code of a child that failed to start
constexpr timespec kLookAgain{0, 50'000};

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
  const HandScript script = press_within(kPressSoftStartS);
  const auto zero = [&board, &clock, &script] {
    SimulatedLink fresh(board, script, clock);  // the guard's own handle
    return fresh.submit(PacketDevice::zero_command());
  };
  Heartbeat alone;
  std::optional<Guard> guard;
  if (options.guarded) {
    Result<Guard> started = Guard::start(zero, options.guard);
    if (!started) ::_exit(kNoServo);
    guard.emplace(std::move(started).value());
  }
  SimulatedLink link(board, script, clock, {.rate_hz = options.rate_hz});
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
