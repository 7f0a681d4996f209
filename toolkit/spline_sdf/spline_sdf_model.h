// The prepared model of `cloud-smooth`: its bricks and, for varying properties, values at their nodes.
#pragma once

#include <array>
#include <memory>
#include <optional>

#include <palpate/result.h>
#include "toolkit/core/hardware.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_field.h"
#include "toolkit/spline_sdf/brick_grid.h"

namespace palpate::spline_sdf {

/// The options of a build.
struct SplineSdfOptions {
  double detail = 2.0;           ///< standard errors from which a deviation counts as shape
  double voxel_spacings = 1.75;  ///< edge of a cell in spacings
  bool both_sides = false;       ///< pieces with holes that enclose a volume are felt from both sides

  bool operator==(const SplineSdfOptions&) const = default;
};

/// Decisions from the points before building.
struct SplineSdfDecision {
  double spacing_mm = 0.0;
  double noise_mm = 0.0;
  double voxel_mm = 0.0;
  std::uint64_t cubes = 0;  ///< estimated brick-size cubes that the surface crosses: as many bricks
  render::SurfaceDecision surface;
};

struct BrickBuildOptions;
/// Options of bricks by what was measured.
[[nodiscard]] BrickBuildOptions brick_options(const SplineSdfDecision& measured,
                                              const SplineSdfOptions& build);

/// O(n), parallel. Errors: no stiffness.
[[nodiscard]] Result<SplineSdfDecision> decide_spline_sdf(const render::ModelInput& input,
                                                          const SplineSdfOptions& build,
                                                          const render::PrepareContext& context);

/// Describes the decision in words.
void describe_spline_sdf(const render::ModelInput& input, const SplineSdfOptions& build,
                         const SplineSdfDecision& decision, render::Features felt,
                         render::ModelDecisions& out);

/// The bricks and findings of the build. Immutable and shared.
struct SplineSdf {
  BrickGrid grid;
  double spacing_mm = 0.0;
  double noise_mm = 0.0;
  std::uint64_t cubes = 0;  ///< SplineSdfDecision::cubes
  std::size_t patches = 0;
  std::size_t isolated_points = 0;  ///< points that stand alone
};

/// Corners of a brick's cells.
inline constexpr int kBrickCorners = kBrickCells + 1;
inline constexpr int kBrickCornerCount = kBrickCorners * kBrickCorners * kBrickCorners;
using CornerProperties = std::array<render::PointSurface, kBrickCornerCount>;

struct SplineSdfBody {
  std::shared_ptr<const SplineSdf> smooth;
  render::ModelPose pose;
  render::SurfaceField surface;               ///< by_point is empty: see corners
  LargePageVector<CornerProperties> corners;  ///< one per brick if properties vary, else empty

  [[nodiscard]] SplineSdfDecision decided() const {
    return {smooth->spacing_mm, smooth->noise_mm, smooth->grid.voxel_mm, smooth->cubes, surface};
  }
};

/// The surface of a cloud, from the context's store if it has one. O(n), parallel.
[[nodiscard]] Result<std::shared_ptr<const SplineSdf>> build_spline_sdf(const cloud::Cloud& cloud,
                                                                        const SplineSdfOptions& build,
                                                                        const render::PrepareContext& context,
                                                                        render::PrepareReport& report);

/// Prepares one model; takes bricks from the context's store if it has one. Errors: no stiffness.
[[nodiscard]] Result<SplineSdfBody> build_spline_sdf_body(const render::ModelInput& input,
                                                          const SplineSdfOptions& build,
                                                          const render::PrepareContext& context,
                                                          render::PrepareReport& report);

}  // namespace palpate::spline_sdf
