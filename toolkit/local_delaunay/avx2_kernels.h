// AVX2 kernels: four points or Voronoi cells at a time.
//
// Neighbours are computed for four points at a time, and four Voronoi cells are cut at a time, each by its
// own neighbours: a cut depends on the last one of its cell, but not on other cells. Internal to
// local_delaunay.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include <palpate/vec.h>
#include "toolkit/local_delaunay/planar_voronoi_cell.h"
#include "toolkit/local_delaunay/spatial_sort.h"
#include "toolkit/surface/smallest_eigenvector.h"

namespace palpate::local_delaunay {

/// Neighbours in a plane fit.
inline constexpr std::size_t kPlaneNear = 12;

/// Neighbours that points_between() tests.
inline constexpr unsigned kNearAtOnce = 16;

struct PlaneBatch {
  std::array<surface::SymmetricMatrix3, 4> covariance;  ///< times the number of points, see Moments
  std::array<Vec3, 4> normal;                           ///< as surface::smallest_eigenvector()
  std::array<bool, 4> has_normal;                       ///< smallest_eigenvector()'s return values
};

/// Fits four places with their kPlaneNear nearest; bit-identical to the scalar form. Requires has_avx2().
void fit_four_planes(const SortedPoint* point, const std::array<std::uint32_t, 4>& place,
                     const std::array<const std::uint32_t*, 4>& near, PlaneBatch& out) noexcept;

/// Bit k: near[k], of kNearAtOnce places, is farther from p than sqrt(beyond_sq) and at most sqrt(within_sq).
/// The same with and without vector code.
[[nodiscard]] unsigned points_between(const SortedPoint* point, const std::uint32_t* near, const Vec3& p,
                                      double beyond_sq, double within_sq) noexcept;

/// A point and the layout of its nearest (PlanarNeighbours, with distances in space).
struct PlanarFrame {
  Vec3 at = Vec3::Zero();
  Vec3 normal = Vec3::Zero(), e = Vec3::Zero(), f = Vec3::Zero();
  double weight = 0.0;
  double steepest_sq = 1.0;  ///< squared limit: a steeper neighbour is left out
  const std::uint32_t* near = nullptr;
  std::size_t count = 0;  ///< of `near`, at most sixteen
};

/// Cuts each cell by its neighbours in turn, bit-identical to PlanarNeighbours::cut() when it leaves out
/// none. Returns the number cut per cell: fewer if a cell exceeds eight corners, and the caller cuts the
/// rest; none without AVX2.
std::array<std::size_t, 4> cut_four(const SortedPoint* point, const std::array<PlanarFrame, 4>& frames,
                                    std::array<PlanarVoronoiCell, 4>& cells) noexcept;

}  // namespace palpate::local_delaunay
