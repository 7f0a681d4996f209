// Cuts four Voronoi cells at a time, each by its own neighbours, with AVX2: a cut depends on the last one of
// its cell, but not on other cells. Internal to local_delaunay.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include <palpate/vec.h>
#include "toolkit/local_delaunay/planar_voronoi_cell.h"
#include "toolkit/local_delaunay/spatial_sort.h"

namespace palpate::local_delaunay {

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
