// Neighbours by Voronoi cells, through CGAL. Section 3.2.2.3 of the thesis names the method and does not run
// it; [51] there renders with it. A target of its own: who links only neighbourhood never sees CGAL.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/result.h>
#include "toolkit/search/neighbour_table.h"

namespace palpate::voronoi {

struct VoronoiReport {
  std::uint64_t places = 0;            ///< distinct positions: cells
  std::uint64_t natural = 0;           ///< pairs of cells that touch
  std::uint64_t more_than_eight = 0;   ///< points
  std::uint64_t fewer_than_eight = 0;  ///< points
};

/// The natural neighbours of a point are those whose Voronoi cells touch its own: the ends of its edges in
/// the 3D Delaunay triangulation, some fifteen on a surface, of which many lie across the body. Kept are the
/// nearest eight, ties by index. Cells that only touch in a corner are decided by CGAL's symbolic
/// perturbation, which depends on the positions alone: the result does not depend on the order of the points
/// but for ties. Points at one place share a cell and are neighbours at distance 0. Flat clouds, lines and
/// single points are fine. O(n) in practice on surfaces, O(n^2) at worst, on one thread (the choice of eight
/// on all); needs about 400 bytes a point meanwhile. An Error where memory runs out.
[[nodiscard]] Result<search::NeighbourTable> voronoi(const cloud::Cloud& cloud, int threads,
                                                     VoronoiReport* report = nullptr);

/// Points whose Voronoi cells touch, both ways: row i is ends[begin[i] .. begin[i + 1]), in CGAL's order.
struct Links {
  std::vector<std::uint32_t> begin, ends;
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t i) const noexcept {
    return {ends.data() + begin[i], begin[i + 1] - begin[i]};
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return (begin.capacity() + ends.capacity()) * sizeof(std::uint32_t);
  }
};

/// All natural neighbours: the edges of the 3D Delaunay triangulation, on which a greedy walk towards a place
/// ends at the point nearest to it. Points must be finite; of several at one place only one is linked. Cost
/// and errors as for voronoi().
[[nodiscard]] Result<Links> natural_links(std::span<const Vec3> points);

}  // namespace palpate::voronoi
