// What `cloud-smooth` prepares of a model: its bricks, and where properties vary their values at the bricks'
// nodes.
#pragma once

#include <array>
#include <memory>
#include <optional>

#include "toolkit/core/large_pages.h"
#include "toolkit/core/result.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_field.h"
#include "toolkit/smooth/brick_grid.h"

namespace palpate::render {

/// The options of a build.
struct SmoothBuild {
  double detail = 2.0;           ///< standard errors before a deviation counts as shape
  double voxel_spacings = 1.75;  ///< edge of a cell, in spacings
  bool both_sides = false;       ///< pieces with holes that enclose a volume are felt from both sides
};

/// What is decided from the points before anything is built.
struct SmoothDecision {
  double spacing_mm = 0.0;
  double noise_mm = 0.0;
  double voxel_mm = 0.0;
  std::uint64_t cubes = 0;  ///< of a brick's size, that the surface goes through, reckoned: as many bricks
  SurfaceDecision surface;
};

/// O(n), parallel. Errors: no stiffness.
[[nodiscard]] Result<SmoothDecision> decide_smooth(const ModelInput& input, const SmoothBuild& build,
                                                   const PrepareContext& context);

/// In words.
void say_smooth(const ModelInput& input, const SmoothBuild& build, const SmoothDecision& decision,
                Features felt, ModelDecisions& out);

/// The bricks and what was found on the way. Immutable and shared.
struct SmoothSurface {
  BrickGrid grid;
  double spacing_mm = 0.0;
  double noise_mm = 0.0;
  std::uint64_t cubes = 0;  ///< SmoothDecision::cubes
  std::size_t patches = 0;
  std::size_t left_out = 0;  ///< points that stand alone
};

/// Corners of a brick's cells.
inline constexpr int kBrickCorners = kBrickCells + 1;
inline constexpr int kBrickCornerCount = kBrickCorners * kBrickCorners * kBrickCorners;
using CornerProperties = std::array<PlaceSurface, kBrickCornerCount>;

struct SmoothBody {
  std::shared_ptr<const SmoothSurface> smooth;
  ModelPose pose;
  SurfaceField surface;                   ///< of_place is empty: see corners
  LargeVector<CornerProperties> corners;  ///< a brick each where properties vary, else empty

  [[nodiscard]] SmoothDecision decided() const {
    return {smooth->spacing_mm, smooth->noise_mm, smooth->grid.voxel_mm, smooth->cubes, surface};
  }
};

/// Prepares one model; its bricks come from the context's store where it has one. Errors: no stiffness.
[[nodiscard]] Result<SmoothBody> build_smooth_body(const ModelInput& input, const SmoothBuild& build,
                                                   const PrepareContext& context, PrepareReport& report);

}  // namespace palpate::render
