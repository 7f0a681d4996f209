#include "toolkit/heightfield/heightfield_crossing.h"

#include <algorithm>

namespace palpate::heightfield {
namespace {

constexpr std::int32_t kBlock = static_cast<std::int32_t>(cloud::HeightField::kBlock);
constexpr double kNever = std::numeric_limits<double>::infinity();

/// Height over the patch along a stretch, f0 + b u + a u^2 for u in [0, 1].
struct Rise {
  double f0 = 0.0, b = 0.0, a = 0.0;
  [[nodiscard]] double end() const noexcept { return f0 + b + a; }
  [[nodiscard]] Rise negated() const noexcept { return {-f0, -b, -a}; }
  /// The rest of the stretch after the zero at u.
  [[nodiscard]] Rise after_zero(double u) const noexcept {
    const double rest = 1.0 - u;
    return {0.0, (b + 2.0 * a * u) * rest, a * rest * rest};
  }
};

/// The first u at which f, not below 0 at u = 0, falls below 0; else kNever. It exists whenever the end is
/// below 0.
double first_fall(const Rise& f) noexcept {
  const bool ends_below = f.end() < 0.0;
  if (!ends_below && !(f.a > 0.0 && f.b < 0.0 && -f.b < 2.0 * f.a)) return kNever;
  const double disc = f.b * f.b - 4.0 * f.a * f.f0;
  if (!(disc >= 0.0)) return ends_below ? 1.0 : kNever;
  if (!ends_below && disc == 0.0) return kNever;  // only touches
  const double root = std::sqrt(disc);
  // Two forms of the same root, both free of cancellation.
  const double u = f.b <= 0.0 ? 2.0 * f.f0 / (root - f.b) : -(f.b + root) / (2.0 * f.a);
  return std::isfinite(u) ? std::clamp(u, 0.0, 1.0) : (f.f0 > 0.0 ? 1.0 : 0.0);
}

/// The part of a + t d over the field's rectangle; false if none.
bool clip(const HeightFieldView& sheet, const PlanPoint& a, const PlanPoint& d, double& t0,
          double& t1) noexcept {
  const double at[2] = {a.x, a.y}, step[2] = {d.x, d.y};
  const double last[2] = {static_cast<double>(sheet.columns - 1), static_cast<double>(sheet.rows - 1)};
  for (int axis = 0; axis < 2; ++axis) {
    if (step[axis] == 0.0) {
      if (!(at[axis] >= 0.0 && at[axis] <= last[axis])) return false;
      continue;
    }
    const double s = -at[axis] / step[axis], e = (last[axis] - at[axis]) / step[axis];
    t0 = std::max(t0, std::min(s, e));
    t1 = std::min(t1, std::max(s, e));
  }
  return t0 <= t1;
}

/// The segment's state while it crosses cells.
struct Walk {
  const HeightFieldView& sheet;
  PlanPoint a, d;
  std::int32_t column = 0, row = 0;
  double t = 0.0;

  Walk(const HeightFieldView& of, const PlanPoint& from, const PlanPoint& to) noexcept
      : sheet(of), a(from), d{to.x - from.x, to.y - from.y, to.z - from.z} {}

  [[nodiscard]] PlanPoint point(double at) const noexcept {
    return {a.x + at * d.x, a.y + at * d.y, a.z + at * d.z};
  }
  void enter(double at) noexcept {
    t = at;
    const PlanPoint p = point(at);
    column = static_cast<std::int32_t>(std::clamp(std::floor(p.x), 0.0, sheet.columns - 2.0));
    row = static_cast<std::int32_t>(std::clamp(std::floor(p.y), 0.0, sheet.rows - 2.0));
  }
  /// Where the segment leaves the cells [low_x, high_x) x [low_y, high_y), if before `end`; `out_x`, `out_y`
  /// name the wall.
  [[nodiscard]] double leaves(std::int32_t low_x, std::int32_t high_x, std::int32_t low_y,
                              std::int32_t high_y, double end, int& out_x, int& out_y) const noexcept {
    out_x = out_y = 0;
    const double tx = d.x > 0.0 ? (high_x - a.x) / d.x : d.x < 0.0 ? (low_x - a.x) / d.x : kNever;
    const double ty = d.y > 0.0 ? (high_y - a.y) / d.y : d.y < 0.0 ? (low_y - a.y) / d.y : kNever;
    const double least = std::min(tx, ty);
    if (!(least < end)) return end;
    if (tx <= ty)
      out_x = d.x > 0.0 ? 1 : -1;
    else
      out_y = d.y > 0.0 ? 1 : -1;
    return std::max(t, least);
  }
};

/// Height of the segment over a patch between t0 and t1.
Rise rise_over(const Walk& walk, const BilinearPatch& patch, double t0, double t1) noexcept {
  const PlanPoint p = walk.point(t0), q = walk.point(t1);
  const double s0 = p.x - walk.column, u0 = p.y - walk.row;
  const double s1 = q.x - walk.column, u1 = q.y - walk.row;
  const double a = -patch.d * (s1 - s0) * (u1 - u0);
  const double f0 = p.z - patch.height(s0, u0), f1 = q.z - patch.height(s1, u1);
  return {f0, f1 - f0 - a, a};
}

/// The first stretch of a segment that leaves the sheet at `position`: starts at height 0, not falling.
Rise rise_from_sheet(const Walk& walk, const BilinearPatch& patch, const CellPosition& position,
                     double t1) noexcept {
  const double ds = t1 * walk.d.x, dt = t1 * walk.d.y;
  const double s = position.column + position.s - walk.column, t = position.row + position.t - walk.row;
  const double a = -patch.d * ds * dt;
  const double b = t1 * walk.d.z - (patch.b + patch.d * t) * ds - (patch.c + patch.d * s) * dt;
  return {0.0, std::max(0.0, b), a};
}

/// Updates the side over one cell; returns the hit's place in [0, 1], or kNever.
double pass(Rise rise, SheetSide& side, int& edges) noexcept {
  if (side == SheetSide::kNowhere) {
    side = rise.f0 >= 0.0 ? SheetSide::kAbove : SheetSide::kUnder;
    edges += side == SheetSide::kUnder;
  }
  if (side == SheetSide::kAbove) {
    // Known to be above: going below now is a crossing here.
    rise.f0 = std::max(0.0, rise.f0);
    return first_fall(rise);
  }
  Rise under = rise.negated();
  under.f0 = std::max(0.0, under.f0);
  const double out = first_fall(under);
  if (out == kNever) return kNever;
  side = SheetSide::kAbove;
  const double again = first_fall(rise.after_zero(out));
  return again == kNever ? kNever : out + again * (1.0 - out);
}

void set_hit(const Walk& walk, double at, Crossing& found) noexcept {
  const PlanPoint p = walk.point(at);
  found.hit = true;
  found.position = {walk.column, walk.row, std::clamp(p.x - walk.column, 0.0, 1.0),
                    std::clamp(p.y - walk.row, 0.0, 1.0)};
  found.reached = p;
  found.side = SheetSide::kAbove;
}

/// If the block around the walk's cell lies below the segment, leaves it in one step; else false.
bool skip_block(Walk& walk, double end, bool& done) noexcept {
  const HeightFieldView& sheet = walk.sheet;
  const std::int32_t x = walk.column / kBlock, y = walk.row / kBlock;
  const std::int32_t high_x = std::min((x + 1) * kBlock, sheet.columns - 1);
  const std::int32_t high_y = std::min((y + 1) * kBlock, sheet.rows - 1);
  int out_x = 0, out_y = 0;
  const double leave = walk.leaves(x * kBlock, high_x, y * kBlock, high_y, end, out_x, out_y);
  const double top = static_cast<double>(sheet.top[static_cast<std::ptrdiff_t>(y) * sheet.block_columns + x]);
  if (!(std::min(walk.point(walk.t).z, walk.point(leave).z) > top)) return false;
  walk.t = leave;
  done = out_x == 0 && out_y == 0;
  const PlanPoint p = walk.point(leave);
  // The crossed wall is known exactly; along it the place is clamped to the block.
  walk.column = out_x > 0   ? high_x
                : out_x < 0 ? x * kBlock - 1
                            : static_cast<std::int32_t>(
                                  std::clamp(std::floor(p.x), static_cast<double>(x * kBlock), high_x - 1.0));
  walk.row = out_y > 0   ? high_y
             : out_y < 0 ? y * kBlock - 1
                         : static_cast<std::int32_t>(
                               std::clamp(std::floor(p.y), static_cast<double>(y * kBlock), high_y - 1.0));
  return true;
}

}  // namespace

SheetSide side_of(const HeightFieldView& sheet, const PlanPoint& p) noexcept {
  if (!(p.x >= 0.0 && p.x <= sheet.columns - 1.0 && p.y >= 0.0 && p.y <= sheet.rows - 1.0))
    return SheetSide::kNowhere;
  Walk walk(sheet, p, p);
  walk.enter(0.0);
  const BilinearPatch patch = sheet.patch(walk.column, walk.row);
  if (!patch.exists()) return SheetSide::kNowhere;
  return p.z >= patch.height(p.x - walk.column, p.y - walk.row) ? SheetSide::kAbove : SheetSide::kUnder;
}

Crossing find_crossing(const HeightFieldView& sheet, const PlanPoint& a, const PlanPoint& b, SheetSide side,
                       const CellPosition* from_sheet, int& tests_left) noexcept {
  Crossing found;
  found.reached = b;
  double t0 = 0.0, t1 = 1.0;
  Walk walk(sheet, a, b);
  if (std::min(a.z, b.z) > sheet.high_mm) {
    found.side = SheetSide::kAbove;
    return found;
  }
  if (!clip(sheet, a, walk.d, t0, t1)) return found;
  if (t0 > 0.0) side = SheetSide::kNowhere;
  walk.enter(t0);
  if (from_sheet != nullptr) {
    walk.column = from_sheet->column;
    walk.row = from_sheet->row;
  }
  while (true) {
    if (tests_left-- <= 0) {
      found.cut = true;
      found.reached = walk.point(walk.t);
      found.side = side;
      return found;
    }
    bool done = false;
    // A position between cells leaves the first one at once.
    const bool first = from_sheet != nullptr && walk.t == 0.0;
    if (!first && skip_block(walk, t1, done)) {
      side = SheetSide::kAbove;
    } else {
      int out_x = 0, out_y = 0;
      const double leave =
          walk.leaves(walk.column, walk.column + 1, walk.row, walk.row + 1, t1, out_x, out_y);
      const BilinearPatch patch = sheet.patch(walk.column, walk.row);
      if (!patch.exists()) {
        side = SheetSide::kNowhere;
      } else {
        const Rise rise =
            first ? rise_from_sheet(walk, patch, *from_sheet, leave) : rise_over(walk, patch, walk.t, leave);
        if (const double at = pass(rise, side, found.edges); at != kNever) {
          set_hit(walk, walk.t + at * (leave - walk.t), found);
          return found;
        }
      }
      walk.t = leave;
      walk.column += out_x;
      walk.row += out_y;
      done = out_x == 0 && out_y == 0;
    }
    if (done || !sheet.has_cell(walk.column, walk.row)) break;
  }
  found.side = t1 < 1.0 ? SheetSide::kNowhere : side;
  return found;
}

namespace {

/// A shorter Newton step, in cells, leaves an error of its square: 1e-12.
constexpr double kLastStep = 0x1p-20;
/// A step shorter than this share of a cell is none.
constexpr double kNoStep = 0x1p-40;

/// Indexes the sets of walls that hold a position from 0: 4 wall_s + wall_t + this.
constexpr int kNoWalls = 5;

/// A cell during a descent.
struct Cell {
  const HeightFieldView& sheet;
  BilinearPatch patch;
  double hs, ht, hz;

  Cell(const HeightFieldView& of, const CellPosition& position, const PlanPoint& h) noexcept
      : sheet(of),
        patch(of.patch_or_none(position.column, position.row)),
        hs(h.x - position.column),
        ht(h.y - position.row),
        hz(h.z) {}

  [[nodiscard]] DistanceDerivatives jet(double s, double t) const noexcept {
    return {sheet, patch, s, t, hs, ht, hz};
  }
  [[nodiscard]] double half_sq(double s, double t) const noexcept {
    const double x = s - hs, y = t - ht, z = patch.height(s, t) - hz;
    return 0.5 * (sheet.x_sq * (x * x) + sheet.y_sq * (y * y) + z * z);
  }
  /// The nearest point of the line t = constant; exact, because the patch is straight along it.
  [[nodiscard]] double best_s(double t) const noexcept {
    const double slope = patch.b + patch.d * t;
    const double at_0 = patch.a + patch.c * t;
    return std::clamp((sheet.x_sq * hs + slope * (hz - at_0)) / (sheet.x_sq + slope * slope), 0.0, 1.0);
  }
  [[nodiscard]] double best_t(double s) const noexcept {
    const double slope = patch.c + patch.d * s;
    const double at_0 = patch.a + patch.b * s;
    return std::clamp((sheet.y_sq * ht + slope * (hz - at_0)) / (sheet.y_sq + slope * slope), 0.0, 1.0);
  }
};

/// The wall of [0, 1] that the gradient presses against: -1, 0 or 1.
int pressed(double at, double gradient) noexcept {
  if (at == 0.0 && gradient >= 0.0) return -1;
  if (at == 1.0 && gradient <= 0.0) return 1;
  return 0;
}

/// Tries the cell across the holding walls and moves into it if it continues downhill. Sets `rim` at a wall
/// without a cell behind.
bool cross(const HeightFieldView& sheet, CellPosition& position, const PlanPoint& h, int wall_s, int wall_t,
           bool& rim) noexcept {
  if (wall_s != 0) {
    const CellPosition next{position.column + wall_s, position.row, wall_s < 0 ? 1.0 : 0.0, position.t};
    const Cell cell(sheet, next, h);
    if (!cell.patch.exists()) {
      rim = true;
    } else if (wall_s * cell.jet(next.s, next.t).gs < 0.0) {
      position = next;
      return true;
    }
  }
  if (wall_t != 0) {
    const CellPosition next{position.column, position.row + wall_t, position.s, wall_t < 0 ? 1.0 : 0.0};
    const Cell cell(sheet, next, h);
    if (!cell.patch.exists()) {
      rim = true;
    } else if (wall_t * cell.jet(next.s, next.t).gt < 0.0) {
      position = next;
      return true;
    }
  }
  return false;
}

/// The part of a step from `at` that stays in [0, 1], at most `most`.
double reach(double at, double step, double most) noexcept {
  if (step > 0.0) return std::min(most, (1.0 - at) / step);
  if (step < 0.0) return std::min(most, -at / step);
  return most;
}

enum class Moved : std::uint8_t { kNot, kArrived, kOn };

/// The Newton step in a convex place, up to the first wall. kNot if it does not descend.
Moved newton(const Cell& cell, const DistanceDerivatives& jet, CellPosition& position) noexcept {
  const double det = jet.determinant();
  if (!(det > 0.0)) return Moved::kNot;
  const double ds = -(jet.htt * jet.gs - jet.hst * jet.gt) / det;
  const double dt = -(jet.hss * jet.gt - jet.hst * jet.gs) / det;
  const double part = reach(position.t, dt, reach(position.s, ds, 1.0));
  const double size = std::max(std::abs(ds), std::abs(dt));
  // The clamp removes rounding, so a wall is met exactly.
  double s = std::clamp(position.s + part * ds, 0.0, 1.0), t = std::clamp(position.t + part * dt, 0.0, 1.0);
  if (part < 1.0) {
    if (ds != 0.0 && part == reach(position.s, ds, 1.0)) s = ds > 0.0 ? 1.0 : 0.0;
    if (dt != 0.0 && part == reach(position.t, dt, 1.0)) t = dt > 0.0 ? 1.0 : 0.0;
  }
  if (part == 1.0 && size < kLastStep) {
    position.s = s;
    position.t = t;
    return Moved::kArrived;
  }
  if (!(part > 0.0) || !(cell.half_sq(s, t) < cell.half_sq(position.s, position.t))) return Moved::kNot;
  position.s = s;
  position.t = t;
  return Moved::kOn;
}

/// Alternates exact minima along s and t: always downhill, also for non-convex distances.
Moved along_axes(const Cell& cell, CellPosition& position, bool free_s, bool free_t) noexcept {
  const double s = free_s ? cell.best_s(position.t) : position.s;
  const double t = free_t ? cell.best_t(s) : position.t;
  const double size = std::max(std::abs(s - position.s), std::abs(t - position.t));
  position.s = s;
  position.t = t;
  // One free coordinate: its minimum is found.
  if (free_s != free_t) return Moved::kArrived;
  return size > kNoStep ? Moved::kOn : Moved::kArrived;
}

/// At a saddle exactly below the HIP: moves along the direction of negative curvature, either way.
bool leave_saddle(const Cell& cell, const DistanceDerivatives& jet, CellPosition& position) noexcept {
  if (!(jet.determinant() < 0.0)) return false;
  const double ds = 1.0, dt = jet.hst > 0.0 ? -1.0 : 1.0;
  const double forth = reach(position.t, dt, reach(position.s, ds, 1.0));
  const double back = reach(position.t, -dt, reach(position.s, -ds, 1.0));
  const double there = cell.half_sq(position.s + forth * ds, position.t + forth * dt);
  const double behind = cell.half_sq(position.s - back * ds, position.t - back * dt);
  const double way = there <= behind ? forth : -back;
  if (!(std::min(there, behind) < cell.half_sq(position.s, position.t))) return false;
  position.s = std::clamp(position.s + way * ds, 0.0, 1.0);
  position.t = std::clamp(position.t + way * dt, 0.0, 1.0);
  return true;
}

}  // namespace

Descent descend(const HeightFieldView& sheet, CellPosition& position, const PlanPoint& h,
                int& moves) noexcept {
  Descent end;
  int settled = -1;  // walls of the last minimum; -1: none
  for (; moves > 0; --moves) {
    const Cell cell(sheet, position, h);
    const DistanceDerivatives jet = cell.jet(position.s, position.t);
    const int wall_s = pressed(position.s, jet.gs), wall_t = pressed(position.t, jet.gt);
    end.at_rim = false;
    if ((wall_s != 0 || wall_t != 0) && cross(sheet, position, h, wall_s, wall_t, end.at_rim)) {
      settled = -1;
      continue;
    }
    const bool free_s = wall_s == 0, free_t = wall_t == 0;
    const int walls = 4 * wall_s + wall_t + kNoWalls;
    if (settled == walls || (!free_s && !free_t)) {
      if (free_s && free_t && leave_saddle(cell, jet, position)) {
        settled = -1;
        continue;
      }
      end.arrived = true;
      return end;
    }
    Moved moved = free_s && free_t ? newton(cell, jet, position) : Moved::kNot;
    if (moved == Moved::kNot) moved = along_axes(cell, position, free_s, free_t);
    settled = moved == Moved::kArrived ? walls : -1;
  }
  return end;
}

}  // namespace palpate::heightfield
