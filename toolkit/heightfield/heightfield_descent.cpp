#include "toolkit/heightfield/heightfield_crossing.h"

#include <algorithm>

namespace palpate::render {
namespace {

/// A shorter Newton step, in cells, leaves an error of its square: 1e-12.
constexpr double kLastStep = 0x1p-20;
/// A step shorter than this share of a cell is none.
constexpr double kNoStep = 0x1p-40;

/// Indexes the sets of walls that hold a foot from 0: 4 wall_s + wall_t + this.
constexpr int kNoWalls = 5;

/// A cell during a descent.
struct Cell {
  const HeightFieldView& sheet;
  BilinearPatch patch;
  double hs, ht, hz;

  Cell(const HeightFieldView& of, const CellPosition& foot, const PlanPoint& h) noexcept
      : sheet(of),
        patch(of.patch_or_none(foot.column, foot.row)),
        hs(h.x - foot.column),
        ht(h.y - foot.row),
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
bool cross(const HeightFieldView& sheet, CellPosition& foot, const PlanPoint& h, int wall_s, int wall_t,
           bool& rim) noexcept {
  if (wall_s != 0) {
    const CellPosition next{foot.column + wall_s, foot.row, wall_s < 0 ? 1.0 : 0.0, foot.t};
    const Cell cell(sheet, next, h);
    if (!cell.patch.exists()) {
      rim = true;
    } else if (wall_s * cell.jet(next.s, next.t).gs < 0.0) {
      foot = next;
      return true;
    }
  }
  if (wall_t != 0) {
    const CellPosition next{foot.column, foot.row + wall_t, foot.s, wall_t < 0 ? 1.0 : 0.0};
    const Cell cell(sheet, next, h);
    if (!cell.patch.exists()) {
      rim = true;
    } else if (wall_t * cell.jet(next.s, next.t).gt < 0.0) {
      foot = next;
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
Moved newton(const Cell& cell, const DistanceDerivatives& jet, CellPosition& foot) noexcept {
  const double det = jet.determinant();
  if (!(det > 0.0)) return Moved::kNot;
  const double ds = -(jet.htt * jet.gs - jet.hst * jet.gt) / det;
  const double dt = -(jet.hss * jet.gt - jet.hst * jet.gs) / det;
  const double part = reach(foot.t, dt, reach(foot.s, ds, 1.0));
  const double size = std::max(std::abs(ds), std::abs(dt));
  // The clamp removes rounding, so a wall is met exactly.
  double s = std::clamp(foot.s + part * ds, 0.0, 1.0), t = std::clamp(foot.t + part * dt, 0.0, 1.0);
  if (part < 1.0) {
    if (ds != 0.0 && part == reach(foot.s, ds, 1.0)) s = ds > 0.0 ? 1.0 : 0.0;
    if (dt != 0.0 && part == reach(foot.t, dt, 1.0)) t = dt > 0.0 ? 1.0 : 0.0;
  }
  if (part == 1.0 && size < kLastStep) {
    foot.s = s;
    foot.t = t;
    return Moved::kArrived;
  }
  if (!(part > 0.0) || !(cell.half_sq(s, t) < cell.half_sq(foot.s, foot.t))) return Moved::kNot;
  foot.s = s;
  foot.t = t;
  return Moved::kOn;
}

/// Alternates exact minima along s and t: always downhill, also for non-convex distances.
Moved along_axes(const Cell& cell, CellPosition& foot, bool free_s, bool free_t) noexcept {
  const double s = free_s ? cell.best_s(foot.t) : foot.s;
  const double t = free_t ? cell.best_t(s) : foot.t;
  const double size = std::max(std::abs(s - foot.s), std::abs(t - foot.t));
  foot.s = s;
  foot.t = t;
  // One free coordinate: its minimum is found.
  if (free_s != free_t) return Moved::kArrived;
  return size > kNoStep ? Moved::kOn : Moved::kArrived;
}

/// At a saddle exactly below the HIP: moves along the direction of negative curvature, either way.
bool leave_saddle(const Cell& cell, const DistanceDerivatives& jet, CellPosition& foot) noexcept {
  if (!(jet.determinant() < 0.0)) return false;
  const double ds = 1.0, dt = jet.hst > 0.0 ? -1.0 : 1.0;
  const double forth = reach(foot.t, dt, reach(foot.s, ds, 1.0));
  const double back = reach(foot.t, -dt, reach(foot.s, -ds, 1.0));
  const double there = cell.half_sq(foot.s + forth * ds, foot.t + forth * dt);
  const double behind = cell.half_sq(foot.s - back * ds, foot.t - back * dt);
  const double way = there <= behind ? forth : -back;
  if (!(std::min(there, behind) < cell.half_sq(foot.s, foot.t))) return false;
  foot.s = std::clamp(foot.s + way * ds, 0.0, 1.0);
  foot.t = std::clamp(foot.t + way * dt, 0.0, 1.0);
  return true;
}

}  // namespace

Descent descend(const HeightFieldView& sheet, CellPosition& foot, const PlanPoint& h, int& moves) noexcept {
  Descent end;
  int settled = -1;  // walls of the last minimum; -1: none
  for (; moves > 0; --moves) {
    const Cell cell(sheet, foot, h);
    const DistanceDerivatives jet = cell.jet(foot.s, foot.t);
    const int wall_s = pressed(foot.s, jet.gs), wall_t = pressed(foot.t, jet.gt);
    end.at_rim = false;
    if ((wall_s != 0 || wall_t != 0) && cross(sheet, foot, h, wall_s, wall_t, end.at_rim)) {
      settled = -1;
      continue;
    }
    const bool free_s = wall_s == 0, free_t = wall_t == 0;
    const int walls = 4 * wall_s + wall_t + kNoWalls;
    if (settled == walls || (!free_s && !free_t)) {
      if (free_s && free_t && leave_saddle(cell, jet, foot)) {
        settled = -1;
        continue;
      }
      end.arrived = true;
      return end;
    }
    Moved moved = free_s && free_t ? newton(cell, jet, foot) : Moved::kNot;
    if (moved == Moved::kNot) moved = along_axes(cell, foot, free_s, free_t);
    settled = moved == Moved::kArrived ? walls : -1;
  }
  return end;
}

}  // namespace palpate::render
