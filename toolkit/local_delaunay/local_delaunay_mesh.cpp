#include "toolkit/local_delaunay/local_delaunay_mesh.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"
#include "toolkit/local_delaunay/candidate_triangulation.h"
#include "toolkit/local_delaunay/raster_stars.h"
#include "toolkit/local_delaunay/spatial_sort.h"

namespace palpate::local_delaunay {

/// Rounds of rebuilding where sides disagree or noise overhangs, each without the points there. Tears that
/// remain have no sides.
constexpr int kTornRounds = 3;

class LocalDelaunayMeshBuilder {
 public:
  LocalDelaunayMeshBuilder(const cloud::Cloud& cloud, int threads, const OnStep& on_step,
                           const BuildOptions& asked)
      : threads_(threads), on_step_(on_step) {
    candidate_.threads = threads;
    candidate_.both_sides = asked.both_sides;
    if (asked.raster) {
      step("raster");
      raster_ = RasterStars::of(cloud, threads);
    }
    step("sort");
    SortedPoints places =
        raster_ ? spatial_sort_raster(cloud, raster_->grid(), threads) : spatial_sort(cloud, threads);
    mesh_.order_ = std::move(places.order);
    mesh_.origin_mm_ = cloud.origin_mm;
    doubled_ = std::move(places.duplicate);
    candidate_.point = std::move(places.point);
    if (raster_) raster_->set_order(mesh_.order_, threads);
  }

  LocalDelaunayMesh build() {
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
  /// Makes every point's star and marks agreement.
  void make() {
    if (raster_) {
      step("stars");
      mesh_.counts_.raster_points = raster_->fill(candidate_);
      raster_.reset();
    } else {
      step("neighbours");
      find_nearest(candidate_, doubled_);
      step("stars");
      make_stars(candidate_);
    }
    release_memory(doubled_);
    step("mend");
    repair_stars(candidate_);
    keep_farthest(candidate_);
    release_memory(candidate_.sparse);
  }
  /// Resolves disagreement and orients each piece.
  void settle() {
    MeshStatistics& counts = mesh_.counts_;
    step("fill");
    struct Counted {
      std::uint64_t agreed = 0, welded = 0;
    };
    const auto count = [this](std::size_t i, Counted& part) {
      part.agreed += static_cast<std::uint64_t>(candidate_.star[i].closed_and_agreed());
      part.welded += candidate_.welded[i];
    };
    for (const auto& part : parallel_parts<Counted>(candidate_.size(), kPointsPerChunk, threads_, count)) {
      counts.agreed_points += part.agreed;
      counts.welded += part.welded;
    }
    const HoleFillReport filled = fill_holes(candidate_);
    counts.voted = filled.voted;
    counts.filled = filled.filled;
    step("sides");
    pieces_ = orient_stars(candidate_);
    for (int round = 0; round < kTornRounds; ++round) {
      std::vector<std::array<std::uint32_t, 3>> wrong = overhanging(candidate_);
      wrong.insert(wrong.end(), pieces_.unorientable.begin(), pieces_.unorientable.end());
      if (wrong.empty()) break;
      counts.filled += refill_without(candidate_, corners_of(wrong));
      pieces_ = orient_stars(candidate_);
    }
    counts.unorientable = pieces_.unorientable.size();
    counts.pieces = pieces_.closed.size();
    counts.min_enclosed = pieces_.min_enclosed;
    release_memory(candidate_.farthest);
    release_memory(candidate_.normal);
    for (auto* marks : {&candidate_.welded, &candidate_.rough, &candidate_.doubtful}) release_memory(*marks);
    step("store");
  }
  void step(std::string_view name) const {
    if (on_step_) on_step_(name);
  }
  /// Ascending, without repetition.
  static std::vector<std::uint32_t> corners_of(const std::vector<std::array<std::uint32_t, 3>>& triangles) {
    std::vector<std::uint32_t> points;
    for (const auto& t : triangles) points.insert(points.end(), t.begin(), t.end());
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end()), points.end());
    return points;
  }
  void store() {
    MeshStatistics& counts = mesh_.counts_;
    std::vector<std::uint32_t> closed_number(pieces_.closed.size(), kNoPlace);
    for (std::size_t p = 0; p < pieces_.closed.size(); ++p)
      if (pieces_.closed[p] != VolumeEnclosure::kOpen) {
        closed_number[p] = static_cast<std::uint32_t>(counts.closed_components++);
        mesh_.has_holes_.push_back(pieces_.closed[p] == VolumeEnclosure::kWithHoles);
        counts.components_with_holes += mesh_.has_holes_.back();
      }
    LocalDelaunayMeshStorage::fill(
        mesh_, candidate_.point, [this](std::uint32_t i) { return candidate_.star[i]; },
        [&](std::uint32_t i) { return pieces_.of[i] == kNoPoint ? kNoPlace : closed_number[pieces_.of[i]]; },
        [this](std::uint32_t i) { return candidate_.crossed[i] != 0; }, threads_);
    counts.unused -= counts.welded;
  }

  /// For one piece; makes stars as they are stored.
  void store_raster() {
    MeshStatistics& counts = mesh_.counts_;
    step("sides");
    const RasterStars::Side side = raster_->side_of_whole(candidate_);
    const bool is_closed = side.enclosure != VolumeEnclosure::kOpen;
    counts.raster_points = candidate_.size();
    counts.pieces = 1;
    counts.closed_components = is_closed ? 1 : 0;
    counts.components_with_holes = side.enclosure == VolumeEnclosure::kWithHoles ? 1 : 0;
    counts.min_enclosed = side.min_enclosed;
    if (is_closed) mesh_.has_holes_.push_back(side.enclosure == VolumeEnclosure::kWithHoles);
    step("store");
    const auto star_of = [&](std::uint32_t place) {
      Star star = raster_->star(place);
      if (side.inward) reverse(star);
      return star;
    };
    LocalDelaunayMeshStorage::fill(
        mesh_, candidate_.point, star_of, [&](std::uint32_t) { return is_closed ? 0u : kNoPlace; },
        [](std::uint32_t) { return false; }, threads_);
    counts.agreed_points = candidate_.size() - counts.open_points;
  }

  int threads_;
  const OnStep& on_step_;
  std::optional<RasterStars> raster_;
  std::vector<std::uint8_t> doubled_;
  CandidateTriangulation candidate_;
  OrientedComponents pieces_;
  LocalDelaunayMesh mesh_;
};

LocalDelaunayMesh LocalDelaunayMesh::build(const cloud::Cloud& cloud, int threads, const OnStep& on_step,
                                           const BuildOptions& asked) {
  return LocalDelaunayMeshBuilder(cloud, threads, on_step, asked).build();
}

std::size_t LocalDelaunayMesh::bytes() const noexcept {
  return places_.capacity() * sizeof(PackedVertex) + wide_.capacity() * sizeof(wide_[0]) +
         (long_rings_.capacity() + closed_component_of_.capacity() + order_.capacity()) *
             sizeof(std::uint32_t) +
         has_holes_.capacity();
}

geometry::TriangleMesh LocalDelaunayMesh::as_mesh() const {
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

}  // namespace palpate::local_delaunay
