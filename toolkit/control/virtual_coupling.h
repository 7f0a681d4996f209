// Virtual coupling (section 2.2.4, reference [76]; Colgate, Stanley and Brown 1995; Adams and Hannaford
// 1999): a spring and damper between device and god object, so that the device's load does not depend on the
// environment's stiffness.
#pragma once

#include <palpate/control.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::control {

/// k_c finite and above 0, b_c finite and not negative; else an Error names the wrong one.
[[nodiscard]] Status check(const Coupling& coupling);

/// Colgate's condition b > k_c T / 2 + b_c for a coupling on a device.
struct CouplingStability {
  bool passive = false;  ///< the condition holds: stable for any environment and hand
  double min_device_damping_n_s_per_mm =
      0.0;                              ///< k_c T / 2 + b_c, which the device's own damping must exceed
  double max_stiffness_n_per_mm = 0.0;  ///< 2 (b - b_c) / T, an upper bound on k_c; 0 if none is possible
};
/// `device_damping_n_s_per_mm` is b, the device's own friction-like damping; `period_s` is the servo's T.
[[nodiscard]] CouplingStability coupling_stability(const Coupling& coupling, double device_damping_n_s_per_mm,
                                                   double period_s) noexcept;

/// Spring k_c and damper b_c in parallel, in series with the model's spring: F = f + b_c d|g - h|/dt, along
/// the renderer's force.
/// h is the device, g the god object, F_r the renderer's force. The model's stiffness is |F_r| / |g - h|, and
/// two springs in series carry f = |F_r| k_c |g - h| / (k_c |g - h| + |F_r|): a rigid model feels like k_c, a
/// soft one stays soft, none is stiffer than k_c. The damper resists changes of the length |g - h|. Only the
/// renderer knows its surface's direction (with friction g - h is not the normal; at depth 0 it is zero), so
/// spring and damper act along its force only, never pulling the device to the surface.
class VirtualCoupling {
 public:
  explicit VirtualCoupling(const Coupling& coupling = {}) noexcept : coupling_(coupling) {}

  void reset() noexcept { last_length_mm_ = 0.0; }
  /// The force on the device; exactly zero without `contact`. Bounded work, no allocation; never NaN for
  /// finite arguments, zero for others.
  [[nodiscard]] Vec3 couple(const Vec3& hip_mm, const Vec3& god_object_mm, const Vec3& renderer_force_n,
                            bool contact, double dt_s) noexcept;
  [[nodiscard]] const Coupling& coupling() const noexcept { return coupling_; }

 private:
  Coupling coupling_;
  double last_length_mm_ = 0.0;  ///< in the last contact frame; 0 when free
};

}  // namespace palpate::control
