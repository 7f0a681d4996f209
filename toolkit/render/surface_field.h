// A model's surface properties as frames read them: uniform values, or one entry per point.
#pragma once

#include <cstdint>
#include <span>

#include <palpate/registry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/surface.h>
#include "toolkit/core/hardware.h"
#include "toolkit/search/neighbour_table.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::render {

/// Features that a surface needs. The frame function is composed of them in preparation.
enum SurfaceFeature : unsigned {
  kFriction = 1,
  kVaried = 2,  ///< properties differ from point to point
  kTexture = 4,
};
inline constexpr unsigned kSurfaceFeatures = 8;

struct PointSurface {
  float stiffness_n_per_mm;  ///< of the deformed surface: k (1 - deformation)
  float static_friction;
  float dynamic_friction;
};

/// A surface's needs of frame and memory, decided from the scene.
struct SurfaceDecision {
  unsigned features = 0;                    ///< bits of SurfaceFeature
  double stiffness_n_per_mm = 0.5;          ///< if uniform; of the deformed surface
  surface::Friction friction;               ///< if uniform
  double largest_stiffness_n_per_mm = 0.5;  ///< anywhere on the model
  surface::Texture texture;
};

/// True if any property varies from point to point; empty arrays count as uniform.
[[nodiscard]] bool varies(const surface::Surface& surface) noexcept;

/// Decides the features. Invalid values are an Error: stiffness <= 0, deformation outside [0, 1), dynamic
/// friction above static, arrays of wrong length. O(n) for per-point properties, else O(1).
[[nodiscard]] Result<SurfaceDecision> decide_surface(const ModelInput& model);

/// Describes what is stored for each of `places`, the frame's stages, and the features that the renderer
/// leaves out (those not in `felt`). Adds to the bytes and to a known frame time.
void describe_surface(const ModelInput& model, const SurfaceDecision& decision, Features felt,
                      std::uint64_t places, ModelDecisions& out);

struct SurfaceField : SurfaceDecision {
  LargePageVector<PointSurface> by_point;  ///< empty if uniform

  [[nodiscard]] double static_friction(std::uint32_t place) const noexcept {
    return by_point.empty() ? friction.static_coefficient
                            : static_cast<double>(by_point[place].static_friction);
  }
  [[nodiscard]] std::size_t bytes() const noexcept { return by_point.capacity() * sizeof(PointSurface); }
};

/// Builds the field of decide_surface() with the values of each place. `order`: cloud index per place. Notes
/// go to `report`. Errors as of decide_surface(). O(n).
[[nodiscard]] Result<SurfaceField> build_surface_field(const ModelInput& model,
                                                       std::span<const std::uint32_t> order,
                                                       PrepareReport& report);

/// The same for a model without per-point properties, of any geometry.
[[nodiscard]] Result<SurfaceField> build_uniform_surface_field(const surface::Surface& surface,
                                                               PrepareReport& report);

/// Resolutions over which a varying stiffness rises. A rise from zero then makes the potential's second force
/// at most d / (16 resolutions) of the first: a tenth at 2 mm depth and 1 mm resolution.
inline constexpr double kBlendResolutions = 8.0;

/// Limits the slope of the stiffness along the surface to the largest difference over `blend_mm`, by
/// softening only. Without this the potential at a border (section 3.3.2.3) would be a step with unbounded
/// force. Exact (shortest-path search over the links). O(m log m) in the changed points; returns their
/// number.
std::size_t blend_stiffness(SurfaceField& field, std::span<const surface::OrientedPoint> points,
                            std::span<const search::Neighbours> neighbours, double blend_mm);

}  // namespace palpate::render
