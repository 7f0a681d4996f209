#include "toolkit/deformation/deformer.h"

#include <algorithm>
#include <cmath>
#include <variant>

#include "toolkit/points/point_walk.h"
#include "toolkit/surface/planes.h"

namespace palpate::render {
namespace {

/// The dent's profile: 1 in the middle, 0 and without a kink at the radius.
double profile(double share_sq) noexcept {
  const double left = 1.0 - share_sq;
  return left > 0.0 ? left * left : 0.0;
}

/// use(partition) for the moving one that the model has.
template <class Use>
auto with_moving(PointModel& model, Use&& use) noexcept {
  if (auto* octree = std::get_if<partition::DynamicOctree>(&model.tree)) return use(*octree);
  if (auto* quadtree = std::get_if<partition::DynamicQuadtree3d>(&model.tree)) return use(*quadtree);
  return use(*std::get_if<partition::DynamicGrid>(&model.tree));
}

Vec3f stored_at(const PointModel& model, std::uint32_t place) noexcept {
  const StoredPoint& point = model.points[place];
  return {point.x_mm, point.y_mm, point.z_mm};
}

/// The partition follows a point; false where it has no room.
bool follow_point(PointModel& model, std::uint32_t place, const Vec3f& to_mm) noexcept {
  const auto at = [&](std::uint32_t p) { return stored_at(model, p); };
  return with_moving(model, [&](auto& tree) { return tree.move(place, to_mm, at); }) !=
         partition::MoveStatus::kFull;
}

}  // namespace

Deformer::Deformer(PointModel& model, SurfaceField& surface, const Options& options)
    : model_(&model), surface_(&surface), built_(model.points.size()), used_(built_) {
  const std::size_t most = built_ + options.spare_points;
  first_points_ = model.points;
  first_links_ = model.neighbours;
  // Spare places are there from the start, so that no array grows in a frame: without a plane, so that no
  // surface is said to be there. No link leads to them and the grid does not know them.
  StoredPoint spare = model.points.front();
  spare.normal = surface::kNoNormal;
  model.points.resize(most, spare);
  model.neighbours.resize(most, model.neighbours.front());
  if (!model.half_box_mm.empty()) model.half_box_mm.resize(most, model.half_box_mm.front());
  if (!surface.of_place.empty()) surface.of_place.resize(most, surface.of_place.front());
  if (!model.closed_piece_of.empty()) model.closed_piece_of.resize(most, model.closed_piece_of.front());
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

std::size_t Deformer::bytes_for(std::size_t points, const Options& options) noexcept {
  return points * (sizeof(StoredPoint) + sizeof(neighbourhood::Neighbours)) +
         options.journal_points * sizeof(Entry) + 2 * (points + options.spare_points) * sizeof(std::uint64_t);
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
  const Vec3f to = to_mm.cast<float>();
  if (!to.allFinite() || !follow_point(*model_, place, to)) {
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

std::size_t Deformer::press(std::uint32_t place, const Vec3& outward, double by_mm, double radius_mm,
                            double deepest_per_radius) noexcept {
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
  by_mm = std::min(by_mm, deepest_per_radius * std::sqrt(reach_sq) - sunk_mm(place));
  if (!(by_mm > 0.0)) return 0;
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
  const auto place = static_cast<std::uint32_t>(used_);
  const Vec3f stored = middle.cast<float>();
  const auto at = [this](std::uint32_t p) { return stored_at(*model_, p); };
  const auto add = [&](auto& tree) { return tree.add(place, stored, at); };
  if (!stored.allFinite() || with_moving(*model_, add) == partition::MoveStatus::kFull) return false;
  model_->points[place] = {stored.x(), stored.y(), stored.z(), ca};
  if (!model_->half_box_mm.empty()) model_->half_box_mm[place] = model_->half_box_mm[a];
  if (!surface_->of_place.empty()) surface_->of_place[place] = surface_->of_place[a];
  if (!model_->closed_piece_of.empty()) model_->closed_piece_of[place] = model_->closed_piece_of[a];
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

bool Deformer::find_last_stroke(std::size_t& begin) noexcept {
  moved_count_ = 0;
  if (first_stroke_ == next_stroke_) return false;
  // The stroke that is open may be empty: then the one before is meant.
  if (strokes_[(next_stroke_ - 1) % kMaxStrokes].begin == next_entry_) {
    if (next_stroke_ - 1 == first_stroke_) return false;
    --next_stroke_;
  }
  begin = strokes_[(next_stroke_ - 1) % kMaxStrokes].begin;
  return true;
}

/// What a place was like before the stroke. True where a point is there that may have moved.
bool Deformer::restore(const Entry& entry) noexcept {
  if (entry.existed) return put_back(entry.place, entry.point, entry.links);
  remove_last();  // inferred points go in the order opposite to that in which they came
  return false;
}

bool Deformer::put_back(std::uint32_t place, const StoredPoint& point,
                        const neighbourhood::Neighbours& links) noexcept {
  // There is room: the cell is one that the point was in, or the cells it freed since.
  const Vec3f to(point.x_mm, point.y_mm, point.z_mm);
  if (stored_at(*model_, place) != to && !follow_point(*model_, place, to)) {
    ++counters_.refused;
    return false;
  }
  model_->points[place] = point;
  model_->neighbours[place] = links;
  return true;
}

void Deformer::remove_last() noexcept {
  const auto place = static_cast<std::uint32_t>(--used_);
  with_moving(*model_, [&](auto& tree) { tree.remove(place, stored_at(*model_, place)); });
  model_->points[place].normal = surface::kNoNormal;
}

void Deformer::forget_inferred() noexcept {
  moved_count_ = 0;
  while (used_ > built_) remove_last();
}

/// An inferred point is linked to its parents or their neighbours, which all came before it.
std::uint32_t Deformer::built_near(std::uint32_t place, std::size_t below) const noexcept {
  while (place >= below) {
    const neighbourhood::Neighbours& links = model_->neighbours[place];
    const std::uint32_t first = *std::min_element(links.begin(), links.end());
    if (first >= place) return 0;
    place = first;
  }
  return place;
}

double Deformer::sunk_mm(std::uint32_t place) const noexcept {
  const std::uint32_t built = built_near(place, built_);
  return std::sqrt(distance_sq(first_points_[built], model_->points[built].at()));
}

double Deformer::first_resolution_mm(std::uint32_t place) const noexcept {
  const std::uint32_t built = built_near(place, built_);
  double most_sq = 0.0;
  for (const std::uint32_t other : first_links_[built])
    most_sq = std::max(most_sq, distance_sq(first_points_[other], first_points_[built].at()));
  return std::sqrt(most_sq);
}

Result<cloud::Cloud> Deformer::edited() const {
  std::vector<Vec3> points;
  points.reserve(used_);
  for (std::size_t i = 0; i < used_; ++i) points.push_back(model_->points[i].at() + model_->origin_mm);
  return cloud::build_cloud(points, cloud::NonFinite::kRefuse);
}

}  // namespace palpate::render
