// What a scene asks for and what a renderer gives: stated in the registry, compared before anything is
// prepared, so that nothing that a scene says is ignored in silence.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/render/renderer.h"

namespace palpate::render {

/// What a renderer is to those who compare.
enum class Role : std::uint8_t {
  kOurs,       ///< what a user should pick
  kLiteral,    ///< the thesis as printed
  kRival,      ///< the literature's, points and meshes alike
  kReference,  ///< ground truth
  kOracle,     ///< the obvious slow way: what tests compare with
};

/// What a renderer touches.
enum class Geometry : std::uint8_t { kPoints, kMesh, kHeights, kFormula };

/// One thing that a scene may ask for: a bit each.
enum class Feature : std::uint16_t {
  kFriction = 1u << 0,
  kSoftness = 1u << 1,  ///< deformation that is only felt: a share of the force
  kTexture = 1u << 2,
  kDent = 1u << 3,      ///< points that give way where they are pressed
  kPerPoint = 1u << 4,  ///< properties that differ from point to point
  kMotion = 1u << 5,
  kManyModels = 1u << 6,
  kMovedPoints = 1u << 7,   ///< points that somebody else moves (MoveQueue)
  kJointContact = 1u << 8,  ///< several models touched at once hold the god object together; asked by none
};

/// A set of features.
class Features {
 public:
  constexpr Features() = default;
  constexpr Features(Feature feature) : bits_(static_cast<std::uint16_t>(feature)) {}  // NOLINT: a set of one
  [[nodiscard]] constexpr bool has(Feature feature) const noexcept {
    return (bits_ & static_cast<std::uint16_t>(feature)) != 0;
  }
  [[nodiscard]] constexpr bool empty() const noexcept { return bits_ == 0; }
  [[nodiscard]] constexpr Features operator|(Features other) const noexcept {
    return Features(static_cast<std::uint16_t>(bits_ | other.bits_));
  }
  constexpr Features& operator|=(Features other) noexcept { return *this = *this | other; }
  /// Of these, those that are not in `other`.
  [[nodiscard]] constexpr Features without(Features other) const noexcept {
    return Features(static_cast<std::uint16_t>(bits_ & ~other.bits_));
  }
  friend constexpr bool operator==(Features, Features) noexcept = default;

 private:
  constexpr explicit Features(std::uint16_t bits) : bits_(bits) {}
  std::uint16_t bits_ = 0;
};
[[nodiscard]] constexpr Features operator|(Feature a, Feature b) noexcept {
  return Features(a) | Features(b);
}

/// Friction and texture, softness, values point by point, motion and several models: all but dents and joint
/// contact.
inline constexpr Features kAllOfRigidSurfaces = Feature::kFriction | Feature::kSoftness | Feature::kTexture |
                                                Feature::kPerPoint | Feature::kMotion | Feature::kManyModels;

/// "ours", "literal", "rival", "reference", "oracle".
[[nodiscard]] std::string_view name_of(Role role) noexcept;
/// "points", "mesh", "heights", "formula".
[[nodiscard]] std::string_view name_of(Geometry geometry) noexcept;
/// In words, in the order of their bits: "friction", "deformation", ..
[[nodiscard]] std::vector<std::string> names_of(Features features);

/// What the models of a scene ask of any renderer.
[[nodiscard]] Features asked_by(const SceneInput& scene);

}  // namespace palpate::render
