// Virtual coupling (section 2.2.4 of the thesis, reference [76]; Colgate, Stanley and Brown 1995; Adams and
// Hannaford 1999): a spring and a damper between the device and the god object, so that what the device has
// to show does not depend on how stiff the virtual environment is.
#pragma once

#include "toolkit/core/result.h"
#include "toolkit/core/vec.h"

namespace palpate::control {

struct Coupling {
  double stiffness_n_per_mm = 0.0;  ///< k_c, above 0
  double damping_n_s_per_mm = 0.0;  ///< b_c, 0 or above
};

/// Finite, k_c above 0 and b_c not negative, or an Error that names the wrong one.
[[nodiscard]] Status check(const Coupling& coupling);

/// What Colgate's condition b > k_c T / 2 + b_c says of a coupling on a device.
struct CouplingStability {
  bool passive = false;            ///< the condition holds: stable whatever the environment and the hand
  double needed_n_s_per_mm = 0.0;  ///< k_c T / 2 + b_c, which the device's own damping must exceed
  double most_stiffness_n_per_mm = 0.0;  ///< 2 (b - b_c) / T, which k_c must stay below; 0 where none is
};
/// `device_damping_n_s_per_mm` is b, the friction-like damping of the device itself; `period_s` is T of the
/// servo.
[[nodiscard]] CouplingStability coupling_stability(const Coupling& coupling, double device_damping_n_s_per_mm,
                                                   double period_s) noexcept;

/// F = k_c in series with the model's spring, plus b_c d/dt (g - h).
///
/// h is the device, g the god object that the renderer found for it, F_r the force it answered. The stretched
/// length is |g - h|, so the model's own stiffness there is |F_r| / |g - h|, and two springs in a row carry
/// F_r k_c |g - h| / (k_c |g - h| + |F_r|): a rigid model is felt with k_c, a soft one stays soft, none is
/// stiffer than k_c, and the direction (shading, friction) is the renderer's. The damper never pulls the
/// device to the surface: the part of the sum against g - h is left out, which takes only from what the
/// damper gives.
class VirtualCoupling {
 public:
  explicit VirtualCoupling(const Coupling& coupling = {}) noexcept : coupling_(coupling) {}

  void reset() noexcept { last_stretch_mm_.setZero(); }
  /// The force on the device. `contact` false gives exactly zero. Bounded work, no allocation; never NaN
  /// where the arguments are finite, zero where they are not.
  [[nodiscard]] Vec3 couple(const Vec3& hip_mm, const Vec3& god_object_mm, const Vec3& renderer_force_n,
                            bool contact, double dt_s) noexcept;
  [[nodiscard]] const Coupling& coupling() const noexcept { return coupling_; }

 private:
  Coupling coupling_;
  Vec3 last_stretch_mm_ = Vec3::Zero();
};

}  // namespace palpate::control
