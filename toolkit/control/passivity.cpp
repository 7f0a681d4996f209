#include "toolkit/control/passivity.h"

#include <algorithm>
#include <cmath>

#include <palpate/renderer.h>

namespace palpate::control {

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
    if (damping != Vec3::Zero()) {
      ++damped_frames_;
      force_n = render::limited(force_n + damping, limit_n);
    }
  }
  observer_.observe(hip_mm, force_n);
  if (free) observer_.forget_surplus();
  return force_n;
}

}  // namespace palpate::control
