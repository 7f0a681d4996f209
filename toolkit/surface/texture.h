// Simulated texture (section 3.5.1): a relief carved into a surface, by a formula or an image.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "toolkit/core/vec.h"

namespace palpate::surface {

/// Heights in 16 bits, row after row; tiled, so that the first row follows the last.
struct TextureImage {
  std::uint32_t columns = 0;
  std::uint32_t rows = 0;
  std::vector<std::uint16_t> height;  ///< columns * rows; 65535 = not carved, 0 = carved by the whole depth

  [[nodiscard]] bool empty() const noexcept { return height.empty(); }
};

/// Depth of the carving and its slope at a place.
struct Relief {
  double depth_mm = 0.0;      ///< 0 .. Texture::depth_mm
  Vec3 slope = Vec3::Zero();  ///< gradient of the depth, mm/mm
};

enum class TextureKind : std::uint8_t {
  kNone,
  kGrating,  ///< a sinusoid along one axis
  kNoise,    ///< smooth noise of one wavelength
  kImage,    ///< an image laid on along the three axes, blended by the normal
};

enum class TextureEffect : std::uint8_t {
  kGodObject,  ///< the god object sinks into the relief: forces of a potential, no energy is made
  kForce,      ///< the force is turned as if its surface were tilted, its size kept (bump mapping)
};

/// The steepest carving: 30 degrees, where the slope's own force is half the normal one. Steeper reliefs are
/// made flatter when prepared, and the report says so.
inline constexpr double kMaxTextureSlope = 0.577;

struct Texture {
  TextureKind kind = TextureKind::kNone;
  TextureEffect effect = TextureEffect::kGodObject;
  double depth_mm = 0.0;       ///< deepest carving, > 0
  double wavelength_mm = 0.0;  ///< of the grating or noise; of an image the edge of one tile's columns; > 0
  Vec3 axis = Vec3::UnitX();   ///< of the grating, model frame, unit
  std::uint64_t seed = 1;      ///< of the noise
  std::shared_ptr<const TextureImage> image;  ///< of kImage

  [[nodiscard]] bool any() const noexcept { return kind != TextureKind::kNone; }
  /// The steepest slope there can be, mm/mm. O(pixels) for images.
  [[nodiscard]] double steepest() const noexcept;
  /// The relief at a place (model frame, mm) of a surface with that unit normal. Allocates nothing, O(1).
  [[nodiscard]] Relief at(const Vec3& place_mm, const Vec3& normal) const noexcept;
};

}  // namespace palpate::surface
