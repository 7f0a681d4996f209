// The renderers by name. Each library has a register function that fills the object; there are no globals.
//
// First:
//   palpate::render::Registry registry;
//   palpate::render::register_toolkit_renderers(registry);
//   auto renderer = registry.make("cloud", {});
//   if (!renderer) return failed(renderer.error());  // names the nearest known ones
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/options.h>
#include <palpate/renderer.h>
#include <palpate/result.h>

namespace palpate::render {

/// A renderer's role in comparisons.
enum class Role : std::uint8_t {
  kOurs,       ///< the recommended ones
  kLiteral,    ///< the thesis as printed
  kRival,      ///< from the literature, on points or meshes
  kReference,  ///< ground truth
  kOracle,     ///< the plain slow way that tests compare with
};

/// The data that a renderer touches.
enum class Geometry : std::uint8_t { kPoints, kMesh, kHeights, kFormula, kImages };

/// One feature that a scene may need; one bit each.
enum class Feature : std::uint16_t {
  kFriction = 1u << 0,
  kSoftness = 1u << 1,  ///< deformation by scaling the force, without moving points
  kTexture = 1u << 2,
  kDent = 1u << 3,      ///< points that give way under pressure
  kPerPoint = 1u << 4,  ///< properties that differ from point to point
  kMotion = 1u << 5,
  kManyModels = 1u << 6,
  kMovedPoints = 1u << 7,   ///< points moved from outside (MoveQueue)
  kJointContact = 1u << 8,  ///< contacts with several models hold one god object; no scene requires it
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
  /// The features of this set that `other` lacks.
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

/// All features but dents, moved points and joint contact.
inline constexpr Features kAllOfRigidSurfaces = Feature::kFriction | Feature::kSoftness | Feature::kTexture |
                                                Feature::kPerPoint | Feature::kMotion | Feature::kManyModels;

/// "ours", "literal", "rival", "reference", "oracle".
[[nodiscard]] std::string_view name_of(Role role) noexcept;
/// "points", "mesh", "heights", "formula", "images".
[[nodiscard]] std::string_view name_of(Geometry geometry) noexcept;
/// Names in the order of the bits: "friction", "deformation", ..
[[nodiscard]] std::vector<std::string> names_of(Features features);

/// The features that the models of a scene need.
[[nodiscard]] Features features_required_by(const SceneInput& scene);

struct RendererInfo {
  std::string name;     ///< as in scene files and on the command line
  std::string summary;  ///< one line
  std::string source;   ///< thesis section or paper
  Role role = Role::kRival;
  Geometry geometry = Geometry::kPoints;  ///< kFormula: only for generated models; kImages: with a camera
  Features supports;                      ///< features that it renders
  std::vector<OptionSpec> options;
  /// Makes an unprepared renderer. `options` is complete and validated.
  std::function<std::unique_ptr<HapticRenderer>(const Options& options)> make;
};

class Registry {
 public:
  /// A repeated name is a programming error (asserted).
  void add(RendererInfo info);
  [[nodiscard]] const std::vector<RendererInfo>& all() const noexcept { return renderers_; }
  [[nodiscard]] const RendererInfo* find(std::string_view name) const noexcept;
  /// Validates the options and makes the renderer. The Error for an unknown name lists the nearest known
  /// ones.
  [[nodiscard]] Result<std::unique_ptr<HapticRenderer>> make(std::string_view name,
                                                             const Options& options) const;
  /// An Error if the renderer lacks features of the scene, which it names with the renderers that have them,
  /// or if it needs images and the scene has no camera.
  [[nodiscard]] Status check_supports(const RendererInfo& info, const SceneInput& scene) const;

 private:
  std::vector<RendererInfo> renderers_;
};

/// One sentence per feature of the scene that this renderer leaves out; empty if none.
[[nodiscard]] std::vector<std::string> unsupported_features(const RendererInfo& info,
                                                            const SceneInput& scene);

/// Adds cloud-literal, cloud, cloud-smooth, heightfield-literal, heightfield, depth-image, analytic and
/// brute-force. None may be registered already.
void register_toolkit_renderers(Registry& registry);

/// Adds every renderer-NAME.so of the plug-in folders ($PALPATE_PLUGINS, then lib/palpate/plugins) as NAME;
/// a taken name is not replaced. A library is loaded by decide() or prepare() alone, whose Error says what is
/// wrong with it: naming or listing one runs nothing of it. Register them last.
void register_plugin_renderers(Registry& registry);

}  // namespace palpate::render

// Neighbours by Voronoi cells, through CGAL. A separate target (palpate::voronoi).

namespace palpate::voronoi {

/// Adds the builder "voronoi" to search::neighbour_builders(). Call it before registering renderers, which
/// list the builders' names.
void register_voronoi();

}  // namespace palpate::voronoi
