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
  /// star_of(place): the Star there, its ring by place; asked once. closed_of(place): the number of the
  /// closed piece that it is on, or kNoPlace. is_crossed(place): see StarMesh. All are called on many
  /// threads.
  template <class StarOf, class ClosedOf, class IsCrossed>
  static void fill(StarMesh& mesh, const UnsetVector<Placed>& points, StarOf&& star_of, ClosedOf&& closed_of,
                   IsCrossed&& is_crossed, int threads) {
    const std::size_t n = points.size();
    struct Long {
      std::uint32_t place;
      Star star;
    };
    struct Chunk {
      StarCounts counts;
      std::vector<Long> apart;
    };
    std::vector<Chunk> chunks((n + kPointsPerChunk - 1) / kPointsPerChunk);
    StarCounts& counts = mesh.counts_;
    mesh.places_.resize(n);
    if (counts.closed_pieces > 1) mesh.closed_piece_of_.assign(n, 0);
    parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
      Chunk& chunk = chunks[begin / kPointsPerChunk];
      for (std::size_t i = begin; i < end; ++i) {
        const auto place = static_cast<std::uint32_t>(i);
        const Star& star = star_of(place);
        chunk.counts.triangles += star.sectors();
        chunk.counts.unused += static_cast<std::uint64_t>(star.sectors() == 0);
        chunk.counts.open_points += static_cast<std::uint64_t>(star.sectors() > 0 && star.open != 0);
        const std::uint32_t closed = closed_of(place);
        StarPlace& at = mesh.places_[i];
        at = {points[i].x_mm, points[i].y_mm, points[i].z_mm, 0, {}};
        if (closed != kNoPlace) at.info |= StarMesh::kClosed;
        if (is_crossed(place)) at.info |= StarMesh::kCrossed;
        if (fits_beside(star, place)) {
          at.info |= star.size | (star.open << StarMesh::kOpenShift);
          for (std::uint32_t k = 0; k < star.size; ++k)
            at.near[k] = static_cast<std::int16_t>(static_cast<std::int32_t>(star.ring[k] - place));
        } else {
          at.info |= StarMesh::kLong | StarMesh::kElsewhere;
          chunk.apart.push_back({place, star});
        }
        if (closed != kNoPlace && !mesh.closed_piece_of_.empty()) mesh.closed_piece_of_[i] = closed;
      }
    });
    counts.triangles = counts.unused = counts.open_points = 0;
    for (const Chunk& chunk : chunks) {
      counts.triangles += chunk.counts.triangles;
      counts.unused += chunk.counts.unused;
      counts.open_points += chunk.counts.open_points;
      for (const Long& one : chunk.apart) {
        mesh.places_[one.place].set_apart(static_cast<std::uint32_t>(mesh.long_rings_.size()));
        mesh.long_rings_.insert(mesh.long_rings_.end(), {one.star.size, one.star.open});
        mesh.long_rings_.insert(mesh.long_rings_.end(), one.star.ring.begin(),
                                one.star.ring.begin() + one.star.size);
      }
    }
    counts.triangles /= 3;
    mesh.long_rings_.shrink_to_fit();
  }

 private:
  [[nodiscard]] static bool fits_beside(const Star& star, std::uint32_t place) noexcept {
    if (star.size > kShortRing) return false;
    for (std::uint32_t k = 0; k < star.size; ++k)
      if (std::max(star.ring[k], place) - std::min(star.ring[k], place) > kMostNear) return false;
    return true;
  }
};

}  // namespace palpate::stars
