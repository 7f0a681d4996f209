#include "toolkit/control/coupling_and_passivity.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>

#include <palpate/renderer.h>
#include <palpate/result.h>

namespace palpate::control {

Status check(const Coupling& coupling) {
  if (!std::isfinite(coupling.stiffness_n_per_mm) || !(coupling.stiffness_n_per_mm > 0.0))
    return Error{"the coupling's stiffness_n_per_mm is " + std::to_string(coupling.stiffness_n_per_mm),
                 "give a finite number above 0"};
  if (!std::isfinite(coupling.damping_n_s_per_mm) || coupling.damping_n_s_per_mm < 0.0)
    return Error{"the coupling's damping_n_s_per_mm is " + std::to_string(coupling.damping_n_s_per_mm),
                 "give a finite number, 0 or above"};
  return Done{};
}

CouplingStability coupling_stability(const Coupling& coupling, double device_damping_n_s_per_mm,
                                     double period_s) noexcept {
  CouplingStability s;
  s.min_device_damping_n_s_per_mm =
      0.5 * coupling.stiffness_n_per_mm * period_s + coupling.damping_n_s_per_mm;
  s.passive = device_damping_n_s_per_mm > s.min_device_damping_n_s_per_mm;
  s.max_stiffness_n_per_mm =
      std::max(0.0, 2.0 * (device_damping_n_s_per_mm - coupling.damping_n_s_per_mm) / period_s);
  return s;
}

Vec3 VirtualCoupling::couple(const Vec3& hip_mm, const Vec3& god_object_mm, const Vec3& renderer_force_n,
                             bool contact, double dt_s) noexcept {
  const Vec3 stretch_mm = god_object_mm - hip_mm;
  if (!contact || !is_finite(stretch_mm) || !is_finite(renderer_force_n)) {
    last_length_mm_ = 0.0;
    return Vec3::Zero();
  }
  const double length_mm = stable_norm(stretch_mm);
  const double longer_mm = length_mm - std::exchange(last_length_mm_, length_mm);
  const double coupled_n = coupling_.stiffness_n_per_mm * length_mm;
  const double model_n = stable_norm(renderer_force_n);
  // At depth 0, or without a model force, the direction is undefined.
  if (!(coupled_n > 0.0) || !(model_n > 0.0)) return Vec3::Zero();
  // Written so that neither a rigid nor a resting model divides by zero.
  Vec3 force_n = renderer_force_n / (1.0 + model_n / coupled_n);
  if (coupling_.damping_n_s_per_mm > 0.0 && dt_s > 0.0) {
    const double spring_n = stable_norm(force_n);
    const double damped_n = spring_n + coupling_.damping_n_s_per_mm / dt_s * longer_mm;
    force_n *= damped_n > 0.0 && spring_n > 0.0 ? damped_n / spring_n : 0.0;
  }
  return is_finite(force_n) ? force_n : Vec3::Zero();
}

double PassivityObserver::current_force_weight() const noexcept {
  switch (rule_) {
    case EnergyRule::kTrapezoid:
      return 0.5;
    case EnergyRule::kPrinted:
      return 1.0;
    case EnergyRule::kHold:
      return 0.0;
  }
  return 0.5;
}

double PassivityObserver::energy_after_mj(const Vec3& hip_mm, const Vec3& force_n) const noexcept {
  if (!started_) return energy_mj_;
  const double now = current_force_weight();
  const Vec3 step_mm = hip_mm - last_hip_mm_;
  const double after_mj = energy_mj_ - ((1.0 - now) * last_force_n_ + now * force_n).dot(step_mm);
  return std::isfinite(after_mj) ? after_mj : energy_mj_;
}

void PassivityObserver::observe(const Vec3& hip_mm, const Vec3& force_n) noexcept {
  if (!is_finite(hip_mm) || !is_finite(force_n)) return;
  energy_mj_ = energy_after_mj(hip_mm, force_n);
  min_energy_mj_ = std::min(min_energy_mj_, energy_mj_);
  last_hip_mm_ = hip_mm;
  last_force_n_ = force_n;
  started_ = true;
}

Vec3 PassivityController::damping_n(const Vec3& hip_mm, const Vec3& wanted_n, double dt_s) const noexcept {
  const double owed_mj = -observer_.energy_after_mj(hip_mm, wanted_n);
  if (!(owed_mj > 0.0) || !observer_.started() || !(dt_s > 0.0)) return Vec3::Zero();
  const Vec3 velocity_mm_s = (hip_mm - observer_.last_hip_mm()) / dt_s;
  // N s/mm times mm^2/s^2 times s: the energy that one unit of damping takes, mJ.
  const double weight = observer_.current_force_weight() > 0.0 ? observer_.current_force_weight() : 1.0;
  const double taken_mj = weight * dt_s * velocity_mm_s.squaredNorm();
  if (!(taken_mj > 0.0)) return Vec3::Zero();  // at rest damping takes nothing
  const double alpha = std::min(owed_mj / taken_mj, options_.damping_limit_n_s_per_mm);
  const Vec3 damping_n = -alpha * velocity_mm_s;
  return is_finite(damping_n) ? damping_n : Vec3::Zero();
}

Vec3 PassivityController::control(const Vec3& hip_mm, const Vec3& wanted_n, double dt_s,
                                  double limit_n) noexcept {
  if (!is_finite(hip_mm) || !is_finite(wanted_n)) return Vec3::Zero();
  Vec3 force_n = render::limited(wanted_n, limit_n);
  const bool free = wanted_n == Vec3::Zero();
  if (!free) {
    const Vec3 damping = damping_n(hip_mm, force_n, dt_s);
    if (damping != Vec3::Zero()) force_n = render::limited(force_n + damping, limit_n);
  }
  observer_.observe(hip_mm, force_n);
  if (free) observer_.forget_surplus();
  return force_n;
}

namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

/// A fixed unit vector perpendicular to a unit vector: along its smallest axis.
Vec3 across(const Vec3& direction) noexcept {
  Eigen::Index axis = 0;
  direction.cwiseAbs().minCoeff(&axis);
  return direction.cross(Vec3::Unit(axis)).normalized();
}

/// A force of `size_n` at an angle from x towards y.
Vec3 at_angle(double size_n, double rad) noexcept {
  return {size_n * std::cos(rad), size_n * std::sin(rad), 0.0};
}
double angle_of(const Vec3& force_n) noexcept {
  return std::atan2(force_n.y(), force_n.x());
}

struct Measured {
  double step;  ///< target of the output
  double slope;
  double dt_s;
  double ramp_end;  ///< limit
};

/// Runs `frame(wanted)`, which returns the output, over a step and a ramp. -1 if the step is not reached.
template <class Restart, class Show>
StepDelay measure(const Measured& m, const Restart& restart, const Show& show) {
  // Tolerance for rounding at the end of a step, far below perception.
  constexpr double kReached = 1.0 - 1e-9;
  constexpr double k63 = 0.63, k95 = 0.95;
  StepDelay delay{-1.0, -1.0, {}};
  restart();
  for (int frame = 0; frame < kMeasuredFrames && delay.to_95_percent_s < 0.0; ++frame) {
    const double shown = show(m.step);
    if (delay.to_63_percent_s < 0.0 && shown >= k63 * m.step * kReached)
      delay.to_63_percent_s = frame * m.dt_s;
    if (shown >= k95 * m.step * kReached) delay.to_95_percent_s = frame * m.dt_s;
  }
  // Settled when the lag no longer grows over the second half, up to rounding.
  constexpr double kRampFrames = 1000.0, kSettled = 1e-6;
  const int frames = static_cast<int>(std::min(kRampFrames, m.ramp_end / (m.slope * m.dt_s)));
  double lag = 0.0, lag_half_way = 0.0;
  restart();
  for (int frame = 1; frame <= frames; ++frame) {
    const double wanted = m.slope * frame * m.dt_s;
    lag = (wanted - show(wanted)) / m.slope;
    if (frame == frames / 2) lag_half_way = lag;
  }
  if (lag - lag_half_way <= kSettled * frames * m.dt_s) delay.ramp_lag_s = std::max(lag, 0.0);
  return delay;
}

Status check_number(const char* name, double value, bool zero_allowed) {
  if (std::isfinite(value) && (value > 0.0 || (zero_allowed && value == 0.0))) return Done{};
  return Error{std::string(name) + " is " + std::to_string(value),
               zero_allowed ? "give a finite number, 0 for no limit" : "give a finite number above 0"};
}

}  // namespace

Status check(const ForceFilterOptions& options) {
  PALPATE_TRY(check_number("rate_limit_n_per_s", options.rate_limit_n_per_s, true));
  return check_number("turn_limit_deg_per_s", options.turn_limit_deg_per_s, true);
}

Vec3 ForceFilter::turned(const Vec3& wanted_n, double max_rad) const noexcept {
  const double last_size_n = stable_norm(last_n_), size_n = stable_norm(wanted_n);
  if (!(last_size_n > 0.0) || !(size_n > 0.0)) return wanted_n;
  const Vec3 from = last_n_ / last_size_n, to = wanted_n / size_n;
  const double cosine = from.dot(to);
  const double angle_rad = std::atan2(from.cross(to).norm(), cosine);
  if (!(angle_rad > max_rad)) return wanted_n;
  const bool literal = options_.form == FilterForm::kLiteral;
  const double rest_rad = angle_rad - max_rad;
  // More than a right angle remains: the wanted force has no component in the allowed direction.
  if (!literal && rest_rad >= 0.5 * std::numbers::pi) return Vec3::Zero();
  const Vec3 side = to - cosine * from;
  const double side_size = side.norm();
  const Vec3 aside = side_size > 0.0 ? Vec3(side / side_size) : across(from);
  return (literal ? size_n : size_n * std::cos(rest_rad)) *
         (std::cos(max_rad) * from + std::sin(max_rad) * aside);
}

Vec3 ForceFilter::filter(const Vec3& wanted_n, double dt_s) noexcept {
  const bool literal = options_.form == FilterForm::kLiteral;
  Vec3 force_n = is_finite(wanted_n) ? wanted_n : Vec3::Zero();
  if (!literal && force_n == Vec3::Zero()) {
    last_n_.setZero();
    return last_n_;
  }
  const double time_s = literal ? kLiteralFrameS : (dt_s > 0.0 && std::isfinite(dt_s) ? dt_s : 0.0);
  if (options_.turn_limit_deg_per_s > 0.0)
    force_n = turned(force_n, options_.turn_limit_deg_per_s * kRadPerDeg * time_s);
  if (options_.rate_limit_n_per_s > 0.0) {
    const double most_n = options_.rate_limit_n_per_s * time_s;
    const Vec3 change_n = force_n - last_n_;
    const double size_n = stable_norm(change_n);
    if (size_n > most_n) force_n = last_n_ + change_n * (most_n / size_n);
  }
  // The change between extreme doubles is infinite: zero is safe.
  if (!is_finite(force_n)) force_n.setZero();
  last_n_ = force_n;
  return last_n_;
}

Result<FilterDelay> filter_delay(const ForceFilterOptions& options, const FilterProbe& probe) {
  PALPATE_TRY(check(options));
  for (const auto& [name, value] :
       std::array<std::pair<const char*, double>, 5>{{{"step_n", probe.step_n},
                                                      {"ramp_n_per_s", probe.ramp_n_per_s},
                                                      {"step_deg", probe.step_deg},
                                                      {"ramp_deg_per_s", probe.ramp_deg_per_s},
                                                      {"dt_s", probe.dt_s}}})
    PALPATE_TRY(check_number(name, value, false));
  constexpr double kRightAngleDeg = 90.0;
  if (!(probe.step_deg < kRightAngleDeg) || !(2.0 * probe.ramp_deg_per_s * probe.dt_s < kRightAngleDeg))
    return Error{"the probe turns through a right angle", "lower step_deg or ramp_deg_per_s"};
  ForceFilter filter(options);
  FilterDelay delay;
  delay.size = measure(
      {probe.step_n, probe.ramp_n_per_s, probe.dt_s, HUGE_VAL}, [&] { filter.reset(); },
      [&](double n) { return filter.filter(Vec3(n, 0, 0), probe.dt_s).x(); });
  // Builds up the full force before turning, to measure onset and turn separately.
  const auto full = [&] {
    filter.reset();
    for (int i = 0; i < kMeasuredFrames; ++i)
      if (filter.filter(at_angle(probe.step_n, 0.0), probe.dt_s).x() == probe.step_n) break;
  };
  delay.direction = measure(
      {probe.step_deg * kRadPerDeg, probe.ramp_deg_per_s * kRadPerDeg, probe.dt_s,
       kRightAngleDeg * kRadPerDeg},
      full, [&](double rad) { return angle_of(filter.filter(at_angle(probe.step_n, rad), probe.dt_s)); });
  if (delay.size.to_95_percent_s < 0.0 || delay.direction.to_95_percent_s < 0.0)
    return Error{"the filter does not reach the step in " + std::to_string(kMeasuredFrames) + " frames",
                 "raise its limits or shorten the step"};
  return delay;
}

}  // namespace palpate::control
