#include "toolkit/stars/star_mesh.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "toolkit/core/parallel.h"
#include "toolkit/stars/draft.h"
#include "toolkit/stars/fill.h"
#include "toolkit/stars/places.h"
#include "toolkit/stars/raster_stars.h"
#include "toolkit/stars/star_store.h"
#include "toolkit/stars/turn.h"

namespace palpate::stars {

/// Where sides do not agree, or noise hangs over, the surface is made anew without the points of the place,
/// so many times: what is torn then has no sides.
constexpr int kTornRounds = 3;

class StarMeshBuilder {
 public:
  StarMeshBuilder(const cloud::Cloud& cloud, int threads, const OnStep& on_step, const StarBuild& asked)
      : threads_(threads), on_step_(on_step) {
    draft_.threads = threads;
    draft_.both_sides = asked.both_sides;
    if (asked.raster) {
      step("raster");
      raster_ = RasterStars::of(cloud, threads);
    }
    step("sort");
    Places places = raster_ ? raster_places(cloud, raster_->grid(), threads) : sort_places(cloud, threads);
    mesh_.order_ = std::move(places.order);
    mesh_.origin_mm_ = cloud.origin_mm;
    doubled_ = std::move(places.doubled);
    draft_.point = std::move(places.point);
    if (raster_) raster_->set_order(mesh_.order_, threads);
  }

  StarMesh build() {
    if (raster_ && raster_->is_whole()) {
      store_raster();
    } else {
      make();
      settle();
      store();
    }
    return std::move(mesh_);
  }

 private:
  /// Every point's star, and where they agree.
  void make() {
    if (raster_) {
      step("stars");
      mesh_.counts_.raster_points = raster_->fill(draft_);
    } else {
      step("neighbours");
      find_near(draft_, doubled_);
      step("stars");
      make_stars(draft_);
    }
    step("mend");
    mend_stars(draft_);
  }
  /// What they do not agree on, and one side for each piece.
  void settle() {
    StarCounts& counts = mesh_.counts_;
    step("fill");
    struct Counted {
      std::uint64_t agreed = 0, welded = 0;
    };
    std::vector<Counted> parts((draft_.size() + kPointsPerChunk - 1) / kPointsPerChunk);
    parallel_chunks(draft_.size(), kPointsPerChunk, threads_, [&](std::size_t begin, std::size_t end) {
      Counted& part = parts[begin / kPointsPerChunk];
      for (std::size_t i = begin; i < end; ++i) {
        part.agreed += static_cast<std::uint64_t>(draft_.star[i].closed_and_agreed());
        part.welded += draft_.welded[i];
      }
    });
    for (const Counted& part : parts) {
      counts.agreed_points += part.agreed;
      counts.welded += part.welded;
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
    counts.least_enclosed = pieces_.least_enclosed;
    step("store");
  }
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
    StarCounts& counts = mesh_.counts_;
    std::vector<std::uint32_t> closed_number(pieces_.closed.size(), kNoPlace);
    for (std::size_t p = 0; p < pieces_.closed.size(); ++p)
      if (pieces_.closed[p] != Enclosure::kOpen) {
        closed_number[p] = static_cast<std::uint32_t>(counts.closed_pieces++);
        mesh_.has_holes_.push_back(pieces_.closed[p] == Enclosure::kWithHoles);
        counts.pieces_with_holes += mesh_.has_holes_.back();
      }
    StarMeshStore::fill(
        mesh_, draft_.point, [this](std::uint32_t i) -> const Star& { return draft_.star[i]; },
        [&](std::uint32_t i) { return pieces_.of[i] == kNoPoint ? kNoPlace : closed_number[pieces_.of[i]]; },
        [this](std::uint32_t i) { return draft_.crossed[i] != 0; }, threads_);
    counts.unused -= counts.welded;
  }

  /// One piece, whose stars are made as they are stored.
  void store_raster() {
    StarCounts& counts = mesh_.counts_;
    step("sides");
    const RasterStars::Side side = raster_->side_of_whole(draft_);
    const bool is_closed = side.enclosure != Enclosure::kOpen;
    counts.raster_points = draft_.size();
    counts.pieces = 1;
    counts.closed_pieces = is_closed ? 1 : 0;
    counts.pieces_with_holes = side.enclosure == Enclosure::kWithHoles ? 1 : 0;
    counts.least_enclosed = side.least_enclosed;
    if (is_closed) mesh_.has_holes_.push_back(side.enclosure == Enclosure::kWithHoles);
    step("store");
    const auto star_of = [&](std::uint32_t place) {
      Star star = raster_->star(place);
      if (side.inward) reverse(star);
      return star;
    };
    StarMeshStore::fill(
        mesh_, draft_.point, star_of, [&](std::uint32_t) { return is_closed ? 0u : kNoPlace; },
        [](std::uint32_t) { return false; }, threads_);
    counts.agreed_points = draft_.size() - counts.open_points;
  }

  int threads_;
  const OnStep& on_step_;
  std::optional<RasterStars> raster_;
  std::vector<std::uint8_t> doubled_;
  Draft draft_;
  Pieces pieces_;
  StarMesh mesh_;
};

StarMesh StarMesh::build(const cloud::Cloud& cloud, int threads, const OnStep& on_step,
                         const StarBuild& asked) {
  return StarMeshBuilder(cloud, threads, on_step, asked).build();
}

std::size_t StarMesh::bytes() const noexcept {
  return places_.capacity() * sizeof(StarPlace) + wide_.capacity() * sizeof(wide_[0]) +
         (long_rings_.capacity() + closed_piece_of_.capacity() + order_.capacity()) * sizeof(std::uint32_t) +
         has_holes_.capacity();
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
