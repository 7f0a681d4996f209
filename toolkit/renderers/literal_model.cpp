#include "toolkit/renderers/literal_model.h"

#include <cmath>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/render/shading.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::render {
namespace {

using search::Cell;

/// Clearance of the god object sphere from the box's corner, as a share of the half diagonal (the printed
/// "small margin").
constexpr double kSphereMargin = 1e-3;
/// A HIP that moves less than this share of the box per axis rests (the printed "small value"); such moves
/// are a hundredth of the box test's precision.
constexpr double kRestShare = 1e-4;
/// 2^53, the integer range of a double; more sub-segments are indistinguishable.
constexpr double kMaxPieces = 9007199254740992.0;
constexpr std::uint32_t kNone = ~std::uint32_t{0};

[[nodiscard]] bool same(const Cell& a, const Cell& b) noexcept {
  return a.x == b.x && a.y == b.y && a.z == b.z;
}

}  // namespace

void LiteralModel::release_contact(const Vec3& h) noexcept {
  previous_ = h;
  collided_ = false;
}

bool LiteralModel::touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/, SurfaceContact& contact,
                         FrameStatus& status, FrameCounters& counters) noexcept {
  const Vec3 before = previous_;
  previous_ = h;
  // Figure 42. Both branches begin with figure 36, with the segment from the old HIP to this one.
  if (collided_) {
    // The figure then tests the way to the sphere; the text, at t3, the way to the god object.
    if (crosses(before, h, counters)) {
      const Vec3 g = model_.points[god_].at();
      const Vec3 aim = options_.text_form ? g : Vec3(g + sphere_radius(god_) * last_direction_);
      if (!crosses(h, aim, counters)) {
        collided_ = false;
        return false;
      }
    }
    answer(h, god_, status, counters);
  } else {
    const std::uint32_t first = nearest_crossed(h, before, counters);
    if (first == kNone) return false;
    answer(h, first, status, counters);
  }
  contact.hip = h;
  contact.pull = answer_.god_object_mm - h;
  return true;
}

void LiteralModel::answer(const Vec3& h, std::uint32_t from, FrameStatus& status,
                          FrameCounters& counters) noexcept {
  int steps = points::kMaxWalkSteps;
  points::WalkResult end = points::walk(model_, from, h, steps, [](std::uint32_t) {});
  counters.walk_steps += static_cast<std::uint64_t>(points::kMaxWalkSteps - steps);
  if (steps == 0) status = FrameStatus::kBoundHit;
  // Section 3.5.2, then 3.4, then figure 46: friction moves the god object, shading reads the points around
  // it, deformation scales the rigid force there. The moved god object is the only one: the next walk starts
  // from it, and the sphere shares its point.
  if (collided_ && (body_.surface.features & kFriction) != 0) {
    const std::uint32_t rolled = roll_back_friction(
        end.place, god_, h, body_.surface.static_friction(god_), points::kMaxWalkSteps,
        [this](std::uint32_t p) { return model_.points[p].at(); },
        [this](std::uint32_t p, auto&& use) {
          for (const std::uint32_t other : model_.neighbours[p]) use(other);
        });
    if (rolled != end.place) {
      end.place = rolled;
      end.load_neighbours(model_, h);
    }
  }
  god_ = end.place;
  collided_ = true;
  const Vec3 g = model_.points[god_].at();
  Vec3 pull = g - h;
  const double length = pull.norm();
  // The sphere's side is the direction of the last contact's pull.
  if (length > 0.0) last_direction_ = pull / length;
  if (shading_ != Shading::kNone) {
    const points::NearestTwo two = points::nearest_two(model_, end);
    pull = shaded_vector(shading_, h, g, model_.points[two.first].at(), model_.points[two.second].at());
  }
  const double stiffness = (body_.surface.features & kVaried) != 0
                               ? static_cast<double>(body_.surface.by_point[god_].stiffness_n_per_mm)
                               : body_.surface.stiffness_n_per_mm;
  answer_ = {stiffness * pull, g};
}

double LiteralModel::sphere_radius(std::uint32_t place) const noexcept {
  return model_.half_box(place).norm() * (1.0 + kSphereMargin);
}

/// Calls test(place) for points of the rule's cells until it returns true.
template <class Test>
bool LiteralModel::any_in_cells(const Vec3& a, const Vec3& b, FrameCounters& counters,
                                Test&& test) const noexcept {
  const auto in_cell = [&](const Cell& cell) {
    ++counters.cells_visited;
    const search::IndexRange range = model_.grid.find(cell);
    for (std::uint32_t place = range.begin; place < range.end; ++place)
      if (test(place)) return true;
    return false;
  };
  if (options_.cells != CellRule::kSampled || model_.sphere_mm > 0.0) {
    Vec3 reach = options_.cells == CellRule::kAdjacent ? model_.largest_half_box_mm : Vec3(Vec3::Zero());
    reach += Vec3::Constant(model_.sphere_mm);  // a swept sphere crosses cells with its volume
    return !visit_cells(model_.grid, a, b, reach, [&](const Cell& cell) { return !in_cell(cell); });
  }
  return any_sampled(a, b, in_cell);
}

/// Calls test(cell), until it returns true, for the cells of section 3.1.3: those at the starts of
/// sub-segments at most one cell long, and that at the end of the last one.
template <class Test>
bool LiteralModel::any_sampled(const Vec3& a, const Vec3& b, Test&& test) const noexcept {
  const Vec3 d = b - a;
  const double pieces = std::max(1.0, std::ceil(d.norm() / model_.grid.cell_mm()));
  if (!(pieces < kMaxPieces)) return false;
  // Samples only the part of the segment inside the cloud's box, so the grid bounds the count for a far HIP
  // too.
  const double most = 4.0 * static_cast<double>(model_.grid.last_cell() + 2);
  double t0 = 0.0, t1 = 1.0;
  if (pieces > most && !clip(a, d, t0, t1)) return false;
  const double first = std::floor(t0 * pieces), last = std::min(std::ceil(t1 * pieces), first + most);
  Cell before{-1, -1, -1};  // no such cell
  for (double i = first; i <= last; ++i) {
    const Cell cell = model_.grid.cell_of(i == pieces ? b : Vec3(a + (i / pieces) * d));
    if (same(cell, before)) continue;
    if (test(cell)) return true;
    before = cell;
  }
  return false;
}

/// The part [t0, t1] of a + t d inside the grid.
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

bool LiteralModel::resting(const Vec3& a, const Vec3& b) const noexcept {
  return ((b - a).cwiseAbs().array() < kRestShare * model_.largest_half_box_mm.array()).all();
}

/// The test of section 3.1.1.2, or the swept sphere of 3.1.4.
bool LiteralModel::touches(const geometry::SegmentProbe& probe, std::uint32_t place,
                           FrameCounters& counters) const noexcept {
  const Vec3 centre = model_.points[place].at(), half = model_.half_box(place);
  const bool crossed = geometry::segment_touches_box(probe, centre, half);
  if (crossed || !(model_.sphere_mm > 0.0)) return crossed;
  if (!geometry::swept_sphere_touches_box(probe, model_.sphere_mm, centre, half)) return false;
  ++counters.sphere_only;
  return true;
}

/// True if the segment crosses any vertex AABB.
bool LiteralModel::crosses(const Vec3& a, Vec3 b, FrameCounters& counters) const noexcept {
  if (resting(a, b)) b = a;
  const geometry::SegmentProbe probe(a, b);
  return any_in_cells(a, b, counters, [&](std::uint32_t place) {
    ++counters.box_tests;
    return touches(probe, place, counters);
  });
}

/// The crossed vertex nearest to the old HIP; ties go to the first in grid order.
std::uint32_t LiteralModel::nearest_crossed(const Vec3& h, const Vec3& before,
                                            FrameCounters& counters) const noexcept {
  const Vec3 b = resting(before, h) ? before : h;
  const geometry::SegmentProbe probe(before, b);
  std::uint32_t found = kNone;
  double nearest = 0.0;
  any_in_cells(before, b, counters, [&](std::uint32_t place) {
    ++counters.box_tests;
    const points::StoredPoint& p = model_.points[place];
    if (!touches(probe, place, counters)) return false;
    const double d = points::distance_sq(p, before);
    if (found == kNone || d < nearest || (d == nearest && place < found)) {
      found = place;
      nearest = d;
    }
    return false;
  });
  return found;
}

}  // namespace palpate::render
