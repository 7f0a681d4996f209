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

/// A spring k_c and a damper b_c side by side, in series with the model's spring: F = f + b_c d|g - h|/dt,
/// along the renderer's force.
///
/// h is the device, g the god object that the renderer found for it, F_r the force it answered. The stretched
/// length is |g - h|, so the model's own stiffness there is |F_r| / |g - h|, and two springs in a row carry
/// f = |F_r| k_c |g - h| / (k_c |g - h| + |F_r|): a rigid model is felt with k_c, a soft one stays soft, none
/// is stiffer than k_c. The damper is that of a strut: it resists that the strut gets longer or shorter.
/// Along anything but the renderer's force it has no part, since only the renderer knows where its surface is
/// (with friction g - h is not its normal, at depth 0 there is no g - h): so spring and damper together push
/// as the renderer does, or not at all, and never pull the device to the surface.
class VirtualCoupling {
 public:
  explicit VirtualCoupling(const Coupling& coupling = {}) noexcept : coupling_(coupling) {}

  void reset() noexcept { last_length_mm_ = 0.0; }
  /// The force on the device. `contact` false gives exactly zero. Bounded work, no allocation; never NaN
  /// where the arguments are finite, zero where they are not.
  [[nodiscard]] Vec3 couple(const Vec3& hip_mm, const Vec3& god_object_mm, const Vec3& renderer_force_n,
                            bool contact, double dt_s) noexcept;
  [[nodiscard]] const Coupling& coupling() const noexcept { return coupling_; }

 private:
  Coupling coupling_;
  double last_length_mm_ = 0.0;  ///< of the last frame in contact; 0 where it was free
};

}  // namespace palpate::control
