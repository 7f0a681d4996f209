// Internal to stars: how a mesh is stored, whoever made its stars.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/stars/draft.h"
#include "toolkit/stars/places.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {

class StarMeshStore {
 public:
  /// Points, rings and what is counted of them; `mesh` has its origin, order and other counts already.
  /// star_of(place): the Star there, its ring by place. closed_of(place): the number of the closed piece that
  /// it is on, or kNoPlace. is_crossed(place): see StarMesh. All are called on many threads.
  template <class StarOf, class ClosedOf, class IsCrossed>
  static void fill(StarMesh& mesh, const std::vector<Placed>& points, StarOf&& star_of, ClosedOf&& closed_of,
                   IsCrossed&& is_crossed, int threads) {
    const std::size_t n = points.size();
    StarCounts& counts = mesh.counts_;
    counts.triangles = counts.unused = counts.open_points = 0;
    std::vector<std::uint32_t> long_at(n, 0);
    std::uint32_t long_size = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const Star& star = star_of(static_cast<std::uint32_t>(i));
      counts.triangles += star.sectors();
      counts.unused += static_cast<std::uint64_t>(star.sectors() == 0);
      counts.open_points += static_cast<std::uint64_t>(star.sectors() > 0 && star.open != 0);
      if (star.size > kShortRing) {
        long_at[i] = long_size;
        long_size += star.size;
      }
    }
    counts.triangles /= 3;
    mesh.points_.resize(n);
    mesh.rings_.resize(n);
    mesh.long_rings_.resize(long_size);
    if (counts.closed_pieces > 1) mesh.closed_piece_of_.assign(n, 0);
    parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const auto place = static_cast<std::uint32_t>(i);
        const Star& star = star_of(place);
        const std::uint32_t closed = closed_of(place);
        std::uint32_t info = closed != kNoPlace ? StarMesh::kClosed : 0;
        if (is_crossed(place)) info |= StarMesh::kCrossed;
        auto& row = mesh.rings_[i];
        row.fill(place);
        if (star.size > kShortRing) {
          info |= StarMesh::kLong;
          std::copy_n(star.ring.begin(), star.size, mesh.long_rings_.begin() + long_at[i]);
          row[0] = long_at[i];
          row[1] = star.size;
          row[2] = star.open;
        } else {
          info |= star.size | (star.open << StarMesh::kOpenShift);
          std::copy_n(star.ring.begin(), star.size, row.begin());
        }
        mesh.points_[i] = {points[i].x_mm, points[i].y_mm, points[i].z_mm, info};
        if (closed != kNoPlace && !mesh.closed_piece_of_.empty()) mesh.closed_piece_of_[i] = closed;
      }
    });
  }
};

}  // namespace palpate::stars
