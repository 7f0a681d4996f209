// A model's surface properties: stiffness, friction, deformation and texture, per model or per point
// (sections 3.3.2 and 3.5).
//
// First:
//   palpate::surface::Surface rubber;
//   rubber.stiffness_n_per_mm = 0.3;
//   rubber.friction = {0.7, 0.5};  // static, dynamic
//   scene.models[0].surface = rubber;
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include <palpate/vec.h>

namespace palpate::surface {

/// 16-bit heights, row after row; tiled.
struct TextureImage {
  std::uint32_t columns = 0;
  std::uint32_t rows = 0;
  std::vector<std::uint16_t> height;  ///< columns * rows; 65535 = not carved, 0 = full depth

  [[nodiscard]] bool empty() const noexcept { return height.empty(); }
};

/// Depth of the carving at a place, and its slope.
struct Relief {
  double depth_mm = 0.0;      ///< 0 .. Texture::depth_mm
  Vec3 slope = Vec3::Zero();  ///< gradient of the depth, mm/mm
};

enum class TextureKind : std::uint8_t {
  kNone,
  kGrating,  ///< a sinusoid along one axis
  kNoise,    ///< smooth noise of one wavelength
  kImage,    ///< an image projected along the three axes, blended by the normal
};

enum class TextureEffect : std::uint8_t {
  kGodObject,  ///< the god object sinks into the relief: a potential force that creates no energy
  kForce,      ///< the force is turned as if the surface were tilted, its size kept (bump mapping)
};

/// Steepest carving: 30 degrees, where the slope's force is half the normal force. Steeper reliefs are
/// flattened in preparation, and the report says so.
inline constexpr double kMaxTextureSlope = 0.577;

struct Texture {
  TextureKind kind = TextureKind::kNone;
  TextureEffect effect = TextureEffect::kGodObject;
  double depth_mm = 0.0;       ///< deepest carving, above 0
  double wavelength_mm = 0.0;  ///< of the grating or noise; of an image, the width of one tile; above 0
  Vec3 axis = Vec3::UnitX();   ///< of the grating, model frame, unit
  std::uint64_t seed = 1;      ///< of the noise
  std::shared_ptr<const TextureImage> image;  ///< of kImage

  [[nodiscard]] bool any() const noexcept { return kind != TextureKind::kNone; }
  /// The steepest slope, mm/mm. O(pixels) for images.
  [[nodiscard]] double steepest() const noexcept;
  /// The relief at a place (model frame, mm) on a surface with unit normal `normal`. O(1), allocates nothing.
  [[nodiscard]] Relief at(const Vec3& place_mm, const Vec3& normal) const noexcept;
};

/// Coulomb's coefficients, static_coefficient >= dynamic_coefficient >= 0. Both 0: frictionless.
struct Friction {
  double static_coefficient = 0.0;
  double dynamic_coefficient = 0.0;
  [[nodiscard]] bool any() const noexcept { return static_coefficient > 0.0 || dynamic_coefficient > 0.0; }
};

/// Per-point properties. Each array is as long as the cloud, or empty: the model's value holds everywhere.
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

/// Geometric deformation by the probe (section 3.3.2.2): points deeper than `yield_mm` give way by at most
/// `rate_mm_s`, fading out to `radius_mm`. All 0: rigid geometry.
struct Dent {
  double yield_mm = 0.0;
  double radius_mm = 0.0;
  double rate_mm_s = 0.0;
  [[nodiscard]] bool any() const noexcept { return radius_mm > 0.0 && rate_mm_s > 0.0; }
};

struct Surface {
  /// Spring between HIP and god object, N/mm, above 0.
  double stiffness_n_per_mm = 0.5;
  Friction friction;
  /// Share of the rigid force that a simulated deformation removes (figure 46): F_D = (1 - c) F_R, c in [0,
  /// 1). The thesis does not say whether the coefficient is compliance or scale; this is our reading.
  double deformation = 0.0;
  Texture texture;
  Dent dent;
  std::shared_ptr<const PointProperties> per_point;  ///< or null
};

}  // namespace palpate::surface
