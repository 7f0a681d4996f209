#include "toolkit/render/deformer.h"

#include <algorithm>
#include <cmath>
#include <variant>

#include "toolkit/render/point_walk.h"
#include "toolkit/surface/planes.h"

namespace palpate::render {
namespace {

/// The dent's profile: 1 in the middle, 0 and without a kink at the radius.
double profile(double share_sq) noexcept {
  const double left = 1.0 - share_sq;
  return left > 0.0 ? left * left : 0.0;
}

}  // namespace

Deformer::Deformer(PointModel& model, const Options& options)
    : model_(&model),
      grid_(std::get_if<partition::DynamicGrid>(&model.tree)),
      built_(model.points.size()),
      used_(built_) {
  const std::size_t most = built_ + options.spare_points;
  first_points_ = model.points;
  first_links_ = model.neighbours;
  // Spare places are there from the start, copies of the first, so that no array grows in a frame. No link
  // leads to them and the grid does not know them.
  model.points.resize(most, model.points.front());
  model.neighbours.resize(most, model.neighbours.front());
  if (!model.half_box_mm.empty()) model.half_box_mm.resize(most, model.half_box_mm.front());
  if (!model.surface.of_place.empty()) model.surface.of_place.resize(most, model.surface.of_place.front());
  journal_.resize(options.journal_points);
  seen_.resize(most);
  recorded_.resize(most);
  begin_stroke();
}

std::size_t Deformer::bytes() const noexcept {
  return first_points_.capacity() * sizeof(StoredPoint) +
         first_links_.capacity() * sizeof(neighbourhood::Neighbours) + journal_.capacity() * sizeof(Entry) +
         (seen_.capacity() + recorded_.capacity()) * sizeof(std::uint64_t);
}

void Deformer::begin_stroke() noexcept {
  ++stroke_number_;
  // An empty stroke is used again.
  if (next_stroke_ > first_stroke_ && strokes_[(next_stroke_ - 1) % kMaxStrokes].begin == next_entry_) return;
  if (next_stroke_ - first_stroke_ == kMaxStrokes) forget_oldest();
  strokes_[next_stroke_++ % kMaxStrokes] = {next_entry_};
}

void Deformer::forget_oldest() noexcept {
  ++first_stroke_;
  ++counters_.forgotten;
}

/// What a place was like before the stroke, once.
void Deformer::remember(std::uint32_t place, bool existed) noexcept {
  if (recorded_[place] == stroke_number_) return;
  recorded_[place] = stroke_number_;
  if (journal_.empty()) return;
  // The ring is full: the strokes whose first entries would be written over are forgotten.
  while (first_stroke_ < next_stroke_ &&
         next_entry_ - strokes_[first_stroke_ % kMaxStrokes].begin >= journal_.size())
    forget_oldest();
  journal_[next_entry_++ % journal_.size()] = {place, existed, model_->points[place],
                                               model_->neighbours[place]};
}

bool Deformer::move(std::uint32_t place, const Vec3& to_mm) noexcept {
  partition::DynamicGrid& grid = *grid_;
  const Vec3f to = to_mm.cast<float>();
  const auto at = [this](std::uint32_t p) {
    const StoredPoint& point = model_->points[p];
    return Vec3f(point.x_mm, point.y_mm, point.z_mm);
  };
  if (!to.allFinite() || grid.move(place, to, at) == partition::MoveStatus::kFull) {
    ++counters_.refused;
    return false;
  }
  remember(place, true);
  StoredPoint& point = model_->points[place];
  if (moved_count_ < moved_.size()) moved_[moved_count_++] = {place, point.at(), to_mm};
  point.x_mm = to.x();
  point.y_mm = to.y();
  point.z_mm = to.z();
  ++counters_.moved;
  return true;
}

/// The places within a radius of one, along the links, nearest links first; into found_.
std::size_t Deformer::collect(std::uint32_t place, double radius_mm) noexcept {
  ++searches_;
  const Vec3 middle = model_->points[place].at();
  std::size_t count = 0;
  found_[count++] = place;
  seen_[place] = searches_;
  for (std::size_t next = 0; next < count && count < found_.size(); ++next)
    for (const std::uint32_t other : model_->neighbours[found_[next]]) {
      if (seen_[other] == searches_ || count == found_.size()) continue;
      seen_[other] = searches_;
      if (distance_sq(model_->points[other], middle) < radius_mm * radius_mm) found_[count++] = other;
    }
  return count;
}

std::size_t Deformer::press(std::uint32_t place, const Vec3& outward, double by_mm,
                            double radius_mm) noexcept {
  moved_count_ = 0;
  if (place >= used_ || !(by_mm > 0.0) || !std::isfinite(by_mm) || !is_finite(outward)) return 0;
  const std::size_t count = collect(place, radius_mm);
  const Vec3 middle = model_->points[place].at();
  const double radius_sq = radius_mm * radius_mm;
  // Where the bound cuts a dent off, its profile ends there too, so that no step is left around it.
  double farthest_sq = 0.0;
  for (std::size_t i = 0; i < count; ++i)
    farthest_sq = std::max(farthest_sq, distance_sq(model_->points[found_[i]], middle));
  const double reach_sq = count == found_.size() ? std::min(farthest_sq, radius_sq) : radius_sq;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 p = model_->points[found_[i]].at();
    const double share = reach_sq > 0.0 ? profile((p - middle).squaredNorm() / reach_sq) : 1.0;
    if (share > 0.0) (void)move(found_[i], p - outward * (by_mm * share));
  }
  settle();
  mend_stretched();
  return moved_count_;
}

std::size_t Deformer::apply(const MoveBatch& batch) noexcept {
  moved_count_ = 0;
  const std::size_t count = std::min<std::size_t>(batch.count, kMaxBatch);
  for (std::size_t i = 0; i < count; ++i)
    if (batch.point[i] < built_) (void)move(model_->place_of[batch.point[i]], batch.to_mm[i].cast<double>());
  settle();
  mend_stretched();
  return moved_count_;
}

/// The links of moved points are put in order of distance again, and their planes follow, on the side that
/// they had.
void Deformer::settle() noexcept {
  for (std::size_t i = 0; i < moved_count_; ++i) {
    const std::uint32_t place = moved_[i].place;
    const Vec3 p = model_->points[place].at();
    neighbourhood::Neighbours& links = model_->neighbours[place];
    const auto key = [&](std::uint32_t other) {
      return other == place ? HUGE_VAL : distance_sq(model_->points[other], p);
    };
    // Eight, nearly in order already: insertion.
    for (std::size_t k = 1; k < links.size(); ++k) {
      const std::uint32_t other = links[k];
      const double d = key(other);
      std::size_t at = k;
      for (; at > 0 && key(links[at - 1]) > d; --at) links[at] = links[at - 1];
      links[at] = other;
    }
  }
  for (std::size_t i = 0; i < moved_count_; ++i)
    surface::refit_plane(model_->points, model_->neighbours, moved_[i].place);
}

/// Boxes that touched while the surface was whole must touch after it was stretched.
bool Deformer::apart(std::uint32_t a, std::uint32_t b) const noexcept {
  const Vec3 off = (model_->points[a].at() - model_->points[b].at()).cwiseAbs();
  return (off.array() > (model_->half_box(a) + model_->half_box(b)).array()).any();
}

void Deformer::mend_stretched() noexcept {
  std::size_t inferred = 0;
  const std::size_t count = moved_count_;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t place = moved_[i].place;
    const neighbourhood::Neighbours links = model_->neighbours[place];
    // The nearest four span the surface; farther ones were never meant to touch on all axes.
    for (std::size_t k = 0; k < links.size() / 2; ++k) {
      if (links[k] == place || !apart(place, links[k])) continue;
      if (inferred == kMaxInferredPoints || !infer_between(place, links[k])) {
        ++counters_.not_inferred;
        continue;
      }
      ++inferred;
    }
  }
}

/// A point in the middle of a link: on the curve that leaves both ends along their planes (the middle of a
/// cubic Hermite segment), so that a stretched surface stays as round as it was.
bool Deformer::infer_between(std::uint32_t a, std::uint32_t b) noexcept {
  if (used_ == seen_.size()) return false;
  const Vec3 pa = model_->points[a].at(), pb = model_->points[b].at();
  const Vec3 chord = pb - pa;
  const surface::NormalCode ca = model_->points[a].normal, cb = model_->points[b].normal;
  Vec3 middle = 0.5 * (pa + pb);
  if (ca != surface::kNoNormal && cb != surface::kNoNormal) {
    const Vec3 na = surface::decode_normal(ca), nb = surface::decode_normal(cb);
    const Vec3 ta = chord - na * na.dot(chord), tb = chord - nb * nb.dot(chord);
    middle += 0.125 * (ta - tb);
  }
  partition::DynamicGrid& grid = *grid_;
  const auto place = static_cast<std::uint32_t>(used_);
  const Vec3f stored = middle.cast<float>();
  if (grid.add(place, stored) == partition::MoveStatus::kFull) return false;
  model_->points[place] = {stored.x(), stored.y(), stored.z(), ca};
  if (!model_->half_box_mm.empty()) model_->half_box_mm[place] = model_->half_box_mm[a];
  if (!model_->surface.of_place.empty()) model_->surface.of_place[place] = model_->surface.of_place[a];
  ++used_;
  remember(place, false);
  link_new(place, a, b);
  surface::refit_plane(model_->points, model_->neighbours, place);
  ++counters_.inferred;
  return true;
}

/// Its eight nearest of its parents and theirs; the parents' link to each other goes through it, and each of
/// its own neighbours takes it up where it is nearer than the farthest.
void Deformer::link_new(std::uint32_t place, std::uint32_t a, std::uint32_t b) noexcept {
  std::array<std::uint32_t, 2 + 2 * neighbourhood::kNeighbours> around{};
  std::size_t count = 0;
  ++searches_;
  seen_[place] = searches_;
  const auto offer = [&](std::uint32_t other) {
    if (seen_[other] == searches_) return;
    seen_[other] = searches_;
    around[count++] = other;
  };
  offer(a);
  offer(b);
  for (const std::uint32_t other : model_->neighbours[a]) offer(other);
  for (const std::uint32_t other : model_->neighbours[b]) offer(other);
  const Vec3 p = model_->points[place].at();
  std::sort(around.begin(), around.begin() + static_cast<std::ptrdiff_t>(count),
            [&](std::uint32_t x, std::uint32_t y) {
              const double dx = distance_sq(model_->points[x], p), dy = distance_sq(model_->points[y], p);
              return dx < dy || (dx == dy && x < y);
            });
  neighbourhood::Neighbours& own = model_->neighbours[place];
  own.fill(place);
  for (std::size_t k = 0; k < std::min(count, own.size()); ++k) own[k] = around[k];
  const auto take_up = [&](std::uint32_t at, std::uint32_t instead) {
    remember(at, true);
    neighbourhood::Neighbours& links = model_->neighbours[at];
    auto where = std::find(links.begin(), links.end(), instead);
    if (where == links.end()) where = links.end() - 1;
    *where = place;
    const Vec3 here = model_->points[at].at();
    std::sort(links.begin(), links.end(), [&](std::uint32_t x, std::uint32_t y) {
      const double dx = x == at ? HUGE_VAL : distance_sq(model_->points[x], here);
      const double dy = y == at ? HUGE_VAL : distance_sq(model_->points[y], here);
      return dx < dy || (dx == dy && x < y);
    });
  };
  take_up(a, b);
  take_up(b, a);
}

bool Deformer::undo() noexcept {
  moved_count_ = 0;
  if (first_stroke_ == next_stroke_) return false;
  std::size_t last = next_stroke_ - 1;
  // The stroke that is open may be empty: then the one before is meant.
  if (strokes_[last % kMaxStrokes].begin == next_entry_) {
    if (last == first_stroke_) return false;
    next_stroke_ = last--;
  }
  const std::size_t begin = strokes_[last % kMaxStrokes].begin;
  for (std::size_t e = next_entry_; e-- > begin;) restore(journal_[e % journal_.size()]);
  next_entry_ = begin;
  next_stroke_ = last;
  begin_stroke();
  return true;
}

void Deformer::restore(const Entry& entry) noexcept {
  partition::DynamicGrid& grid = *grid_;
  const auto at = [this](std::uint32_t p) {
    const StoredPoint& point = model_->points[p];
    return Vec3f(point.x_mm, point.y_mm, point.z_mm);
  };
  if (!entry.existed) {
    grid.remove(entry.place, at(entry.place));
    --used_;  // inferred points go in the order opposite to that in which they came
    return;
  }
  const Vec3f back(entry.point.x_mm, entry.point.y_mm, entry.point.z_mm);
  // There is room: the cell is one that the point was in, or the cells it freed since.
  if (grid.move(entry.place, back, at) == partition::MoveStatus::kFull) {
    ++counters_.refused;
    return;
  }
  model_->points[entry.place] = entry.point;
  model_->neighbours[entry.place] = entry.links;
}

void Deformer::reset() noexcept {
  partition::DynamicGrid& grid = *grid_;
  const auto at = [this](std::uint32_t p) {
    const StoredPoint& point = model_->points[p];
    return Vec3f(point.x_mm, point.y_mm, point.z_mm);
  };
  while (used_ > built_) {
    --used_;
    grid.remove(static_cast<std::uint32_t>(used_), at(static_cast<std::uint32_t>(used_)));
  }
  for (std::uint32_t place = 0; place < built_; ++place) {
    const StoredPoint& first = first_points_[place];
    const StoredPoint& now = model_->points[place];
    if (first.x_mm != now.x_mm || first.y_mm != now.y_mm || first.z_mm != now.z_mm) {
      if (grid.move(place, Vec3f(first.x_mm, first.y_mm, first.z_mm), at) == partition::MoveStatus::kFull)
        continue;
    }
    model_->points[place] = first;
    model_->neighbours[place] = first_links_[place];
  }
  moved_count_ = 0;
  first_stroke_ = next_stroke_ = 0;
  next_entry_ = 0;
  begin_stroke();
}

Result<cloud::Cloud> Deformer::edited() const {
  std::vector<Vec3> points;
  points.reserve(used_);
  for (std::size_t i = 0; i < used_; ++i) points.push_back(model_->points[i].at() + model_->pose.origin_mm);
  return cloud::build_cloud(points, cloud::NonFinite::kRefuse);
}

}  // namespace palpate::render
