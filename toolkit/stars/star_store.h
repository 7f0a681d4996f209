// Internal to stars: how a mesh is stored, whoever made its stars.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
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
    // Words of each ring that lies apart, then where it begins.
    std::vector<std::uint32_t> apart_at(n, 0);
    std::vector<StarCounts> counted((n + kPointsPerChunk - 1) / kPointsPerChunk);
    parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
      StarCounts& counts = counted[begin / kPointsPerChunk];
      for (std::size_t i = begin; i < end; ++i) {
        const auto place = static_cast<std::uint32_t>(i);
        const Star& star = star_of(place);
        counts.triangles += star.sectors();
        counts.unused += static_cast<std::uint64_t>(star.sectors() == 0);
        counts.open_points += static_cast<std::uint64_t>(star.sectors() > 0 && star.open != 0);
        if (!fits_beside(star, place)) apart_at[i] = StarMesh::kLongHead + star.size;
      }
    });
    StarCounts& counts = mesh.counts_;
    counts.triangles = counts.unused = counts.open_points = 0;
    for (const StarCounts& part : counted) {
      counts.triangles += part.triangles;
      counts.unused += part.unused;
      counts.open_points += part.open_points;
    }
    counts.triangles /= 3;
    std::uint32_t apart = 0;
    for (std::uint32_t& words : apart_at) apart += std::exchange(words, words == 0 ? kNoPlace : apart);
    mesh.places_.resize(n);
    mesh.long_rings_.resize(apart);
    if (counts.closed_pieces > 1) mesh.closed_piece_of_.assign(n, 0);
    parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const auto place = static_cast<std::uint32_t>(i);
        const Star& star = star_of(place);
        const std::uint32_t closed = closed_of(place);
        StarPlace& at = mesh.places_[i];
        at = {points[i].x_mm, points[i].y_mm, points[i].z_mm, 0, {}};
        if (closed != kNoPlace) at.info |= StarMesh::kClosed;
        if (is_crossed(place)) at.info |= StarMesh::kCrossed;
        if (apart_at[i] != kNoPlace) {
          at.info |= StarMesh::kLong | StarMesh::kElsewhere;
          at.set_apart(apart_at[i]);
          const auto row = mesh.long_rings_.begin() + apart_at[i];
          row[0] = star.size;
          row[1] = star.open;
          std::copy_n(star.ring.begin(), star.size, row + StarMesh::kLongHead);
        } else {
          at.info |= star.size | (star.open << StarMesh::kOpenShift);
          for (std::uint32_t k = 0; k < star.size; ++k)
            at.near[k] = static_cast<std::int16_t>(static_cast<std::int32_t>(star.ring[k] - place));
        }
        if (closed != kNoPlace && !mesh.closed_piece_of_.empty()) mesh.closed_piece_of_[i] = closed;
      }
    });
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
