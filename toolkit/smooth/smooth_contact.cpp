#include "toolkit/smooth/smooth_contact.h"

#include <algorithm>
#include <cmath>

#include "toolkit/geometry/held_place.h"
#include "toolkit/smooth/smooth_contact.inl"
#include "toolkit/smooth/voxel.h"

namespace palpate::render {
namespace {

/// A Newton step no longer than this leaves an error of about its square times the change of curvature over a
/// voxel: some 1e-5 voxels.
constexpr double kSettled = 0.01;
/// The quick way's steps: one where the guess was right, and one more.
constexpr int kQuickSteps = 3;
constexpr double kShortestStep = 1e-4;
/// Distances may grow by rounding: single-precision distances of some voxels are right to 1e-6 voxels.
constexpr double kNoFarther = 1.0 + 1e-6, kRounding = 4e-6;
/// The HIP is out once it is above the surface by more than the surface is known to.
constexpr double kOut = 1e-5;
/// Along a segment the next place looked at is this share of the distance on, which the spline's slope of
/// about one allows, and at least a quarter of a voxel of the smallest bricks.
constexpr double kLeastMarch = 0.25 / (1 << (BrickGrid::kFineLevels - 1));
/// A wall is passed by this much: places on it belong to the next cube beyond doubt.
constexpr double kPastWall = 1e-6;
constexpr int kRootSteps = 12;
constexpr double kRootError = 1e-5;
/// What a HIP that came out is clear of the surface by, at least.
constexpr double kClearOf = 0.05, kClearOfMost = 0.8;
/// Within 60 degrees of the normal a HIP is in front of the place, whatever the surface does beside it.
constexpr double kPlainlyInFront = 0.5;
/// A god object that goes farther in a frame than this many spacings, five times as far as the HIP and by a
/// quarter of the pull (squared) is felt as a step: a hand takes 25 degrees for another direction.
constexpr double kAtOnce = 0.5, kFasterSq = 25.0, kOfPullSq = 1.0 / 16.0;
/// Of all directions a closed piece takes all from inside, none from outside.
constexpr double kHalfOfAll = 0.5;
/// HIPs farther off cannot be counted in cubes.
constexpr double kFar = 1e8;

bool is_far(const Vec3& at) noexcept {
  return !(at.cwiseAbs().maxCoeff() < kFar);
}

/// How far a place is from the walls of the largest bricks' cube around it, along a way: a share of that.
double to_wall(double edge, const Vec3& at, const Vec3& way) noexcept {
  double share = 1.0;
  for (Eigen::Index a = 0; a < 3; ++a) {
    if (way[a] == 0.0) continue;
    const double cube = std::floor(at[a] / edge);
    const double wall = edge * (way[a] > 0.0 ? cube + 1.0 : cube);
    share = std::min(share, (wall - at[a]) / way[a]);
  }
  return share;
}

}  // namespace

BrickPlace SmoothContact::place_in(const Place& place, const Vec3& at) const noexcept {
  BrickPlace out;
  const double per = grid_->per_voxel_of(place.level);
  for (std::size_t a = 0; a < 3; ++a) {
    const double x =
        at[static_cast<Eigen::Index>(a)] * per - kBrickCells * static_cast<double>(place.cube[a]);
    const int cell = std::clamp(static_cast<int>(x), 0, kBrickCells - 1);
    out.cell[a] = cell;
    out.t[a] = static_cast<float>(x - cell);
  }
  return out;
}

bool SmoothContact::may_touch(const Place& place, const Vec3& at) const noexcept {
  return (grid_->bricks[place.brick].mask & mask_bit(place_in(place, at))) != 0;
}

void SmoothContact::hold_at(const Vec3& at, const Place& place, const Jet& jet, float side) noexcept {
  contact_ = true;
  unlooked_ = 0;
  god_ = at;
  moved_ = Vec3::Zero();
  place_ = place;
  side_ = side;
  normal_ = jet.gradient.cast<double>().normalized();
}

void SmoothContact::start_from(const Vec3& h_mm) noexcept {
  contact_ = in_front_ = false;
  clear_ = -1.0;
  tested_to_ = grid_->in_voxels(h_mm);
}

void SmoothContact::restart(const Vec3& h_mm) noexcept {
  start_from(h_mm);
  const Place place = is_far(tested_to_) ? Place{} : grid_->find(tested_to_);
  for (std::size_t piece = 1; piece < free_side_.size(); ++piece) {
    const ClosedPiece& closed = grid_->closed_pieces[piece - 1];
    // Next to the surface its distance tells, elsewhere what the piece takes of all directions.
    if (place.brick != BrickGrid::kNone && grid_->bricks[place.brick].piece == piece) {
      free_side_[piece] = jet_at(place, place_in(place, tested_to_)).value < 0.0f ? -1.0f : 1.0f;
      continue;
    }
    const bool inside = std::abs(geometry::share_around(closed.parts, tested_to_)) > kHalfOfAll;
    free_side_[piece] = inside ? -closed.outer_side : closed.outer_side;
  }
}

bool SmoothContact::update(const Vec3& h_mm, FrameCounters& counters) noexcept {
  bound_hit_ = corrected_ = false;
  const Vec3 h = grid_->in_voxels(h_mm);
  if (contact_) {
    const Vec3 before = god_, from = last_h_;
    last_h_ = h;
    if (!follow_quickly(h) && !update_slowly(h, counters)) return false;
    // Over a rounded edge the god object goes at once, where over a sharp one it waits for the HIP.
    const double step_sq = (god_ - before).squaredNorm(), edge = kAtOnce * spacing_;
    if (step_sq > edge * edge && step_sq > kFasterSq * (h - from).squaredNorm() &&
        step_sq > kOfPullSq * (h - before).squaredNorm()) [[unlikely]] {
      corrected_ = true;
      uncorrected_mm_ = (before - h) * grid_->voxel_mm;
    }
    const double next_to = geometry::kNextToSpacings * spacing_;
    if ((h - god_).squaredNorm() > next_to * next_to && ++unlooked_ >= geometry::kLookEvery) agree_with(h);
    return contact_;
  }
  last_h_ = h;
  if ((h - looked_at_).squaredNorm() < clear_ * clear_ && clear_ > 0.0) {
    tested_to_ = h;
    return false;
  }
  return update_slowly(h, counters);
}

/// In contact, the way nearly all frames go: the god object goes on as it went, and a Newton step or two mend
/// it. False, with nothing changed, where that does not bring it nearer, or the HIP came out.
[[gnu::always_inline]] inline bool SmoothContact::follow(const Vec3& h) noexcept {
  Vec3 at = god_ + moved_;
  Place place = place_;
  Jet jet;
  for (int i = 0; i < kQuickSteps; ++i) {
    if (!look(at, place, jet)) return false;
    const NewtonStep s = newton_step(jet, h - at, kLongestStep);
    at += s.along + s.normal * s.lift;
    const double length_sq = s.along.squaredNorm() + s.lift * s.lift;
    if (!(length_sq < kSettled * kSettled)) continue;
    const Vec3 d = h - at;
    if (!(d.dot(s.normal) * static_cast<double>(side_) < 0.0)) return false;
    if (!(d.squaredNorm() <= (h - god_).squaredNorm() * kNoFarther)) return false;
    const Voxel voxel = voxel_of(at * grid_->per_voxel_of(place.level));
    if (!is_in(voxel, place.cube) || (grid_->bricks[place.brick].mask & mask_bit_of(voxel)) == 0)
      return false;
    moved_ = at - god_;
    god_ = at;
    normal_ = s.normal;
    place_ = place;
    return true;
  }
  return false;
}

#if defined(__x86_64__)
PALPATE_AVX2 bool SmoothContact::follow_wide(const Vec3& h) noexcept {
  return follow(h);
}
#endif

/// The same code and bits for both: with AVX2 the compiler needs a fifth fewer instructions for it.
bool SmoothContact::follow_quickly(const Vec3& h) noexcept {
#if defined(__x86_64__)
  if (wide_) return follow_wide(h);
#endif
  return follow(h);
}

/// Steps that each bring the god object nearer to the HIP on its sheet, until it is as near as it gets.
SmoothContact::Stay SmoothContact::descend(const Vec3& h, int& steps, FrameCounters& counters) noexcept {
  const Vec3 start = god_;
  Jet jet;
  if (!look(god_, place_, jet)) return Stay::kPastBorder;
  double longest = kLongestStep;
  const auto is_out = [&](const Vec3& normal) {
    return (h - god_).dot(normal) * static_cast<double>(side_) > kOut;
  };
  while (steps > 0) {
    const NewtonStep s = newton_step(jet, h - god_, longest);
    normal_ = s.normal;
    if (s.along.squaredNorm() < kSettled * kSettled && std::abs(s.lift) < kSettled) {
      // Bricks of two sizes differ by some hundredths of a spacing: no step over their wall goes uphill.
      const Vec3 at = god_ + s.along + s.normal * s.lift;
      if ((h - at).squaredNorm() <= (h - start).squaredNorm() * kNoFarther) god_ = at;
      moved_ = god_ - start;
      return is_out(s.normal) ? Stay::kOut : Stay::kHeld;
    }
    // The step, and back to the surface.
    Vec3 at = god_ + s.along + s.normal * s.lift;
    Place place = place_;
    Jet there;
    bool on = false;
    for (int back = 0; back < 3 && steps > 0; ++back) {
      --steps;
      ++counters.walk_steps;
      if (!look(at, place, there)) break;
      const auto size_sq = static_cast<double>(there.gradient.squaredNorm());
      if (!(size_sq > 0.0)) break;
      on = true;
      if (static_cast<double>(there.value * there.value) < kOnSurface * kOnSurface * size_sq) break;
      const Vec3 lift = there.gradient.cast<double>() * (-static_cast<double>(there.value) / size_sq);
      if (lift.squaredNorm() > kLongestStep * kLongestStep) {
        on = false;
        break;
      }
      at += lift;
    }
    if (!on) {
      // No surface there: nearer, or the border.
      if (longest <= kShortestStep) return Stay::kPastBorder;
      longest = 0.25 * std::min(longest, s.along.norm());
      if (longest < kOnSurface) return Stay::kPastBorder;
      continue;
    }
    const double before = (h - god_).norm(), after = (h - at).norm();
    if (after > before * kNoFarther + kRounding) {
      longest = 0.25 * std::min(longest, s.along.norm());
      if (longest < kShortestStep) {
        moved_ = Vec3::Zero();
        return is_out(s.normal) ? Stay::kOut : Stay::kHeld;
      }
      continue;
    }
    if (!may_touch(place, at)) return Stay::kPastBorder;
    god_ = at;
    place_ = place;
    jet = there;
  }
  moved_ = Vec3::Zero();
  return Stay::kBound;
}

/// The HIP, or a place above the god object, where the field says so, too. False without one.
bool SmoothContact::find_clear(const Vec3& h, Vec3& clear) const noexcept {
  Place place = place_;
  Jet jet;
  for (double above = kClearOf; above <= kClearOfMost; above *= 2.0) {
    const bool near = (h - god_).squaredNorm() <= above * above;
    clear = near ? h : Vec3(god_ + normal_ * (static_cast<double>(side_) * above));
    if (look(clear, place, jet) && jet.value * side_ > 0.0f) return true;
  }
  return false;
}

bool SmoothContact::update_slowly(const Vec3& h, FrameCounters& counters) noexcept {
  if (is_far(h)) {
    start_from(grid_->low_mm + h * grid_->voxel_mm);
    return false;
  }
  int steps = most_steps_;
  for (int entry = 0; entry < kMaxSmoothEntries; ++entry) {
    if (contact_) {
      switch (descend(h, steps, counters)) {
        case Stay::kHeld:
          return true;
        case Stay::kBound:
          bound_hit_ = true;
          return true;
        case Stay::kPastBorder:
          // A tight piece has none: where no brick goes on the god object waits, and the field decides, but
          // for a HIP that is plainly in front of it.
          if (is_tight(place_)) {
            const Vec3 way = h - god_;
            if (way.dot(normal_) * static_cast<double>(side_) > kPlainlyInFront * way.norm()) {
              tested_to_ = h;
              break;
            }
            moved_ = Vec3::Zero();
            return true;
          }
          // Where the HIP is behind a surface that goes on above it, that holds it.
          if (touch_where_behind(h)) return true;
          // Another sheet may lie between its border and the HIP. From a little behind its own, that is not
          // met again.
          tested_to_ = god_ - normal_ * (static_cast<double>(side_) * kClearOf);
          break;
        case Stay::kOut:
          // Its way out of the surface is still to be tested, from a place that is clear of it.
          if (!find_clear(h, tested_to_)) {
            // Where sheets crowd, none of these places may be clear. A HIP still near stays in contact; one
            // that is out by more than they reach is free, or it would be held for ever.
            if (!((h - god_).squaredNorm() > kClearOfMost * kClearOfMost)) return true;
            tested_to_ = h;
          }
          break;
      }
      contact_ = false;
      in_front_ = true;
      clear_ = -1.0;
    }
    if (is_far(tested_to_)) tested_to_ = h;
    if (!find_entry(h, counters)) return contact_;
  }
  bound_hit_ = true;
  return contact_;
}

/// The root between two places of a segment with distances of different signs.
bool SmoothContact::crossing(const Vec3& from, const Vec3& way, double low, double high, double f_low,
                             double f_high, double& at) noexcept {
  // Illinois: false position that does not hang on one end.
  double a = low, fa = f_low, z = high, fz = f_high;
  Place place;
  for (int i = 0; i < kRootSteps && std::abs(fz) > kRootError; ++i) {
    const double t = (a * fz - z * fa) / (fz - fa);
    place = grid_->find(from + way * t);
    if (place.brick == BrickGrid::kNone) return false;
    const auto ft = static_cast<double>(jet_at(place, place_in(place, from + way * t)).value);
    if ((ft > 0.0) != (fz > 0.0)) {
      a = z;
      fa = fz;
    } else {
      fa *= 0.5;
    }
    z = t;
    fz = ft;
  }
  at = std::clamp(z, low, high);
  return true;
}

/// Free: the first place where the segment goes through the surface. Without one the segment has been tested.
bool SmoothContact::find_entry(const Vec3& h, FrameCounters& counters) noexcept {
  const Vec3 from = tested_to_, way = h - from;
  // A segment without length has one place.
  const double length = way.norm(), per = 1.0 / std::max(length, kLeastMarch);
  double at = 0.0, before = 0.0, f_before = 0.0;
  bool known = false;
  int values = kMaxSegmentValues;
  for (int looks = 0;; ++looks) {
    if (looks == kMaxSmoothLooks || values <= 0) {
      bound_hit_ = true;
      tested_to_ = from + way * at;
      return false;
    }
    ++counters.cells_visited;
    const Vec3 place_at = from + way * at;
    Place place = grid_->find(place_at);
    if (place.brick == BrickGrid::kNone) {
      known = false;
      if (at >= 1.0) break;
      at = std::min(at + to_wall(grid_->cube_edge(), place_at, way) + kPastWall * per, 1.0);
      continue;
    }
    --values;
    const auto f = static_cast<double>(jet_at(place, place_in(place, place_at)).value);
    if (known && (f > 0.0) != (f_before > 0.0)) {
      const float side = f_before > 0.0 ? 1.0f : -1.0f;
      double root = at;
      values -= kRootSteps;
      if (crossing(from, way, before, at, f_before, f, root)) {
        const Vec3 there = from + way * root;
        place = grid_->find(there);
        if (place.brick != BrickGrid::kNone && may_touch(place, there) &&
            free_side_[grid_->bricks[place.brick].piece] * side >= 0.0f) {
          hold_at(there, place, jet_at(place, place_in(place, there)), side);
          return true;
        }
      }
    }
    if (at >= 1.0) break;
    known = true;
    before = at;
    f_before = f;
    at = std::min(at + std::max(kMarch * std::abs(f), kLeastMarch) * per, 1.0);
  }
  tested_to_ = h;
  look_where_free(h);
  return false;
}

}  // namespace palpate::render
