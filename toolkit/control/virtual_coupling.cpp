#include "toolkit/control/virtual_coupling.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

namespace palpate::control {

Status check(const Coupling& coupling) {
  if (!std::isfinite(coupling.stiffness_n_per_mm) || !(coupling.stiffness_n_per_mm > 0.0))
    return Error{"the coupling's stiffness_n_per_mm is " + std::to_string(coupling.stiffness_n_per_mm),
                 "give a finite number above 0", "", 0};
  if (!std::isfinite(coupling.damping_n_s_per_mm) || coupling.damping_n_s_per_mm < 0.0)
    return Error{"the coupling's damping_n_s_per_mm is " + std::to_string(coupling.damping_n_s_per_mm),
                 "give a finite number, 0 or above", "", 0};
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

}  // namespace palpate::control
