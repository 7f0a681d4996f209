#include "toolkit/deformation/deformer.h"

#include <algorithm>
#include <cmath>

#include "toolkit/deformation/deformed_local_delaunay.h"
#include "toolkit/geometry/triangle_meshes.h"
#include "toolkit/local_delaunay/planar_voronoi_cell.h"

namespace palpate::deformation {

using namespace render;

namespace {

/// Points that a surface that gives way may gain by stretching, as a share of those it has, and at least.
constexpr double kSpareShare = 0.125;
constexpr std::size_t kMinSpare = 256;
/// Changes remembered for undo: some four thousand frames of a full dent.
constexpr std::size_t kJournalPoints = std::size_t{1} << 19;

/// The dent's profile: 1 in the middle, 0 and without a kink at the radius.
double profile(double share_sq) noexcept {
  const double left = 1.0 - share_sq;
  return left > 0.0 ? left * left : 0.0;
}

double apart_sq(const Vec3& a, const Vec3& b) noexcept {
  const double dx = a.x() - b.x(), dy = a.y() - b.y(), dz = a.z() - b.z();
  return dx * dx + dy * dy + dz * dz;
}

}  // namespace

DeformerCapacity deformer_capacity(std::size_t points) noexcept {
  DeformerCapacity room;
  room.spare_points = static_cast<std::size_t>(kSpareShare * static_cast<double>(points)) + kMinSpare;
  room.journal_points = std::min(points + room.spare_points, kJournalPoints);
  return room;
}

Deformer::Deformer(DeformedLocalDelaunay& points, std::size_t journal_points)
    : points_(&points), journal_(points, journal_points), seen_(points.most()) {
  begin_stroke();
}

std::size_t Deformer::bytes() const noexcept {
  return points_->bytes() + journal_.bytes() + seen_.capacity() * sizeof(std::uint64_t);
}

std::size_t Deformer::bytes_for(std::size_t points, const DeformerCapacity& room) noexcept {
  const std::size_t most = points + room.spare_points;
  return UndoJournal::bytes_for(most, room.journal_points) + most * sizeof(std::uint64_t);
}

void Deformer::move(std::uint32_t place, const Vec3& to_mm, MoveWatcher& watcher) noexcept {
  const Vec3f to = to_mm.cast<float>();
  if (!to.allFinite()) {
    ++counters_.refused;
    return;
  }
  journal_.remember(place, true);
  const Vec3 from = points_->at(place);
  if (moved_count_ < moved_.size()) moved_[moved_count_++] = {place, from, to_mm};
  points_->set(place, to);
  watcher.point_moved(place, from, points_->at(place));
  ++counters_.moved;
}

/// The places within a radius of one, along the links, nearest links first; into found_.
std::size_t Deformer::collect(std::uint32_t place, const Vec3& middle, double radius_mm) noexcept {
  ++searches_;
  std::size_t count = 0;
  found_[count++] = place;
  seen_[place] = searches_;
  for (std::size_t next = 0; next < count && count < found_.size(); ++next)
    for (const std::uint32_t other : points_->links(found_[next])) {
      if (seen_[other] == searches_ || count == found_.size()) continue;
      seen_[other] = searches_;
      if (apart_sq(points_->at(other), middle) < radius_mm * radius_mm) found_[count++] = other;
    }
  return count;
}

Vec3 Deformer::normal_around(std::uint32_t place, const Vec3& middle, double radius_mm) noexcept {
  Vec3 sum = Vec3::Zero();
  const std::size_t count = collect(place, middle, radius_mm);
  for (std::size_t i = 0; i < count; ++i) sum += points_->area_normal(found_[i]);
  return sum.stableNormalized();
}

std::size_t Deformer::press(std::uint32_t place, const Vec3& middle, const Vec3& outward, double by_mm,
                            double radius_mm, double max_depth_per_radius) noexcept {
  moved_count_ = 0;
  if (place >= points_->used() || !(by_mm > 0.0) || !std::isfinite(by_mm) || !is_finite(outward)) return 0;
  const std::size_t count = collect(place, middle, radius_mm);
  const double radius_sq = radius_mm * radius_mm;
  // Where the bound cuts a dent off, its profile ends there too, so that no step is left around it.
  double farthest_sq = 0.0;
  for (std::size_t i = 0; i < count; ++i)
    farthest_sq = std::max(farthest_sq, apart_sq(points_->at(found_[i]), middle));
  const double reach_sq = count == found_.size() ? std::min(farthest_sq, radius_sq) : radius_sq;
  by_mm = std::min(by_mm, max_depth_per_radius * std::sqrt(reach_sq) - displacement_mm(place));
  if (!(by_mm > 0.0)) return 0;
  CallbackWatcher nobody(kNoWatcher);
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 p = points_->at(found_[i]);
    const double share = reach_sq > 0.0 ? profile((p - middle).squaredNorm() / reach_sq) : 1.0;
    if (share > 0.0) move(found_[i], p - outward * (by_mm * share), nobody);
  }
  update_dependents(nobody);
  return moved_count_;
}

std::size_t Deformer::apply_watched(const MoveBatch& batch, MoveWatcher& watcher) noexcept {
  moved_count_ = 0;
  const std::size_t count = std::min<std::size_t>(batch.count, kMaxBatch);
  for (std::size_t i = 0; i < count; ++i)
    if (batch.point[i] < points_->built())
      move(points_->place_of(batch.point[i]), batch.to_mm[i].cast<double>(), watcher);
  update_dependents(watcher);
  return moved_count_;
}

void Deformer::update_dependents(MoveWatcher& watcher) noexcept {
  const std::uint32_t before = points_->used();
  points_->update_dependents(last_moved(), journal_, counters_, watcher);
  box_mm_ = {};
  for (const MovedPoint& moved : last_moved()) box_mm_.add(moved.to_mm);
  for (std::uint32_t place = before; place < points_->used(); ++place) box_mm_.add(points_->at(place));
}

bool Deformer::undo_watched(MoveWatcher& watcher) noexcept {
  moved_count_ = 0;
  const bool any =
      journal_.undo_last_stroke([&](const UndoJournal::Entry& entry, std::size_t record) noexcept {
        if (!entry.existed) {  // inferred points go in the order opposite to that in which they came
          points_->remove_last(watcher);
          return;
        }
        const Vec3 from = points_->at(entry.place);
        points_->put_back(record, entry.place);
        watcher.point_moved(entry.place, from, points_->at(entry.place));
      });
  points_->finish_restoring();
  return any;
}

void Deformer::reset_watched(MoveWatcher& watcher) noexcept {
  moved_count_ = 0;
  while (points_->used() > points_->built()) points_->remove_last(watcher);
  for (std::uint32_t place = 0; place < points_->built(); ++place) {
    const Vec3 from = points_->at(place);
    points_->restore_initial(place);
    if (const Vec3 to = points_->at(place); from != to) watcher.point_moved(place, from, to);
  }
  points_->finish_restoring();
  journal_.forget_all();
}

double Deformer::displacement_mm(std::uint32_t place) const noexcept {
  const std::uint32_t built = points_->standing(place, points_->built());
  return std::sqrt(apart_sq(points_->initial_position(built), points_->at(built)));
}

Result<cloud::Cloud> Deformer::edited() const {
  std::vector<Vec3> points;
  points.reserve(points_->used());
  for (std::uint32_t i = 0; i < points_->used(); ++i) points.push_back(points_->at(i) + points_->origin_mm());
  return cloud::build_cloud(points, cloud::NonFinite::kRefuse);
}

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
