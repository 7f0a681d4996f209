// What a model's surface does to the probe: stiffness, friction, deformation and texture, for a whole model
// or point by point (sections 3.3.2 and 3.5).
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "toolkit/surface/texture.h"

namespace palpate::surface {

/// Coulomb's coefficients. Both 0: frictionless. static_coefficient >= dynamic_coefficient >= 0.
struct Friction {
  double static_coefficient = 0.0;
  double dynamic_coefficient = 0.0;
  [[nodiscard]] bool any() const noexcept { return static_coefficient > 0.0 || dynamic_coefficient > 0.0; }
};

/// Properties that differ from point to point: each array empty (the model's own value holds everywhere) or
/// as long as the cloud and in its order.
struct PointProperties {
  std::vector<float> stiffness_n_per_mm;
  std::vector<float> static_friction;
  std::vector<float> dynamic_friction;
  std::vector<float> deformation;

  [[nodiscard]] bool varies_stiffness() const noexcept {
    return !stiffness_n_per_mm.empty() || !deformation.empty();
  }
  [[nodiscard]] bool varies_friction() const noexcept {
    return !static_friction.empty() || !dynamic_friction.empty();
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return (stiffness_n_per_mm.capacity() + static_friction.capacity() + dynamic_friction.capacity() +
            deformation.capacity()) *
           sizeof(float);
  }
};

/// Geometric deformation by the probe (section 3.3.2.2): deeper than `yield_mm` the points give way, at most
/// `rate_mm_s`, less and less out to `radius_mm`. All 0: the geometry stays.
struct Dent {
  double yield_mm = 0.0;
  double radius_mm = 0.0;
  double rate_mm_s = 0.0;
  [[nodiscard]] bool any() const noexcept { return radius_mm > 0.0 && rate_mm_s > 0.0; }
};

struct Surface {
  /// Of the spring between HIP and god object, N/mm, above 0.
  double stiffness_n_per_mm = 0.5;
  Friction friction;
  /// Share of the rigid force that a simulated deformation takes away (figure 46): F_D = (1 - c) F_R, in
  /// [0, 1). Our reading of the printed coefficient; whether that is compliance or scale is not said.
  double deformation = 0.0;
  Texture texture;
  Dent dent;
  std::shared_ptr<const PointProperties> per_point;  ///< or null
};

}  // namespace palpate::surface
