// A model's surface as frames read it: uniform numbers where they are uniform, one entry a point where they
// vary.
#pragma once

#include <cstdint>
#include <span>

#include "toolkit/core/large_pages.h"
#include "toolkit/core/result.h"
#include "toolkit/neighbourhood/neighbour_table.h"
#include "toolkit/render/capabilities.h"
#include "toolkit/render/renderer.h"
#include "toolkit/surface/planes.h"
#include "toolkit/surface/surface.h"

namespace palpate::render {

/// What a surface asks of the frame. A frame function is composed of these when it is prepared; what is not
/// asked for is not in it.
enum SurfaceFeature : unsigned {
  kFriction = 1,
  kVaried = 2,  ///< properties differ from point to point
  kTexture = 4,
};
inline constexpr unsigned kSurfaceFeatures = 8;

struct PlaceSurface {
  float stiffness_n_per_mm;  ///< of the deformed surface: k (1 - deformation)
  float static_friction;
  float dynamic_friction;
};

/// What a surface asks of frame and memory, decided from the scene alone.
struct SurfaceDecision {
  unsigned features = 0;                    ///< of SurfaceFeature
  double stiffness_n_per_mm = 0.5;          ///< where nothing varies, of the deformed surface
  surface::Friction friction;               ///< where nothing varies
  double largest_stiffness_n_per_mm = 0.5;  ///< anywhere on the model
  surface::Texture texture;
};

/// Whether any property differs from point to point: arrays that are there and empty say nothing.
[[nodiscard]] bool varies(const surface::Surface& surface) noexcept;

/// Values that make no sense (stiffness not above 0, deformation outside [0, 1), dynamic friction above
/// static, arrays of another length) are an Error. O(n) where properties differ from point to point, else
/// O(1).
[[nodiscard]] Result<SurfaceDecision> decide_surface(const ModelInput& model);

/// In words: what is stored for each of `places`, what stages the frame has, and which of the features that a
/// renderer lacks (not in `felt`) it leaves out. Adds to bytes and to a frame time that is known.
void say_surface(const ModelInput& model, const SurfaceDecision& decision, Features felt,
                 std::uint64_t places, ModelDecisions& out);

struct SurfaceField : SurfaceDecision {
  LargeVector<PlaceSurface> of_place;  ///< empty where nothing varies

  [[nodiscard]] double static_friction(std::uint32_t place) const noexcept {
    return of_place.empty() ? friction.static_coefficient
                            : static_cast<double>(of_place[place].static_friction);
  }
  [[nodiscard]] std::size_t bytes() const noexcept { return of_place.capacity() * sizeof(PlaceSurface); }
};

/// What decide_surface() says, with its values for each place. `order`: cloud index of each place, as many
/// places as there are. Notes go to `report`. Errors as there. O(n).
[[nodiscard]] Result<SurfaceField> build_surface_field(const ModelInput& model,
                                                       std::span<const std::uint32_t> order,
                                                       PrepareReport& report);

/// The same for a model without per-point properties, whatever it is made of.
[[nodiscard]] Result<SurfaceField> build_uniform_surface_field(const surface::Surface& surface,
                                                               PrepareReport& report);

/// Stiffness that varies rises over this many resolutions: the potential's second force is then at most
/// d / (16 resolutions) of the first for a rise from nothing, a tenth at 2 mm depth and 1 mm resolution.
inline constexpr double kBlendResolutions = 8.0;

/// Lets the stiffness rise no faster along the surface than the largest difference over `blend_mm`; it is
/// only ever made softer. Without this the potential of section 3.3.2.3's border would be a step, and its
/// force without bound. Exact (a shortest-path search over the links), O(m log m) in the points that change.
/// Returns how many changed.
std::size_t blend_stiffness(SurfaceField& field, std::span<const surface::SurfacePoint> points,
                            std::span<const neighbourhood::Neighbours> neighbours, double blend_mm);

}  // namespace palpate::render
