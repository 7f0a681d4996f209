#include "toolkit/render/literal_model.h"

#include <cmath>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/swept_sphere.h"
#include "toolkit/partition/cell_walk.h"
#include "toolkit/render/roll_back.h"

namespace palpate::render {
namespace {

using partition::Cell;

/// The god object sphere clears the box's corner by this share of the half diagonal (the printed "small
/// margin").
constexpr double kSphereMargin = 1e-3;
/// A HIP that moved less than this share of the box per axis rests (the printed "small value"): below it a
/// move is less than a hundredth of the box test's own meaning.
constexpr double kRestShare = 1e-4;
constexpr std::uint32_t kNone = ~std::uint32_t{0};

}  // namespace

void LiteralModel::reset(const Vec3& h) noexcept {
  previous_ = h;
  collided_ = false;
}

ModelAnswer LiteralModel::update(const Vec3& h, FrameCounters& counters) noexcept {
  const Vec3 before = previous_;
  previous_ = h;
  // Figure 42.
  if (collided_) {
    // The figure tests the way back to the old HIP, then to the sphere; the text, at t3, the way to the god
    // object.
    if (crosses(h, before, counters) != kNone) {
      const Vec3 g = model_.points[god_].at();
      const Vec3 aim = options_.text_form ? g : Vec3(g + sphere_radius(god_) * last_direction_);
      if (crosses(h, aim, counters) == kNone) {
        collided_ = false;
        return {};
      }
    }
    return respond(h, god_, counters);
  }
  const std::uint32_t first = nearest_crossed(h, before, counters);
  if (first == kNone) return {};
  held_ = kNone;
  collided_ = true;
  return respond(h, first, counters);
}

ModelAnswer LiteralModel::respond(const Vec3& h, std::uint32_t from, FrameCounters& counters) noexcept {
  int steps = kMaxWalkSteps;
  WalkEnd end = walk(model_, from, h, steps, [](std::uint32_t) {});
  counters.walk_steps += static_cast<std::uint64_t>(kMaxWalkSteps - steps);
  ModelAnswer answer;
  answer.contact = true;
  answer.bound_hit = steps == 0;
  god_ = end.place;
  Vec3 pull = model_.points[god_].at() - h;
  const double length = pull.norm();
  // The sphere's side comes from the last contact: the direction of the last force.
  if (length > 0.0) last_direction_ = pull / length;
  // Section 3.5.2, then 3.4, then figure 46: friction moves the god object, shading reads the points around
  // it, deformation scales the force of the rigid surface there.
  std::uint32_t place = god_;
  if ((model_.surface.features & kFriction) != 0) {
    held_ = place = held_ == kNone ? god_
                                   : roll_back(
                                         god_, held_, h, model_.surface.static_friction(held_), kMaxWalkSteps,
                                         [this](std::uint32_t p) { return model_.points[p].at(); },
                                         [this](std::uint32_t p, auto&& use) {
                                           for (const std::uint32_t other : model_.neighbours[p]) use(other);
                                         });
    if (place != god_) {
      end.place = place;
      end.look_around(model_, h);
      pull = model_.points[place].at() - h;
    }
  }
  const Vec3 g = model_.points[place].at();
  if (shading_ != Shading::kNone) {
    const NearestTwo two = nearest_two(model_, end);
    pull = shaded_vector(shading_, h, g, model_.points[two.first].at(), model_.points[two.second].at());
  }
  const double stiffness = (model_.surface.features & kVaried) != 0
                               ? static_cast<double>(model_.surface.of_place[place].stiffness_n_per_mm)
                               : model_.surface.stiffness_n_per_mm;
  answer.god_object = g;
  answer.force_n = stiffness * pull;
  return answer;
}

double LiteralModel::sphere_radius(std::uint32_t place) const noexcept {
  return model_.half_box(place).norm() * (1.0 + kSphereMargin);
}

/// Calls test(place) for the points of the cells the rule selects, until it returns true.
template <class Test>
bool LiteralModel::any_in_cells(const Vec3& a, const Vec3& b, FrameCounters& counters, Test&& test) noexcept {
  const auto in_cell = [&](const Cell& cell) {
    ++counters.cells_visited;
    const partition::PlaceRange range = model_.grid.find(cell);
    for (std::uint32_t place = range.begin; place < range.end; ++place)
      if (test(place)) return true;
    return false;
  };
  if (options_.cells != CellRule::kSampled || model_.sphere_mm > 0.0) {
    Vec3 reach = options_.cells == CellRule::kAdjacent ? model_.largest_half_box_mm : Vec3(Vec3::Zero());
    reach += Vec3::Constant(model_.sphere_mm);  // a swept sphere crosses cells as a volume
    return !visit_cells(model_.grid, a, b, reach, [&](const Cell& cell) { return !in_cell(cell); });
  }
  // Sub-segments one cell long; the cell of each starting point. A HIP outside the cloud's box is far from
  // all cells: the part of the segment inside it is all that is sampled, so the count is bounded by the
  // grid.
  const Vec3 d = b - a;
  const double pieces = std::max(1.0, std::ceil(d.norm() / model_.grid.cell_mm()));
  const double most = 4.0 * static_cast<double>(model_.grid.last_cell() + 2);
  double t0 = 0.0, t1 = 1.0;
  if (pieces > most && !clip(a, d, t0, t1)) return false;
  const auto begin = static_cast<std::int64_t>(std::floor(t0 * pieces));
  const auto end = static_cast<std::int64_t>(std::ceil(t1 * pieces));
  bool hit = false;
  for (std::int64_t i = begin; i < end && !hit; ++i)
    hit = in_cell(model_.grid.cell_of(a + (static_cast<double>(i) / pieces) * d));
  if (options_.count_missed) count_missed(a, b, pieces, counters);
  return hit;
}

/// The part [t0, t1] of a + t d inside the grid's cells.
bool LiteralModel::clip(const Vec3& a, const Vec3& d, double& t0, double& t1) const noexcept {
  const Vec3 low = model_.grid.lattice().low_mm;
  const double side = static_cast<double>(model_.grid.last_cell() + 1) * model_.grid.cell_mm();
  for (int axis = 0; axis < 3; ++axis) {
    if (d[axis] == 0.0) {
      if (a[axis] < low[axis] || a[axis] > low[axis] + side) return false;
      continue;
    }
    const double s = (low[axis] - a[axis]) / d[axis], e = (low[axis] + side - a[axis]) / d[axis];
    t0 = std::max(t0, std::min(s, e));
    t1 = std::min(t1, std::max(s, e));
  }
  return t0 <= t1;
}

/// Cells crossed that hold points and that the printed sampling never looked into.
void LiteralModel::count_missed(const Vec3& a, const Vec3& b, double pieces,
                                FrameCounters& counters) noexcept {
  visit_cells(model_.grid, a, b, Vec3::Zero(), [&](const Cell& cell) {
    if (model_.grid.find(cell).empty()) return true;
    bool seen = false;
    for (double i = 0; i < pieces && !seen; ++i) {
      const Cell at = model_.grid.cell_of(a + (i / pieces) * (b - a));
      seen = at.x == cell.x && at.y == cell.y && at.z == cell.z;
    }
    counters.missed_cells += !seen;
    return true;
  });
}

bool LiteralModel::resting(const Vec3& a, const Vec3& b) const noexcept {
  return ((b - a).cwiseAbs().array() < kRestShare * model_.largest_half_box_mm.array()).all();
}

/// Section 3.1.1.2's test, or the swept sphere of 3.1.4.
bool LiteralModel::touches(const geometry::SegmentProbe& probe, std::uint32_t place,
                           FrameCounters& counters) const noexcept {
  const Vec3 centre = model_.points[place].at(), half = model_.half_box(place);
  const bool crossed = geometry::segment_touches_box(probe, centre, half);
  if (crossed || !(model_.sphere_mm > 0.0)) return crossed;
  if (!geometry::swept_sphere_touches_box(probe, model_.sphere_mm, centre, half)) return false;
  ++counters.sphere_only;
  return true;
}

/// Some crossed vertex, or kNone.
std::uint32_t LiteralModel::crosses(const Vec3& a, Vec3 b, FrameCounters& counters) noexcept {
  if (resting(a, b)) b = a;
  const geometry::SegmentProbe probe(a, b);
  std::uint32_t found = kNone;
  any_in_cells(a, b, counters, [&](std::uint32_t place) {
    ++counters.box_tests;
    if (!touches(probe, place, counters)) return false;
    found = place;
    return true;
  });
  return found;
}

/// The crossed vertex nearest to the old HIP; ties go to the first in grid order.
std::uint32_t LiteralModel::nearest_crossed(const Vec3& h, const Vec3& before,
                                            FrameCounters& counters) noexcept {
  const Vec3 b = resting(before, h) ? before : h;
  const geometry::SegmentProbe probe(before, b);
  std::uint32_t found = kNone;
  double nearest = 0.0;
  any_in_cells(before, b, counters, [&](std::uint32_t place) {
    ++counters.box_tests;
    const StoredPoint& p = model_.points[place];
    if (!touches(probe, place, counters)) return false;
    const double d = distance_sq(p, before);
    if (found == kNone || d < nearest || (d == nearest && place < found)) {
      found = place;
      nearest = d;
    }
    return false;
  });
  return found;
}

}  // namespace palpate::render
