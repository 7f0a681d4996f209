// Builds a mesh's storage from any source of stars. Internal to local_delaunay.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/local_delaunay/candidate_triangulation.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"
#include "toolkit/local_delaunay/spatial_sort.h"

namespace palpate::local_delaunay {

class LocalDelaunayMeshStorage {
 public:
  /// Stores points, rings and their counts; `mesh` already has origin, order and other counts.
  /// star_of(place): its Star, ring by place, asked once. closed_of(place): its closed piece, or kNoPlace.
  /// is_crossed(place): see LocalDelaunayMesh. All are called from many threads.
  template <class StarOf, class ClosedOf, class IsCrossed>
  static void fill(LocalDelaunayMesh& mesh, const UninitializedVector<SortedPoint>& points, StarOf&& star_of,
                   ClosedOf&& closed_of, IsCrossed&& is_crossed, int threads) {
    const std::size_t n = points.size();
    struct Long {
      std::uint32_t place;
      Star star;
    };
    struct Chunk {
      MeshStatistics counts;
      std::vector<Long> apart;
    };
    MeshStatistics& counts = mesh.counts_;
    mesh.places_.resize(n);
    if (counts.closed_components > 1) mesh.closed_component_of_.assign(n, 0);
    const auto store = [&](std::size_t i, Chunk& chunk) {
      const auto place = static_cast<std::uint32_t>(i);
      const Star& star = star_of(place);
      chunk.counts.triangles += star.sectors();
      chunk.counts.unused += static_cast<std::uint64_t>(star.sectors() == 0);
      chunk.counts.open_points += static_cast<std::uint64_t>(star.sectors() > 0 && star.open != 0);
      const std::uint32_t closed = closed_of(place);
      PackedVertex& at = mesh.places_[i];
      at = {points[i].x_mm, points[i].y_mm, points[i].z_mm, 0, {}};
      if (closed != kNoPlace) at.info |= LocalDelaunayMesh::kClosed;
      if (is_crossed(place)) at.info |= LocalDelaunayMesh::kCrossed;
      if (fits_beside(star, place)) {
        at.info |= star.size | (star.open << LocalDelaunayMesh::kOpenShift);
        for (std::uint32_t k = 0; k < star.size; ++k)
          at.near[k] = static_cast<std::int16_t>(static_cast<std::int32_t>(star.ring[k] - place));
      } else {
        at.info |= LocalDelaunayMesh::kLong | LocalDelaunayMesh::kRingStoredApart;
        chunk.apart.push_back({place, star});
      }
      if (closed != kNoPlace && !mesh.closed_component_of_.empty()) mesh.closed_component_of_[i] = closed;
    };
    counts.triangles = counts.unused = counts.open_points = 0;
    for (const auto& chunk : parallel_parts<Chunk>(n, kPointsPerChunk, threads, store)) {
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
    if (star.size > kInlineRing) return false;
    for (std::uint32_t k = 0; k < star.size; ++k)
      if (std::max(star.ring[k], place) - std::min(star.ring[k], place) > kMaxPlaceOffset) return false;
    return true;
  }
};

}  // namespace palpate::local_delaunay
