#include "toolkit/deformation/deformed_local_delaunay.h"

#include <algorithm>
#include <cmath>

#include "toolkit/geometry/triangle_meshes.h"
#include "toolkit/local_delaunay/planar_voronoi_cell.h"

namespace palpate::deformation {

using namespace render;

namespace {

/// An edge is split where its halves are nearer to its first length than it is itself, in ratio: beyond the
/// root of two.
constexpr double kStretchedSq = 2.0;

}  // namespace

DeformedLocalDelaunay::DeformedLocalDelaunay(local_delaunay::LocalDelaunayMesh& mesh,
                                             local_delaunay::BlockBvh& tree, SurfaceField& surface,
                                             std::size_t spare_points, int threads)
    : stars_(mesh, tree, spare_points, threads), surface_(&surface) {
  place_of_.resize(built());
  for (std::uint32_t place = 0; place < built(); ++place) place_of_[mesh.order()[place]] = place;
  first_.resize(most());
  for (std::uint32_t place = 0; place < built(); ++place) {
    const Vec3 p = mesh.at(place);
    const std::span<const std::uint32_t> around = links(place);
    double sum = 0.0, longest = 0.0;
    for (const std::uint32_t other : around) {
      const double length = (mesh.at(other) - p).norm();
      sum += length;
      longest = std::max(longest, length);
    }
    const double count = around.empty() ? 1.0 : static_cast<double>(around.size());
    first_[place] = {p.cast<float>(), static_cast<float>(sum / count), static_cast<float>(longest)};
  }
  if (!surface.by_point.empty()) surface.by_point.resize(most(), surface.by_point.front());
}

void DeformedLocalDelaunay::update_dependents(std::span<const MovedPoint> moved, UndoJournal& journal,
                                              DeformCounters& counters, MoveWatcher& watcher) noexcept {
  std::size_t inferred = 0;
  for (const MovedPoint& m : moved) {
    std::array<std::uint32_t, local_delaunay::kMaxCorners> around;
    const std::span<const std::uint32_t> ring = links(m.place);
    std::copy(ring.begin(), ring.end(), around.begin());
    for (std::size_t k = 0, count = ring.size(); k < count; ++k) {
      if (!stretched(m.place, around[k])) continue;
      if (inferred == kMaxInferredPoints || !infer_between(m.place, around[k], journal, watcher)) {
        ++counters.not_inferred;
        continue;
      }
      ++inferred;
      ++counters.inferred;
    }
  }
  stars_.refit();
}

/// Beside what it was, an edge is compared with those around its end `a` then: one between points that lay
/// close together is not long because they have parted.
bool DeformedLocalDelaunay::stretched(std::uint32_t a, std::uint32_t b) const noexcept {
  const double mean = static_cast<double>(first_[a].mean_mm);
  const double length_sq = (at(a) - at(b)).squaredNorm();
  return length_sq > kStretchedSq * mean * mean &&
         length_sq > kStretchedSq * (initial_position(a) - initial_position(b)).squaredNorm();
}

bool DeformedLocalDelaunay::infer_between(std::uint32_t a, std::uint32_t b, UndoJournal& journal,
                                          MoveWatcher& watcher) noexcept {
  const Vec3 middle = geometry::hermite_midpoint(at(a), at(b), area_normal(a).stableNormalized(),
                                                 area_normal(b).stableNormalized());
  if (!middle.cast<float>().allFinite()) return false;
  const std::uint32_t place = stars_.split(a, b);
  if (place == local_delaunay::kNoPlace) return false;
  const First &first_a = first_[a], &first_b = first_[b];
  first_[place] = {0.5f * (first_a.at + first_b.at), 0.5f * (first_a.mean_mm + first_b.mean_mm),
                   0.5f * (first_a.longest_mm + first_b.longest_mm)};
  if (!surface_->by_point.empty()) {
    surface_->by_point[place] = surface_->by_point[a];
    // Stiffness is linear over a facet: the middle's splits no field.
    surface_->by_point[place].stiffness_n_per_mm =
        0.5f * (surface_->by_point[a].stiffness_n_per_mm + surface_->by_point[b].stiffness_n_per_mm);
  }
  journal.remember(place, false);
  const Vec3 from = at(place);
  set(place, middle.cast<float>());
  watcher.point_moved(place, from, at(place));
  return true;
}

void DeformedLocalDelaunay::remove_last(MoveWatcher& watcher) noexcept {
  const std::uint32_t place = used() - 1;
  const auto [a, b] = stars_.parents(place);
  const Vec3 from = at(place);
  set(place, (0.5 * (at(a) + at(b))).cast<float>());
  watcher.point_moved(place, from, at(place));
  stars_.undo_split();
}

std::size_t DeformedLocalDelaunay::bytes() const noexcept {
  return stars_.bytes() + place_of_.capacity() * sizeof(std::uint32_t) + first_.capacity() * sizeof(First) +
         records_.capacity() * sizeof(Vec3f);
}

std::size_t DeformedLocalDelaunay::bytes_for(std::size_t points, std::size_t spare_points,
                                             std::size_t records) noexcept {
  return local_delaunay::DeformableMesh::bytes_for(points, spare_points) + points * sizeof(std::uint32_t) +
         (points + spare_points) * sizeof(First) + records * sizeof(Vec3f);
}

}  // namespace palpate::deformation
