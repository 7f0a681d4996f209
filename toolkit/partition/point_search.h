// Points around any place: the nearest one, those within a radius, those of the cells about. One search for
// preparation and scores (PointSearch), and for renderers that keep points by place (visit_within).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/partition/cell_walk.h"
#include "toolkit/partition/partition.h"
#include "toolkit/partition/uniform_grid.h"

namespace palpate::partition {

/// Calls visit(place, distance_sq) for every point within `radius_mm` of `at`, in the partition's order;
/// position(place) tells where a point is. Allocates nothing. O(points in the leaves that the cube around it
/// touches).
template <Partition P, class Position, class Visit>
void visit_within(const P& points, const Position& position, const Vec3& at, double radius_mm,
                  Visit&& visit) {
  const double most_sq = radius_mm * radius_mm;
  visit_ranges(points, at, at, Vec3::Constant(radius_mm), [&](PlaceRange range) {
    for (std::uint32_t place = range.begin; place < range.end; ++place) {
      const double sq = (position(place) - at).squaredNorm();
      if (sq <= most_sq) visit(place, sq);
    }
    return true;
  });
}

/// A cloud with a grid over it. Keeps a reference to the cloud, which must not be empty. Queries allocate
/// nothing and may come from several threads; their work has no bound that a frame could rely on.
class PointSearch {
 public:
  /// Cells of some two points each, for nearest(). O(n log n).
  explicit PointSearch(const cloud::Cloud& cloud, int threads = 1);
  /// Cells of a length that suits the questions. O(n log n).
  PointSearch(const cloud::Cloud& cloud, double cell_mm, int threads = 1);

  /// Index of the point nearest to `p_mm` (finite, in the cloud's frame), ties by index. O(points nearby).
  [[nodiscard]] std::size_t nearest(const Vec3& p_mm) const;

  /// Calls visit(local point) for the points of the 27 cells around `p_mm`, at most `most`, in the order of
  /// (cell, index). `p_mm` is relative to the cloud's origin, and moved to the grid's low corner where it
  /// lies below.
  template <class Visit>
  void around(const Vec3& p_mm, std::size_t most, const Visit& visit) const {
    const Cell middle = grid_.cell_of(p_mm.cwiseMax(grid_.lattice().low_mm));
    for (std::int64_t z = middle.z - 1; z <= middle.z + 1; ++z)
      for (std::int64_t y = middle.y - 1; y <= middle.y + 1; ++y)
        for (std::int64_t x = middle.x - 1; x <= middle.x + 1; ++x)
          for (const std::uint32_t i : points_of({x, y, z})) {
            if (most-- == 0) return;
            visit(cloud_.local_mm(i));
          }
  }

 private:
  PointSearch(const cloud::Cloud& cloud, const geometry::Aabb& local_box, double cell_mm, int threads);
  [[nodiscard]] std::span<const std::uint32_t> points_of(const Cell& cell) const noexcept {
    const PlaceRange found = grid_.find(cell);
    return std::span(order_).subspan(found.begin, found.end - found.begin);
  }

  const cloud::Cloud& cloud_;
  geometry::Aabb local_box_;
  UniformGrid grid_;
  std::vector<std::uint32_t> order_;  ///< cloud index by place; within a cell by index
};

}  // namespace palpate::partition
