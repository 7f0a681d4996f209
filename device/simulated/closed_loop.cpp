#include "device/simulated/closed_loop.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <palpate/result.h>
#include "toolkit/control/coupling_and_passivity.h"
#include "toolkit/core/random.h"

namespace palpate::device {
namespace {

// Bounces of some centimetres last 0.1 s and vary: takes the largest within a second.
constexpr double kWindowS = 1.0;
constexpr double kApartS = 2.0;
// A swing that keeps this share over two seconds lasts ten seconds or more: a felt buzz. With 45 g, 0.3 N s/m
// and 1 kHz its stiffness is 3 % below that of a growing one.
constexpr double kKept = 0.8;
// A hand and device at 5 m/s are out of control.
constexpr double kJumpMmPerS = 5000.0;

struct Window {
  double amplitude_mm = 0.0, frequency_hz = 0.0;
};

/// The swing between two times about its own linear trend.
Window window_of(const trace::ProbePath& path, const Vec3& along, double from_s, double to_s) {
  const auto first =
      static_cast<std::size_t>(std::lower_bound(path.t_s.begin(), path.t_s.end(), from_s) - path.t_s.begin());
  const auto last =
      static_cast<std::size_t>(std::upper_bound(path.t_s.begin(), path.t_s.end(), to_s) - path.t_s.begin());
  Window window;
  if (last < first + 3) return window;
  const double n = static_cast<double>(last - first), middle_s = 0.5 * (from_s + to_s);
  const Vec3 origin = path.hip_mm[first];
  double mean = 0.0, tt = 0.0, tx = 0.0, mean_t = 0.0;
  for (std::size_t i = first; i < last; ++i) {
    mean += (path.hip_mm[i] - origin).dot(along) / n;
    mean_t += (path.t_s[i] - middle_s) / n;
  }
  for (std::size_t i = first; i < last; ++i) {
    const double t = path.t_s[i] - middle_s - mean_t;
    tt += t * t;
    tx += t * ((path.hip_mm[i] - origin).dot(along) - mean);
  }
  double low = 0.0, high = 0.0, before = 0.0;
  int crossings = 0;
  for (std::size_t i = first; i < last; ++i) {
    const double t = path.t_s[i] - middle_s - mean_t;
    const double x = (path.hip_mm[i] - origin).dot(along) - mean - tx / tt * t;
    low = std::min(low, x);
    high = std::max(high, x);
    if (before * x < 0.0) ++crossings;
    if (x != 0.0) before = x;
  }
  window.amplitude_mm = 0.5 * (high - low);
  window.frequency_hz = 0.5 * crossings / (path.t_s[last - 1] - path.t_s[first]);
  return window;
}

GovernorOptions governor_of(const LoopOptions& options, const DeviceLimits& limits) {
  GovernorOptions governed;
  governed.period_s = options.period_s;
  governed.user_limit_n = limits.force_max_n;
  governed.slew_n_per_s = options.slew_n_per_s;
  governed.soft_start_s = options.soft_start_s;
  // Encoder steps may exceed a period's motion.
  governed.jump_mm_per_s = kJumpMmPerS + 2.0 * limits.resolution_mm / options.period_s;
  // Swings are studied anywhere in the workspace and at any speed.
  governed.edge_share = governed.fade_from_mm_per_s = 0.0;
  return governed;
}

LoopRun room_for(std::size_t ticks) {
  LoopRun run;
  for (trace::ProbePath* path : {&run.hip, &run.measured}) {
    path->t_s.reserve(ticks);
    path->hip_mm.reserve(ticks);
  }
  run.felt.frames.reserve(ticks);
  run.sent_n.reserve(ticks);
  run.motor_force_n.reserve(ticks);
  return run;
}

/// Unchanged ticks after which simulation stops; `ticks` disables this.
std::size_t still_ticks(const LoopOptions& options, std::size_t ticks) {
  if (!(options.still_s > 0.0)) return ticks;
  return std::max(kMinStillTicks, static_cast<std::size_t>(std::ceil(options.still_s / options.period_s)));
}

/// Whether the last tick repeats the previous one bitwise, up to the sign of a zero.
bool repeats(const LoopRun& run) noexcept {
  const std::size_t n = run.hip.size();
  if (n < 2) return false;
  const render::Frame &now = run.felt.frames[n - 1], &before = run.felt.frames[n - 2];
  return now.contact == before.contact && now.model == before.model && now.status == before.status &&
         now.force_n == before.force_n && now.god_object_mm == before.god_object_mm &&
         run.hip.hip_mm[n - 1] == run.hip.hip_mm[n - 2] &&
         run.measured.hip_mm[n - 1] == run.measured.hip_mm[n - 2] && run.sent_n[n - 1] == run.sent_n[n - 2] &&
         run.motor_force_n[n - 1] == run.motor_force_n[n - 2];
}

/// Appends a copy of the last tick at another time.
void repeat_last(LoopRun& run, double t_s) {
  for (trace::ProbePath* path : {&run.hip, &run.measured}) {
    path->t_s.push_back(t_s);
    path->hip_mm.push_back(Vec3(path->hip_mm.back()));
  }
  run.felt.frames.push_back(render::Frame(run.felt.frames.back()));
  run.sent_n.push_back(Vec3(run.sent_n.back()));
  run.motor_force_n.push_back(Vec3(run.motor_force_n.back()));
}

constexpr double kStep = 1.1;    // factor of the upward search
constexpr double kRange = 1e6;   // covered by the search
constexpr double kExact = 1e-6;  // of the bisection
// Rounding of eigenvalues: a pole on the unit circle, as of a free device, counts as inside.
constexpr double kOnCircle = 1e-12;

/// One axis of the plant over dt: maps (x, v, motor) and the command to (x, v, motor).
Eigen::Matrix<double, 3, 4> over(const Plant& plant, double dt_s) {
  Eigen::Matrix<double, 3, 4> map;
  for (int c = 0; c < 4; ++c) {
    const Motion from{c == 0 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::Zero()),
                      c == 1 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::Zero()),
                      c == 2 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::Zero())};
    Drive drive;
    if (c == 3) drive.command_n = Vec3::UnitX();
    const Motion to = dt_s > 0.0 ? moved(plant, from, drive, dt_s) : from;
    map.col(c) << to.x_mm.x(), to.v_mm_s.x(), to.motor_n.x();
  }
  return map;
}

}  // namespace

Result<LoopRun> run_loop(render::HapticRenderer& renderer, SimulatedPlant& device, VirtualClock& clock,
                         const LoopOptions& options) {
  if (!(options.jitter_s >= 0.0 && options.jitter_s < options.period_s))
    return Error{"jitter_s is " + std::to_string(options.jitter_s), "give 0 or above, below the period",
                 device.name()};
  if (!std::isfinite(options.duration_s) || !(options.duration_s >= options.period_s))
    return Error{"duration_s is " + std::to_string(options.duration_s), "give a period or more",
                 device.name()};
  Servo servo(renderer, governor_of(options, device.limits()), device, clock, options.world_from_device);
  const auto ticks = static_cast<std::size_t>(std::floor(options.duration_s / options.period_s)) + 1;
  LoopRun run = room_for(ticks);
  run.hip.name = run.measured.name = "closed loop of " + device.name();
  PALPATE_TRY(servo.start());
  Random random(options.seed);
  // The motors hold their force until the next tick: exact without lag and delay.
  control::PassivityObserver observer(control::EnergyRule::kHold);
  const double motion_start_s = clock.now_s();
  const std::size_t enough = still_ticks(options, ticks);
  std::size_t still = 0;
  for (std::size_t i = 0; i < ticks; ++i) {
    const double late_s = options.jitter_s > 0.0 ? options.jitter_s * random.uniform() : 0.0;
    clock.advance(motion_start_s + static_cast<double>(i) * options.period_s + late_s - clock.now_s());
    if (still >= enough) {
      repeat_last(run, clock.now_s() - motion_start_s);
      continue;
    }
    const Tick tick = servo.tick();
    if (tick.fault != Fault::kNone) {
      run.fault = tick.fault;
      break;
    }
    const Vec3 hip_mm = options.world_from_device * device.hip_mm();
    run.hip.t_s.push_back(tick.t_s - motion_start_s);
    run.hip.hip_mm.push_back(hip_mm);
    run.measured.t_s.push_back(tick.t_s - motion_start_s);
    run.measured.hip_mm.push_back(options.world_from_device * tick.state.position_mm);
    run.felt.frames.push_back(tick.frame);
    run.sent_n.push_back(options.world_from_device.rotate(tick.sent_n));
    run.motor_force_n.push_back(options.world_from_device.rotate(device.motor_force_n()));
    observer.observe(hip_mm, run.sent_n.back());
    still = device.at_rest() && repeats(run) ? still + 1 : 0;
  }
  run.energy = device.energy();
  run.least_environment_mj = observer.min_energy_mj();
  run.slewed = servo.governor()->counters().slewed;
  run.clamped = servo.governor()->counters().clamped;
  servo.stop();
  return run;
}

Swing swing_of(const trace::ProbePath& path, const Vec3& along, double quiet_mm) {
  Swing swing;
  if (path.size() == 0 || path.t_s.back() - path.t_s.front() < kApartS + kWindowS) return swing;
  const double end_s = path.t_s.back();
  const Window last = window_of(path, along, end_s - kWindowS, end_s);
  const Window earlier = window_of(path, along, end_s - kApartS - kWindowS, end_s - kApartS);
  swing.amplitude_mm = last.amplitude_mm;
  swing.frequency_hz = last.frequency_hz;
  swing.sustained = last.amplitude_mm > quiet_mm && last.amplitude_mm > kKept * earlier.amplitude_mm;
  return swing;
}

double passive_stiffness_n_per_mm(double damping_n_s_per_mm, double wall_damping_n_s_per_mm,
                                  double friction_n, double encoder_mm, double period_s) noexcept {
  const double sampled =
      std::max(0.0, 2.0 * (damping_n_s_per_mm - std::abs(wall_damping_n_s_per_mm)) / period_s);
  return encoder_mm > 0.0 ? std::min(sampled, 2.0 * friction_n / encoder_mm) : sampled;
}

double spectral_radius(const LinearLoop& loop, double stiffness_n_per_mm) {
  const auto whole = static_cast<int>(
      std::clamp(std::floor(loop.delay_s / loop.period_s), 0.0, static_cast<double>(kMaxPeriodsOfDelay)));
  const double rest_s = std::max(0.0, loop.delay_s - whole * loop.period_s);
  // State: x, v, motor, x one period ago, and the pending commands, newest first.
  const int sent = whole + 1, size = 4 + sent;
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(size, size);
  Eigen::RowVectorXd command = Eigen::RowVectorXd::Zero(size);
  command(0) = -stiffness_n_per_mm - loop.wall_damping_n_s_per_mm / loop.period_s;
  command(3) = loop.wall_damping_n_s_per_mm / loop.period_s;
  // In the first part of the period the command of `whole + 1` periods ago acts, then that of `whole`.
  Eigen::RowVectorXd early = Eigen::RowVectorXd::Zero(size), late = command;
  early(4 + whole) = 1.0;
  if (whole > 0) {
    late.setZero();
    late(4 + whole - 1) = 1.0;
  }
  Eigen::MatrixXd motion = Eigen::MatrixXd::Zero(3, size);
  motion.leftCols(3).setIdentity();
  for (const auto& [dt_s, acts] : {std::pair{rest_s, early}, std::pair{loop.period_s - rest_s, late}}) {
    if (!(dt_s > 0.0)) continue;
    const Eigen::Matrix<double, 3, 4> part = over(loop.plant, dt_s);
    motion = (part.leftCols(3) * motion + part.col(3) * acts).eval();
  }
  map.topRows(3) = motion;
  map(3, 0) = 1.0;
  map.row(4) = command;
  for (int i = 1; i < sent; ++i) map(4 + i, 4 + i - 1) = 1.0;
  return Eigen::EigenSolver<Eigen::MatrixXd>(map, false).eigenvalues().cwiseAbs().maxCoeff();
}

double linear_stiffness_n_per_mm(const LinearLoop& loop, double least_n_per_mm) {
  const auto stable = [&](double k) { return spectral_radius(loop, k) <= 1.0 + kOnCircle; };
  double high = least_n_per_mm;
  while (stable(high)) {
    high *= kStep;
    if (high > kRange * least_n_per_mm) return std::numeric_limits<double>::infinity();
  }
  double low = high / kStep;
  while (high > low * (1.0 + kExact)) {
    const double middle = std::sqrt(low * high);
    (stable(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace palpate::device
