// Fits quadrics as large as the data allows. A fit grows while its centre agrees with every smaller fit
// within a number of standard errors (Lepski's rule). This averages noise over featureless surface and keeps
// small features of clean points.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/spline_sdf/point_interior.h"
#include "toolkit/spline_sdf/point_noise.h"
#include "toolkit/spline_sdf/quadric.h"

namespace palpate::spline_sdf {

struct QuadricPatch {
  Quadric quadric;
  double support = 0.0;      ///< mm from quadric.at along the tangent plane, where its weight ends
  double spacing = 0.0;      ///< of its points, mm
  double sigma = 0.0;        ///< of its points about it, mm
  double noise = 0.0;        ///< of the points around, mm: a lower bound on sigma
  double slope_error = 0.0;  ///< standard error of its normal
  int points = 0;            ///< number of its points
  double trust = 1.0;        ///< weight by accuracy, at most 1
  bool reliable = false;     ///< not made of noise or outliers
  double extent = 0.0;       ///< mm along the tangent plane, where its points end
  DiscOccupancy occupancy;   ///< of its points, over quadric.u and v in shares of `extent`
};

struct PatchFitOptions {
  double detail = 2.0;  ///< standard errors from which a deviation is shape
  const NoiseField& noise;
};

struct FittedPatches {
  std::vector<QuadricPatch> patches;
  std::size_t isolated_points = 0;  ///< points that stand alone
};

/// A patch's weight at squared share x of its support: (1 - x)^3, twice continuously differentiable at its
/// end.
[[nodiscard]] inline double patch_weight(double share_sq) noexcept {
  if (!(share_sq < 1.0)) return 0.0;
  const double rest = 1.0 - share_sq;
  return rest * rest * rest;
}

/// Fits those blocks of points of which one is in `where`. Independent of the number of threads. O(points).
[[nodiscard]] FittedPatches fit_patches(const MortonPoints& points, const PatchFitOptions& rule, int threads,
                                        const geometry::Aabb* where = nullptr);

/// Most patches that a point follows.
inline constexpr std::size_t kPatchesOfPoint = 2;

/// A point's patches, best first, with shares that sum to 1; ends with kNone.
struct PointPatches {
  static constexpr std::uint32_t kNone = 0xffffffffu;
  std::array<std::uint32_t, kPatchesOfPoint> patch{kNone, kNone};
  std::array<float, kPatchesOfPoint> share{};
};

/// Assigns patches to every point: those that it lies on within noise, up to slightly beyond their ends, so a
/// face continues to its edge. Independent of the number of threads. O(patches x points of each).
[[nodiscard]] std::vector<PointPatches> assign_patches(const MortonPoints& points,
                                                       std::span<const QuadricPatch> patches, int threads);

}  // namespace palpate::spline_sdf
