#include "toolkit/deformation/moving_vertices.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <variant>

#include "toolkit/deformation/journal.h"
#include "toolkit/geometry/rounded_middle.h"
#include "toolkit/points/point_walk.h"
#include "toolkit/surface/planes.h"

namespace palpate::render {
namespace {

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

Vec3 normal_of(const StoredPoint& point) noexcept {
  return point.normal == surface::kNoNormal ? Vec3(Vec3::Zero()) : surface::decode_normal(point.normal);
}

}  // namespace

MovingVertices::MovingVertices(PointModel& model, SurfaceField& surface, std::size_t spare_points)
    : model_(&model), surface_(&surface) {
  const std::size_t most = model.points.size() + spare_points;
  built_ = used_ = static_cast<std::uint32_t>(model.points.size());
  most_ = static_cast<std::uint32_t>(most);
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
}

std::size_t MovingVertices::bytes() const noexcept {
  return first_points_.capacity() * sizeof(StoredPoint) +
         first_links_.capacity() * sizeof(neighbourhood::Neighbours) + records_.capacity() * sizeof(Record);
}

double MovingVertices::first_resolution_mm(std::uint32_t place) const noexcept {
  const std::uint32_t built = standing(place, built_);
  double most_sq = 0.0;
  for (const std::uint32_t other : first_links_[built])
    most_sq = std::max(most_sq, distance_sq(first_points_[other], first_points_[built].at()));
  return std::sqrt(most_sq);
}

std::uint32_t MovingVertices::standing(std::uint32_t place, std::uint32_t below) const noexcept {
  while (place >= below) {
    const neighbourhood::Neighbours& links = model_->neighbours[place];
    const std::uint32_t first = *std::min_element(links.begin(), links.end());
    if (first >= place) return 0;
    place = first;
  }
  return place;
}

/// The partition follows a point; false where it has no room.
bool MovingVertices::make_room(std::uint32_t place, const Vec3f& to) noexcept {
  const auto at = [this](std::uint32_t p) { return stored_at(*model_, p); };
  return with_moving(*model_, [&](auto& tree) { return tree.move(place, to, at); }) !=
         partition::MoveStatus::kFull;
}

void MovingVertices::set(std::uint32_t place, const Vec3f& to) noexcept {
  StoredPoint& point = model_->points[place];
  point.x_mm = to.x();
  point.y_mm = to.y();
  point.z_mm = to.z();
}

/// The links of moved points are put in order of distance again, and their planes follow, on the side that
/// they had.
void MovingVertices::settle(std::span<const MovedPoint> moved, Journal& journal, DeformCounters& counters,
                            MoveWatcher& /*watcher*/) noexcept {
  for (const MovedPoint& m : moved) {
    const std::uint32_t place = m.place;
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
  for (const MovedPoint& m : moved) surface::refit_plane(model_->points, model_->neighbours, m.place);
  mend_stretched(moved, journal, counters);
}

/// Boxes that touched while the surface was whole must touch after it was stretched.
bool MovingVertices::apart(std::uint32_t a, std::uint32_t b) const noexcept {
  const Vec3 off = (model_->points[a].at() - model_->points[b].at()).cwiseAbs();
  return (off.array() > (model_->half_box(a) + model_->half_box(b)).array()).any();
}

void MovingVertices::mend_stretched(std::span<const MovedPoint> moved, Journal& journal,
                                    DeformCounters& counters) noexcept {
  std::size_t inferred = 0;
  for (const MovedPoint& m : moved) {
    const std::uint32_t place = m.place;
    const neighbourhood::Neighbours links = model_->neighbours[place];
    // The nearest four span the surface; farther ones were never meant to touch on all axes.
    for (std::size_t k = 0; k < links.size() / 2; ++k) {
      if (links[k] == place || !apart(place, links[k])) continue;
      if (inferred == kMaxInferredPoints || !infer_between(place, links[k], journal)) {
        ++counters.not_inferred;
        continue;
      }
      ++inferred;
      ++counters.inferred;
    }
  }
}

/// A point in the middle of a link.
bool MovingVertices::infer_between(std::uint32_t a, std::uint32_t b, Journal& journal) noexcept {
  if (used_ == most_) return false;
  const StoredPoint &pa = model_->points[a], &pb = model_->points[b];
  const std::uint32_t place = used_;
  const Vec3f stored = geometry::rounded_middle(pa.at(), pb.at(), normal_of(pa), normal_of(pb)).cast<float>();
  const auto at = [this](std::uint32_t p) { return stored_at(*model_, p); };
  const auto add = [&](auto& tree) { return tree.add(place, stored, at); };
  if (!stored.allFinite() || with_moving(*model_, add) == partition::MoveStatus::kFull) return false;
  model_->points[place] = {stored.x(), stored.y(), stored.z(), pa.normal};
  if (!model_->half_box_mm.empty()) model_->half_box_mm[place] = model_->half_box_mm[a];
  if (!surface_->of_place.empty()) surface_->of_place[place] = surface_->of_place[a];
  if (!model_->closed_piece_of.empty()) model_->closed_piece_of[place] = model_->closed_piece_of[a];
  ++used_;
  journal.remember(place, false);
  link_new(place, a, b, journal);
  surface::refit_plane(model_->points, model_->neighbours, place);
  return true;
}

/// Its eight nearest of its parents and theirs; the parents' link to each other goes through it, and each of
/// its own neighbours takes it up where it is nearer than the farthest.
void MovingVertices::link_new(std::uint32_t place, std::uint32_t a, std::uint32_t b,
                              Journal& journal) noexcept {
  std::array<std::uint32_t, 2 + 2 * neighbourhood::kNeighbours> around{};
  std::size_t count = 0;
  const auto offer = [&](std::uint32_t other) {
    const auto end = around.begin() + static_cast<std::ptrdiff_t>(count);
    if (other != place && std::find(around.begin(), end, other) == end) around[count++] = other;
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
    journal.remember(at, true);
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

bool MovingVertices::put_back(std::uint32_t place, const StoredPoint& point,
                              const neighbourhood::Neighbours& links) noexcept {
  // There is room: the cell is one that the point was in, or the cells it freed since.
  const Vec3f to(point.x_mm, point.y_mm, point.z_mm);
  if (stored_at(*model_, place) != to && !make_room(place, to)) return false;
  model_->points[place] = point;
  model_->neighbours[place] = links;
  return true;
}

void MovingVertices::remove_last(MoveWatcher& /*watcher*/) noexcept {
  const std::uint32_t place = --used_;
  with_moving(*model_, [&](auto& tree) { tree.remove(place, stored_at(*model_, place)); });
  model_->points[place].normal = surface::kNoNormal;
}

}  // namespace palpate::render
