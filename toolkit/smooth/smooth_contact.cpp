#include "toolkit/smooth/smooth_contact.h"

#include <algorithm>
#include <cmath>

#include "toolkit/geometry/held_place.h"
#include "toolkit/smooth/voxel.h"

namespace palpate::render {
namespace {

/// A Newton step no longer than this leaves an error of about its square times the change of curvature over a
/// voxel: some 1e-5 voxels.
constexpr double kSettled = 0.01;
/// The quick way's steps: one where the guess was right, and one more.
constexpr int kQuickSteps = 3;
/// A step of more than so many voxels is not trusted.
constexpr double kLongestStep = 1.0;
constexpr double kShortestStep = 1e-4;
/// Distances may grow by rounding: single-precision distances of some voxels are right to 1e-6 voxels.
constexpr double kNoFarther = 1.0 + 1e-6, kRounding = 4e-6;
/// The HIP is out once it is above the surface by more than the surface is known to.
constexpr double kOut = 1e-5;
/// A normal step leaves less than this before the next tangential one.
constexpr double kOnSurface = 1e-4;
/// A brick tells of places so many voxels beyond its walls, where no other does.
constexpr double kBeyondWall = 0.25;
/// Along a segment the next place looked at is this share of the distance on, which the spline's slope of
/// about one allows, and at least a quarter of a voxel of the smallest bricks.
constexpr double kMarch = 0.7, kLeastMarch = 0.25 / (1 << (BrickGrid::kFineLevels - 1));
/// A wall is passed by this much: places on it belong to the next cube beyond doubt.
constexpr double kPastWall = 1e-6;
constexpr int kRootSteps = 12;
constexpr double kRootError = 1e-5;
/// What a HIP that came out is clear of the surface by, at least.
constexpr double kClearOf = 0.05, kClearOfMost = 0.8;
/// A HIP behind a closed piece by more than this was not let in: the surface is known to it.
constexpr double kInside = 1e-3;
/// So many spacings behind it at most: what is regained deeper would come as a kick.
constexpr double kRegained = 0.5;
/// Normal steps from a HIP to the surface above it: the first is right to the field's slope, three more to
/// its curvature.
constexpr int kToSurface = 6;
/// Frames between two looks at the HIP's own surroundings: at 1 kHz sooner than a hand feels a pull as wrong
/// (20 ms).
constexpr int kLookEvery = 8;
/// The field's slope is one where it tells of one surface.
constexpr double kTellingSlope = 0.5;
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

/// Of a brick of any size, in the largest ones' voxels: lengths halve exactly.
[[gnu::always_inline]] inline Jet SmoothContact::jet_at(const Place& place,
                                                        const BrickPlace& in) const noexcept {
  Jet jet = spline_jet(grid_->bricks[place.brick], in);
  if (place.level != grid_->coarser) {
    const auto per = static_cast<float>(grid_->per_voxel_of(place.level));
    jet.value /= per;
    for (float& second : jet.second) second *= per;
  }
  return jet;
}

[[gnu::always_inline]] inline bool SmoothContact::look(const Vec3& at, Place& place,
                                                       Jet& jet) const noexcept {
  const Vec3 own = at * grid_->per_voxel_of(place.level);
  const Voxel voxel = voxel_of(own);
  if (place.whole && is_in(voxel, place.cube)) {
    jet = jet_at(place, place_in_voxel(voxel, own));
    return true;
  }
  const Place to = grid_->find(at);
  if (to.brick != BrickGrid::kNone) {
    place = to;
    jet = jet_at(place, place_in(place, at));
    return true;
  }
  // Bricks differ by the rounding of their coefficients: a surface along a wall may be on its other side.
  const Vec3 off =
      own - (Vec3(place.cube[0], place.cube[1], place.cube[2]) + Vec3::Constant(0.5)) * kBrickCells;
  if (off.cwiseAbs().maxCoeff() > 0.5 * kBrickCells + kBeyondWall) return false;
  jet = jet_at(place, place_in(place, at));
  return true;
}

bool SmoothContact::may_touch(const Place& place, const Vec3& at) const noexcept {
  return (grid_->bricks[place.brick].mask & mask_bit(place_in(place, at))) != 0;
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
    if ((h - god_).squaredNorm() > next_to * next_to && ++unlooked_ >= kLookEvery) agree_with(h);
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
          contact_ = true;
          unlooked_ = 0;
          god_ = there;
          moved_ = Vec3::Zero();
          place_ = place;
          side_ = side;
          normal_ = jet_at(place, place_in(place, god_)).gradient.cast<double>().normalized();
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

/// How far the HIP may go before anything can be met. One that is behind a tight piece, and was in front of
/// it before, is in contact: it went through. One that came in through a hole is not.
void SmoothContact::look_where_free(const Vec3& h) noexcept {
  looked_at_ = h;
  const Place place = grid_->find(h);
  if (place.brick == BrickGrid::kNone) {
    in_front_ = false;
    const double edge = grid_->cube_edge();
    clear_ = edge;
    for (Eigen::Index a = 0; a < 3; ++a) {
      const double in = h[a] - edge * std::floor(h[a] / edge);
      clear_ = std::min({clear_, in, edge - in});
    }
    return;
  }
  const Jet jet = jet_at(place, place_in(place, h));
  const float allowed = free_side_[grid_->bricks[place.brick].piece];
  in_front_ = in_front_ || jet.value * allowed > 0.0f;
  const double behind = -static_cast<double>(jet.value * allowed);
  if (in_front_ && is_tight(place) && behind > kInside && behind < kRegained * spacing_) {
    touch_below(h, place, jet, allowed);
    corrected_ = contact_;
    uncorrected_mm_ = Vec3::Zero();
    return;
  }
  clear_ = kMarch * std::abs(static_cast<double>(jet.value));
}

/// Contact at the place of the surface above h, which is behind it.
void SmoothContact::touch_below(const Vec3& h, const Place& place, const Jet& jet, float side) noexcept {
  Vec3 at = h;
  Place there = place;
  Jet here = jet;
  for (int i = 0; i < kToSurface; ++i) {
    const auto size_sq = static_cast<double>(here.gradient.squaredNorm());
    if (!(size_sq > 0.0)) return;
    Vec3 step = here.gradient.cast<double>() * (-static_cast<double>(here.value) / size_sq);
    const double length = step.norm();
    if (length > kLongestStep) step *= kLongestStep / length;
    at += step;
    if (!look(at, there, here)) return;
    if (length < kOnSurface) break;
  }
  if (!may_touch(there, at)) return;
  contact_ = true;
  unlooked_ = 0;
  god_ = at;
  moved_ = Vec3::Zero();
  place_ = there;
  side_ = side;
  normal_ = here.gradient.cast<double>().normalized();
}

/// Contact with the surface above h, where h is behind it as it came to the place held. False, with nothing
/// changed, where it is not, or that surface ends there.
bool SmoothContact::touch_where_behind(const Vec3& h) noexcept {
  const Place place = grid_->find(h);
  if (place.brick == BrickGrid::kNone) return false;
  const Jet jet = jet_at(place, place_in(place, h));
  if (!(static_cast<double>(jet.value * side_) < -kInside)) return false;
  const Vec3 god = god_;
  contact_ = false;
  touch_below(h, place, jet, side_);
  const bool held = contact_;
  if (held) {
    corrected_ = true;
    uncorrected_mm_ = (god - h) * grid_->voxel_mm;
  }
  contact_ = true;
  return held;
}

/// The rule of geometry/held_place.h, looked at once in kLookEvery frames: more often is no sooner than a
/// hand feels.
void SmoothContact::agree_with(const Vec3& h) noexcept {
  unlooked_ = 0;
  const auto side = static_cast<double>(side_);
  const auto look = [&](const Vec3& at) noexcept -> geometry::Surroundings {
    const Place place = grid_->find(at);
    if (place.brick == BrickGrid::kNone) return {};
    const Jet jet = jet_at(place, place_in(place, at));
    const auto size = static_cast<double>(jet.gradient.norm());
    // Half way between two sheets the field has no direction.
    return {size > kTellingSlope, side * static_cast<double>(jet.value),
            jet.gradient.cast<double>() * (side / std::max(size, kTellingSlope))};
  };
  switch (geometry::judge_held_place(h, god_, normal_ * side, spacing_, look)) {
    case geometry::HeldPlace::kKeep:
      return;
    case geometry::HeldPlace::kMove:
      note_correction(h);
      if (const Place place = grid_->find(h); place.brick != BrickGrid::kNone)
        touch_below(h, place, jet_at(place, place_in(place, h)), side_);
      return;
    case geometry::HeldPlace::kFree:
      note_correction(h);
      contact_ = false;
      in_front_ = true;
      clear_ = -1.0;
      tested_to_ = h;
      return;
  }
}

}  // namespace palpate::render
