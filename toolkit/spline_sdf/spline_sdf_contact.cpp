#include "toolkit/spline_sdf/spline_sdf_contact.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/simd.h"
#include "toolkit/geometry/god_object_check.h"
#include "toolkit/spline_sdf/spline.h"
#include "toolkit/spline_sdf/spline_sdf_contact.inl"

namespace palpate::spline_sdf {

using namespace render;

namespace {

/// A Newton step of at most this length leaves an error of its square times the curvature's change over a
/// voxel: about 1e-5 voxels.
constexpr double kSettled = 0.01;
/// Steps of the fast path: one for a good guess, plus one.
constexpr int kQuickSteps = 3;
constexpr double kShortestStep = 1e-4;
/// Distances may grow by rounding: single-precision distances of some voxels are accurate to 1e-6 voxels.
constexpr double kNoFarther = 1.0 + 1e-6, kRounding = 4e-6;
/// The HIP is outside once above the surface by more than the surface's accuracy.
constexpr double kOut = 1e-5;
/// Marching step as a share of the distance, allowed by the spline's slope of about one; at least a quarter
/// of a voxel of the smallest bricks.
constexpr double kMinMarch = 0.25 / (1 << (BrickGrid::kFineLevels - 1));
/// Overstep of a wall, so that the place belongs to the next cube.
constexpr double kPastWall = 1e-6;
constexpr int kRootSteps = 12;
constexpr double kRootError = 1e-5;
/// Least clearance of a HIP that came out.
constexpr double kClearOf = 0.05, kClearOfMost = 0.8;
/// Within 60 degrees of the normal a HIP is in front of the place, whatever the surface does nearby.
constexpr double kInFrontCosine = 0.5;
/// A replay begins inside a piece only if it begins deeper than this many spacings: the surface errs by a
/// third of one at edges of thin walls, and the whole piece would be felt from the wrong side.
constexpr double kSurelyInside = 0.5;
/// Solid angle threshold as a share of the sphere: 1 inside a closed piece, 0 outside.
constexpr double kHalfOfAll = 0.5;
/// HIPs farther away cannot be indexed in cubes.
constexpr double kFar = 1e8;

bool is_far(const Vec3& at) noexcept {
  return !(at.cwiseAbs().maxCoeff() < kFar);
}

/// Distance along a direction to the walls of the largest cube around `at`, as a share of its length.
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

BrickPosition SplineSdfContact::place_in(const BrickRef& place, const Vec3& at) const noexcept {
  BrickPosition out;
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

bool SplineSdfContact::may_touch(const BrickRef& place, const Vec3& at) const noexcept {
  return (grid_->bricks[place.brick].mask & mask_bit(place_in(place, at))) != 0;
}

void SplineSdfContact::hold_at(const Vec3& at, const BrickRef& place, const Jet& jet, float side) noexcept {
  contact_ = true;
  frames_unchecked_ = 0;
  follows_ = false;
  god_ = at;
  moved_ = Vec3::Zero();
  place_ = place;
  side_ = side;
  normal_ = jet.gradient.cast<double>().normalized();
}

void SplineSdfContact::start_from(const Vec3& h_mm) noexcept {
  contact_ = in_front_ = false;
  clear_ = -1.0;
  tested_to_ = grid_->in_voxels(h_mm);
}

void SplineSdfContact::restart(const Vec3& h_mm) noexcept {
  start_from(h_mm);
  const BrickRef place = is_far(tested_to_) ? BrickRef{} : grid_->find(tested_to_);
  for (std::size_t piece = 1; piece < free_side_.size(); ++piece) {
    const ClosedComponent& closed = grid_->closed_components[piece - 1];
    const float outside = closed.normal_orientation;
    bool inside = false;
    // Next to the surface the distance decides, elsewhere the piece's solid angle.
    if (place.brick != BrickGrid::kNone && grid_->bricks[place.brick].piece == piece)
      inside = static_cast<double>(value_at(place, place_in(place, tested_to_)) * outside) <
               -kSurelyInside * spacing_;
    else
      inside = std::abs(closed.parts.winding_number(tested_to_)) > kHalfOfAll;
    free_side_[piece] = inside ? -outside : outside;
  }
}

bool SplineSdfContact::update(const Vec3& h_mm, FrameCounters& counters) noexcept {
  bound_hit_ = false;
  const Vec3 h = grid_->in_voxels(h_mm);
  if (contact_) {
    if (!follow_quickly(h) && !update_slowly(h, counters)) return false;
    const double next_to = geometry::kAdjacentSpacings * spacing_;
    if ((h - god_).squaredNorm() <= next_to * next_to)
      follows_ = false;
    else if (++frames_unchecked_ % geometry::kFollowPeriodFrames == 0)
      check_held_position(h);
    return contact_;
  }
  if ((h - free_centre_).squaredNorm() < clear_ * clear_ && clear_ > 0.0) {
    tested_to_ = h;
    return false;
  }
  return update_slowly(h, counters);
}

/// The fast path of most contact frames: extrapolates the god object and corrects it by one or two Newton
/// steps. False, with nothing changed, if it gets no nearer or the HIP came out.
[[gnu::always_inline]] inline bool SplineSdfContact::follow(const Vec3& h) noexcept {
  Vec3 at = god_ + moved_;
  BrickRef place = place_;
  Jet jet;
  for (int i = 0; i < kQuickSteps; ++i) {
    if (!query(at, place, jet)) return false;
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
PALPATE_AVX2 bool SplineSdfContact::follow_avx2(const Vec3& h) noexcept {
  return follow(h);
}
#endif

/// One source, bit-identical for both; AVX2 takes a fifth fewer instructions.
bool SplineSdfContact::follow_quickly(const Vec3& h) noexcept {
#if defined(__x86_64__)
  if (wide_) return follow_avx2(h);
#endif
  return follow(h);
}

/// Steps that each move the god object nearer to the HIP on its sheet, to the minimum.
SplineSdfContact::Stay SplineSdfContact::descend(const Vec3& h, int& steps,
                                                 FrameCounters& counters) noexcept {
  const Vec3 start = god_;
  Jet jet;
  if (!query(god_, place_, jet)) return Stay::kPastBorder;
  double longest = kLongestStep;
  const auto is_out = [&](const Vec3& normal) {
    return (h - god_).dot(normal) * static_cast<double>(side_) > kOut;
  };
  while (steps > 0) {
    const NewtonStep s = newton_step(jet, h - god_, longest);
    normal_ = s.normal;
    if (s.along.squaredNorm() < kSettled * kSettled && std::abs(s.lift) < kSettled) {
      // Bricks of two sizes differ by some hundredths of a spacing; a step over their wall must not go
      // uphill.
      const Vec3 at = god_ + s.along + s.normal * s.lift;
      if ((h - at).squaredNorm() <= (h - start).squaredNorm() * kNoFarther) god_ = at;
      moved_ = god_ - start;
      return is_out(s.normal) ? Stay::kOut : Stay::kHeld;
    }
    // The step, then back to the surface.
    Vec3 at = god_ + s.along + s.normal * s.lift;
    BrickRef place = place_;
    Jet there;
    bool on = false;
    for (int back = 0; back < 3 && steps > 0; ++back) {
      --steps;
      ++counters.walk_steps;
      if (!query(at, place, there)) break;
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
      // No surface there: a shorter step, or the border.
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

/// A clear place: the HIP, or one above the god object, confirmed by the field. False if none.
bool SplineSdfContact::find_clear(const Vec3& h, Vec3& clear) const noexcept {
  BrickRef place = place_;
  Jet jet;
  for (double above = kClearOf; above <= kClearOfMost; above *= 2.0) {
    const bool near = (h - god_).squaredNorm() <= above * above;
    clear = near ? h : Vec3(god_ + normal_ * (static_cast<double>(side_) * above));
    if (query(clear, place, jet) && jet.value * side_ > 0.0f) return true;
  }
  return false;
}

bool SplineSdfContact::update_slowly(const Vec3& h, FrameCounters& counters) noexcept {
  if (is_far(h)) {
    start_from(grid_->low_mm + h * grid_->voxel_mm);
    return false;
  }
  int steps = most_steps_;
  for (int entry = 0; entry < kMaxEntriesPerFrame; ++entry) {
    if (contact_) {
      switch (descend(h, steps, counters)) {
        case Stay::kHeld:
          return true;
        case Stay::kBound:
          bound_hit_ = true;
          return true;
        case Stay::kPastBorder:
          // A tight piece has no border: where bricks end the god object waits and the field decides, except
          // for a HIP plainly in front.
          if (is_tight(place_)) {
            const Vec3 way = h - god_;
            if (way.dot(normal_) * static_cast<double>(side_) > kInFrontCosine * way.norm()) {
              tested_to_ = h;
              break;
            }
            moved_ = Vec3::Zero();
            return true;
          }
          // If the HIP is behind a surface that continues above it, that surface holds it.
          if (hold_if_behind(h)) return true;
          // Another sheet may lie between the border and the HIP; the test starts slightly behind the own
          // sheet, which is then not met again.
          tested_to_ = god_ - normal_ * (static_cast<double>(side_) * kClearOf);
          break;
        case Stay::kOut:
          // Tests its way out from a place clear of the surface.
          if (!find_clear(h, tested_to_)) {
            // Between close sheets no such place may be clear. A near HIP stays in contact; one out of reach
            // is free, else it would be held for ever.
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

/// The root between two places of a segment with opposite signs.
bool SplineSdfContact::crossing(const Vec3& from, const Vec3& way, double low, double high, double f_low,
                                double f_high, double& at) noexcept {
  // Illinois method: false position that does not stall at one end.
  double a = low, fa = f_low, z = high, fz = f_high;
  BrickRef place;
  for (int i = 0; i < kRootSteps && std::abs(fz) > kRootError; ++i) {
    const double t = (a * fz - z * fa) / (fz - fa);
    place = grid_->find(from + way * t);
    if (place.brick == BrickGrid::kNone) return false;
    const auto ft = static_cast<double>(value_at(place, place_in(place, from + way * t)));
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

/// Free: finds the first surface crossing of the segment. Without one the segment is tested.
bool SplineSdfContact::find_entry(const Vec3& h, FrameCounters& counters) noexcept {
  const Vec3 from = tested_to_, way = h - from;
  // A segment of zero length has one place.
  const double length = way.norm(), per = 1.0 / std::max(length, kMinMarch);
  double at = 0.0, before = 0.0, f_before = 0.0;
  bool known = false;
  int values = kMaxSegmentSamples;
  for (int looks = 0;; ++looks) {
    if (looks == kMaxBrickLookups || values <= 0) {
      bound_hit_ = true;
      tested_to_ = from + way * at;
      return false;
    }
    ++counters.cells_visited;
    const Vec3 place_at = from + way * at;
    BrickRef place = grid_->find(place_at);
    if (place.brick == BrickGrid::kNone) {
      known = false;
      if (at >= 1.0) break;
      at = std::min(at + to_wall(grid_->cube_edge(), place_at, way) + kPastWall * per, 1.0);
      continue;
    }
    --values;
    const auto f = static_cast<double>(value_at(place, place_in(place, place_at)));
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
    at = std::min(at + std::max(kMarchShare * std::abs(f), kMinMarch) * per, 1.0);
  }
  tested_to_ = h;
  update_free_radius(h);
  return false;
}

}  // namespace palpate::spline_sdf
