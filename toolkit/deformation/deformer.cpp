#include "toolkit/deformation/deformer.h"

#include <algorithm>
#include <cmath>

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

}  // namespace palpate::deformation
