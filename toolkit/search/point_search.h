// Point queries: nearest, within a radius, in surrounding cells. PointSearch serves preparation and scores;
// visit_within serves renderers.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include "toolkit/search/partition.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::search {

/// Calls visit(place, distance_sq) for every point within `radius_mm` of `at`, in the partition's order;
/// position(place) gives a point. Allocates nothing. O(points in the leaves that the surrounding cube
/// touches).
template <Partition P, class Position, class Visit>
void visit_within(const P& points, const Position& position, const Vec3& at, double radius_mm,
                  Visit&& visit) {
  const double most_sq = radius_mm * radius_mm;
  visit_segment_ranges(points, at, at, Vec3::Constant(radius_mm), [&](IndexRange range) {
    for (std::uint32_t place = range.begin; place < range.end; ++place) {
      const double sq = (position(place) - at).squaredNorm();
      if (sq <= most_sq) visit(place, sq);
    }
    return true;
  });
}

/// A grid over a cloud, which must not be empty and is kept by reference. Queries allocate nothing and are
/// thread-safe; their work is unbounded, so frames must not use them.
class PointSearch {
 public:
  /// Cells of about two points, for nearest(). O(n log n).
  explicit PointSearch(const cloud::Cloud& cloud, int threads = 1);
  /// Cells of a given size. O(n log n).
  PointSearch(const cloud::Cloud& cloud, double cell_mm, int threads = 1);

  /// Index of the point nearest to `p_mm` (finite, in the cloud's frame), ties by index. O(points nearby).
  [[nodiscard]] std::size_t nearest(const Vec3& p_mm) const;

  /// Calls visit(local point) for at most `most` points of the 27 cells around `p_mm`, ordered by (cell,
  /// index). `p_mm` is relative to the cloud's origin and clamped to the grid's low corner.
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
    const IndexRange found = grid_.find(cell);
    return std::span(order_).subspan(found.begin, found.end - found.begin);
  }

  const cloud::Cloud& cloud_;
  geometry::Aabb local_box_;
  UniformGrid grid_;
  std::vector<std::uint32_t> order_;  ///< cloud index per place; by index within a cell
};

}  // namespace palpate::search
