#include "toolkit/stars/star_mesh.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/parallel.h"
#include "toolkit/stars/draft.h"
#include "toolkit/stars/fill.h"
#include "toolkit/stars/places.h"
#include "toolkit/stars/turn.h"

namespace palpate::stars {

/// Where sides do not agree, or noise hangs over, the surface is made anew without the points of the place,
/// so many times: what is torn then has no sides.
constexpr int kTornRounds = 3;

class StarMeshBuilder {
 public:
  StarMeshBuilder(const cloud::Cloud& cloud, int threads, const OnStep& on_step)
      : threads_(threads), on_step_(on_step) {
    step("sort");
    Places places = sort_places(cloud, threads);
    mesh_.order_ = std::move(places.order);
    mesh_.origin_mm_ = cloud.origin_mm;
    doubled_ = std::move(places.doubled);
    draft_.point = std::move(places.point);
    draft_.threads = threads;
  }

  StarMesh build() {
    StarCounts& counts = mesh_.counts_;
    step("neighbours");
    find_near(draft_, doubled_);
    step("stars");
    make_stars(draft_);
    step("mend");
    mend_stars(draft_);
    step("fill");
    for (std::size_t i = 0; i < draft_.size(); ++i) {
      counts.agreed_points += draft_.star[i].closed_and_agreed();
      counts.welded += draft_.welded[i];
    }
    const FillReport filled = fill_gaps(draft_);
    counts.voted = filled.voted;
    counts.filled = filled.filled;
    step("sides");
    pieces_ = turn_stars(draft_);
    for (int round = 0; round < kTornRounds; ++round) {
      std::vector<std::array<std::uint32_t, 3>> wrong = overhanging(draft_);
      wrong.insert(wrong.end(), pieces_.torn.begin(), pieces_.torn.end());
      if (wrong.empty()) break;
      counts.filled += fill_without(draft_, corners_of(wrong));
      pieces_ = turn_stars(draft_);
    }
    counts.torn = pieces_.torn.size();
    counts.pieces = pieces_.closed.size();
    step("store");
    store();
    return std::move(mesh_);
  }

 private:
  void step(std::string_view name) const {
    if (on_step_) on_step_(name);
  }
  /// Ascending, each once.
  static std::vector<std::uint32_t> corners_of(const std::vector<std::array<std::uint32_t, 3>>& triangles) {
    std::vector<std::uint32_t> points;
    for (const auto& t : triangles) points.insert(points.end(), t.begin(), t.end());
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end()), points.end());
    return points;
  }
  void store() {
    const std::size_t n = draft_.size();
    StarCounts& counts = mesh_.counts_;
    std::vector<std::uint32_t> closed_number(pieces_.closed.size(), 0);
    for (std::size_t p = 0; p < pieces_.closed.size(); ++p)
      if (pieces_.closed[p] != 0) closed_number[p] = static_cast<std::uint32_t>(counts.closed_pieces++);
    std::vector<std::uint32_t> long_at(n, 0);
    std::uint32_t long_size = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const Star& star = draft_.star[i];
      counts.triangles += star.sectors();
      counts.unused += static_cast<std::uint64_t>(star.sectors() == 0 && draft_.welded[i] == 0);
      counts.open_points += static_cast<std::uint64_t>(star.sectors() > 0 && star.open != 0);
      if (star.size > kShortRing) {
        long_at[i] = long_size;
        long_size += star.size;
      }
    }
    counts.triangles /= 3;
    mesh_.points_.resize(n);
    mesh_.rings_.resize(n);
    mesh_.long_rings_.resize(long_size);
    if (counts.closed_pieces > 1) mesh_.closed_piece_of_.assign(n, 0);
    parallel_chunks(n, kPointsPerChunk, threads_, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const Star& star = draft_.star[i];
        const bool closed = pieces_.of[i] != kNoPoint && pieces_.closed[pieces_.of[i]] != 0;
        std::uint32_t info = closed ? StarMesh::kClosed : 0;
        auto& row = mesh_.rings_[i];
        if (star.size > kShortRing) {
          info |= StarMesh::kLong;
          std::copy_n(star.ring.begin(), star.size, mesh_.long_rings_.begin() + long_at[i]);
          row.fill(static_cast<std::uint32_t>(i));
          row[0] = long_at[i];
          row[1] = star.size;
          row[2] = star.open;
        } else {
          info |= star.size | (star.open << StarMesh::kOpenShift);
          row.fill(static_cast<std::uint32_t>(i));
          std::copy_n(star.ring.begin(), star.size, row.begin());
        }
        mesh_.points_[i] = {draft_.point[i].x_mm, draft_.point[i].y_mm, draft_.point[i].z_mm, info};
        if (closed && !mesh_.closed_piece_of_.empty())
          mesh_.closed_piece_of_[i] = closed_number[pieces_.of[i]];
      }
    });
  }

  int threads_;
  const OnStep& on_step_;
  std::vector<std::uint8_t> doubled_;
  Draft draft_;
  Pieces pieces_;
  StarMesh mesh_;
};

StarMesh StarMesh::build(const cloud::Cloud& cloud, int threads, const OnStep& on_step) {
  return StarMeshBuilder(cloud, threads, on_step).build();
}

std::size_t StarMesh::bytes() const noexcept {
  return points_.capacity() * sizeof(StarPoint) + rings_.capacity() * sizeof(rings_[0]) +
         (long_rings_.capacity() + closed_piece_of_.capacity() + order_.capacity()) * sizeof(std::uint32_t);
}

geometry::TriangleMesh StarMesh::as_mesh() const {
  geometry::TriangleMesh mesh;
  mesh.vertices_mm.resize(size());
  for (std::uint32_t i = 0; i < size(); ++i) mesh.vertices_mm[order_[i]] = at(i) + origin_mm_;
  mesh.triangles.reserve(counts_.triangles);
  for (std::uint32_t i = 0; i < size(); ++i)
    for_triangles_of(i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      mesh.triangles.push_back({order_[a], order_[b], order_[c]});
    });
  return mesh;
}

}  // namespace palpate::stars
