#include "toolkit/smooth/smooth_contact.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "toolkit/core/lanes.h"
#include "toolkit/smooth/layers.h"
#include "toolkit/smooth/newton_step.h"
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
/// Over a crease the step goes on by this share of it, at most: with its lift that is less than the whole.
constexpr double kOverCrease = 0.7;
/// Distances may grow by rounding: single-precision distances of some voxels are right to 1e-6 voxels.
constexpr double kNoFarther = 1.0 + 1e-6, kRounding = 4e-6;
/// The HIP is out once it is above the surface by more than the surface is known to.
constexpr double kOut = 1e-5;
/// A normal step leaves less than this before the next tangential one.
constexpr double kOnSurface = 1e-4;
/// The same sheet goes on where its distance is within a voxel and its normal within 60 degrees; one that
/// stands on its head only where it is the same surface beyond doubt.
constexpr float kSameSheet = 1.0f, kSeam = 0.1f;
constexpr double kSameNormal = 0.5;
/// A brick tells of places so many voxels beyond its walls, where no other does.
constexpr double kBeyondWall = 0.25;
/// Along a segment the next place looked at is this share of the distance on, which the spline's slope of
/// about one allows, and at least a quarter of a voxel.
constexpr double kMarch = 0.7, kLeastMarch = 0.25;
/// Each cube's part of a segment begins this much before its wall: bricks beside each other differ by the
/// rounding of their coefficients, and no root may fall between them.
constexpr double kOverlap = 0.02;
constexpr int kRootSteps = 12;
constexpr double kRootError = 1e-5;
/// What a HIP that came out is clear of the surface by, at least.
constexpr double kClearOf = 0.05, kClearOfMost = 0.8;
/// HIPs farther off cannot be counted in cubes.
constexpr double kFar = 1e8;

bool is_creased(const Brick& first) noexcept {
  return first.joint() == Joint::kRidge || first.joint() == Joint::kValley;
}

}  // namespace

bool SmoothContact::is_far(const Vec3& at) noexcept {
  return !(at.cwiseAbs().maxCoeff() < kFar);
}

BrickPlace SmoothContact::place_in(const Cube& cube, const Vec3& at) noexcept {
  BrickPlace out;
  for (std::size_t a = 0; a < 3; ++a) {
    const double x = at[static_cast<Eigen::Index>(a)] - kBrickCells * static_cast<double>(cube[a]);
    const int cell = std::clamp(static_cast<int>(x), 0, kBrickCells - 1);
    out.cell[a] = cell;
    out.t[a] = static_cast<float>(x - cell);
  }
  return out;
}

SmoothContact::Cube SmoothContact::cube_of(const Vec3& at) noexcept {
  return cube_around(voxel_of(at));
}

bool SmoothContact::look(const Vec3& at, Cube& cube, std::uint32_t& brick, float& side,
                         Jet& jet) const noexcept {
  const Voxel voxel = voxel_of(at);
  const Brick& here = grid_->bricks[brick];
  const bool layered = here.joint() != Joint::kLast;
  if (is_in(voxel, cube)) {
    jet =
        layered ? layers_jet(&here, place_in_voxel(voxel, at)) : spline_jet(here, place_in_voxel(voxel, at));
    return true;
  }
  const Cube to = cube_around(voxel);
  // Beside a crease the normal there may be another than that of the god object.
  const Vec3 normal =
      layered ? layers_jet(&here, place_in(cube, at)).gradient.cast<double>().normalized() : normal_;
  if (change_brick(at, to, normal, cube, brick, side, jet)) return true;
  // Bricks differ by the rounding of their coefficients: a surface along a wall may be on its other side.
  const Vec3 in(at - Vec3(cube[0], cube[1], cube[2]) * kBrickCells - Vec3::Constant(0.5 * kBrickCells));
  if (in.cwiseAbs().maxCoeff() > 0.5 * kBrickCells + kBeyondWall) return false;
  jet = layers_jet(&here, place_in(cube, at));
  return true;
}

bool SmoothContact::change_brick(const Vec3& at, const Cube& to, const Vec3& normal, Cube& cube,
                                 std::uint32_t& brick, float& side, Jet& jet) const noexcept {
  const std::uint32_t cell = grid_->cell_at(to);
  if (cell == CellBlocks::kNone) return false;
  const BrickPlace place = place_in(to, at);
  const std::uint32_t begin = grid_->first[cell],
                      end = std::min(grid_->first[cell + 1], begin + kMaxSmoothSheets);
  float least = std::numeric_limits<float>::infinity();
  for (std::uint32_t b = begin; b < end; b += layers_from(&grid_->bricks[b])) {
    const Brick& first = grid_->bricks[b];
    const Jet found =
        first.joint() == Joint::kLast ? spline_jet(first, place) : layers_jet_along(&first, place, normal);
    const double size = static_cast<double>(found.gradient.norm());
    if (!(size > 0.0)) continue;
    const double agreed = normal.dot(found.gradient.cast<double>()) / size;
    const float off = std::abs(found.value);
    if (!(off < (agreed > kSameNormal ? kSameSheet : agreed < -kSameNormal ? kSeam : 0.0f)) || !(off < least))
      continue;
    least = off;
    brick = b;
    jet = found;
    if (agreed < 0.0) {
      // The sheet's sides meet here the wrong way round.
      side = -side;
    }
  }
  if (!(least < kSameSheet)) return false;
  cube = to;
  return true;
}

void SmoothContact::start_from(const Vec3& h_mm) noexcept {
  contact_ = false;
  clear_ = -1.0;
  tested_to_ = grid_->in_voxels(h_mm);
}

bool SmoothContact::update(const Vec3& h_mm, FrameCounters& counters) noexcept {
  bound_hit_ = false;
  const Vec3 h = grid_->in_voxels(h_mm);
  if (contact_) {
    if (!without_.settling && follow_quickly(h)) return true;
  } else if ((h - looked_at_).squaredNorm() < clear_ * clear_ && clear_ > 0.0) {
    tested_to_ = h;
    return false;
  }
  return update_slowly(h, counters);
}

/// From a place that was looked at.
[[gnu::always_inline]] inline NewtonStep SmoothContact::step_from(const Jet& jet, const Vec3& at,
                                                                  const Vec3& h, const Cube& cube,
                                                                  std::uint32_t brick, float side,
                                                                  double longest) const noexcept {
  const Brick& first = grid_->bricks[brick];
  if (first.joint() == Joint::kLast) return newton_step(jet, h - at, longest, !without_.hessian);
  return layers_step(&first, place_in(cube, at), h - at, static_cast<double>(side), longest,
                     !without_.hessian);
}

/// In contact, the way nearly all frames go: the god object goes on as it went, and a Newton step or two mend
/// it. False, with nothing changed, where that does not bring it nearer, or the HIP came out.
[[gnu::always_inline]] inline bool SmoothContact::follow(const Vec3& h) noexcept {
  Vec3 at = god_ + moved_;
  Cube cube = cube_;
  std::uint32_t brick = brick_;
  float side = side_;
  Jet jet;
  for (int i = 0; i < kQuickSteps; ++i) {
    if (!look(at, cube, brick, side, jet)) return false;
    const NewtonStep s = step_from(jet, at, h, cube, brick, side, kLongestStep);
    at += s.along + s.normal * s.lift;
    const double length_sq = s.along.squaredNorm() + s.lift * s.lift;
    if (!(length_sq < kSettled * kSettled)) continue;
    const Vec3 d = h - at;
    if (!(d.dot(s.normal) * static_cast<double>(side) < 0.0)) return false;
    if (!(d.squaredNorm() <= (h - god_).squaredNorm() * kNoFarther)) return false;
    const Voxel voxel = voxel_of(at);
    if (!is_in(voxel, cube) || (grid_->bricks[brick].mask & mask_bit_of(voxel)) == 0) return false;
    moved_ = at - god_;
    god_ = at;
    normal_ = s.normal;
    cube_ = cube;
    brick_ = brick;
    side_ = side;
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
  if (!look(god_, cube_, brick_, side_, jet)) return Stay::kPastBorder;
  double longest = kLongestStep;
  while (steps > 0) {
    const NewtonStep s = step_from(jet, god_, h, cube_, brick_, side_, longest);
    normal_ = s.normal;
    if (without_.settling && (h - god_).dot(s.normal) * static_cast<double>(side_) > kOut) return Stay::kOut;
    if (s.along.squaredNorm() < kSettled * kSettled && std::abs(s.lift) < kSettled) {
      god_ += s.along + s.normal * s.lift;
      moved_ = god_ - start;
      if ((h - god_).dot(s.normal) * static_cast<double>(side_) > kOut) return Stay::kOut;
      return Stay::kHeld;
    }
    // The step, and back to the surface.
    Vec3 at = god_ + s.along + s.normal * s.lift;
    Cube cube = cube_;
    std::uint32_t brick = brick_;
    float side = side_;
    Jet there;
    bool on = false, over = false;
    for (int back = 0; back < 3 && steps > 0; ++back) {
      --steps;
      ++counters.walk_steps;
      if (!look(at, cube, brick, side, there)) break;
      const double size_sq = static_cast<double>(there.gradient.squaredNorm());
      if (!(size_sq > 0.0)) break;
      on = true;
      if (static_cast<double>(there.value * there.value) < kOnSurface * kOnSurface * size_sq) break;
      Vec3 lift = there.gradient.cast<double>() * (-static_cast<double>(there.value) / size_sq);
      if (is_creased(grid_->bricks[brick])) {
        // Beyond a crease the step goes on along the next face, or it would come back to the crease.
        over = over || back == 0;
        const NewtonStep on_to =
            step_from(there, at, back == 0 ? h : at, cube, brick, side, kOverCrease * longest);
        lift = on_to.along + on_to.normal * on_to.lift;
      }
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
    if (after > (over ? before : before * kNoFarther + kRounding)) {
      longest = 0.25 * std::min(longest, s.along.norm());
      if (longest < kShortestStep) {
        moved_ = Vec3::Zero();
        return (h - god_).dot(s.normal) * static_cast<double>(side_) > kOut ? Stay::kOut : Stay::kHeld;
      }
      continue;
    }
    if ((grid_->bricks[brick].mask & mask_bit(place_in(cube, at))) == 0) return Stay::kPastBorder;
    god_ = at;
    cube_ = cube;
    brick_ = brick;
    side_ = side;
    jet = there;
  }
  moved_ = Vec3::Zero();
  return Stay::kBound;
}

/// The HIP, or a place above the god object, where the sheet's distance says so, too: at a crease a normal
/// alone would not. False without one.
bool SmoothContact::find_clear(const Vec3& h, Vec3& clear) const noexcept {
  Cube cube = cube_;
  std::uint32_t brick = brick_;
  float side = side_;
  Jet jet;
  for (double above = kClearOf; above <= kClearOfMost; above *= 2.0) {
    const bool near = (h - god_).squaredNorm() <= above * above;
    clear = near ? h : Vec3(god_ + normal_ * (static_cast<double>(side_) * above));
    if (look(clear, cube, brick, side, jet) && jet.value * side > 0.0f) return true;
  }
  return false;
}

bool SmoothContact::update_slowly(const Vec3& h, FrameCounters& counters) noexcept {
  if (is_far(h)) {
    start_from(grid_->low_mm + h * grid_->voxel_mm);
    return false;
  }
  int steps = most_steps_, values = kMaxSegmentValues;
  for (int entry = 0; entry < kMaxSmoothEntries; ++entry) {
    if (contact_) {
      switch (descend(h, steps, counters)) {
        case Stay::kHeld:
          return true;
        case Stay::kBound:
          bound_hit_ = true;
          return true;
        case Stay::kPastBorder:
          // Another sheet may lie between its border and the HIP. From a little behind its own, that is not
          // met again.
          tested_to_ = god_ - normal_ * (static_cast<double>(side_) * kClearOf);
          contact_ = false;
          clear_ = -1.0;
          break;
        case Stay::kOut:
          // Its way out of the surface is still to be tested, from a place that is clear of it.
          if (without_.clearing) {
            tested_to_ = h;
          } else if (!find_clear(h, tested_to_)) {
            // Where sheets crowd, none of these places may be clear. A HIP still near stays in contact; one
            // that is out by more than they reach is free, or it would be held for ever.
            if (!((h - god_).squaredNorm() > kClearOfMost * kClearOfMost)) return true;
            tested_to_ = h;
          }
          contact_ = false;
          clear_ = -1.0;
          break;
      }
    }
    if (is_far(tested_to_)) tested_to_ = h;
    if (!find_entry(h, values, counters)) return false;
  }
  bound_hit_ = true;
  return contact_;
}

/// Calls visit(cube, begin, end) for the cubes of the segment, at most `most` of them, until it returns true;
/// whether it did. `reached`: how far the segment was looked at.
template <class Visit>
bool SmoothContact::along(const Vec3& from, const Vec3& way, int most, double& reached,
                          Visit&& visit) noexcept {
  Cube cube = cube_of(from);
  const Cube last = cube_of(from + way);
  reached = 0.0;
  for (int cubes = 0; cubes < most; ++cubes) {
    // Where the segment leaves the cube.
    double end = 1.0;
    std::size_t out = 3;
    if (cube != last)
      for (std::size_t a = 0; a < 3; ++a) {
        const double w = way[static_cast<Eigen::Index>(a)];
        if (w == 0.0) continue;
        const double wall = kBrickCells * static_cast<double>(cube[a] + (w > 0.0 ? 1 : 0));
        const double t = (wall - from[static_cast<Eigen::Index>(a)]) / w;
        if (t < end) {
          end = t;
          out = a;
        }
      }
    end = std::max(end, reached);
    if (visit(cube, reached, end)) return true;
    reached = end;
    if (out == 3) {
      reached = 1.0;
      return false;
    }
    cube[out] += way[static_cast<Eigen::Index>(out)] > 0.0 ? 1 : -1;
  }
  return false;
}

/// Free: the first place where the segment goes through the surface. Without one the segment has been tested.
bool SmoothContact::find_entry(const Vec3& h, int& values, FrameCounters& counters) noexcept {
  const Vec3 from = tested_to_, way = h - from;
  double reached = 0.0;
  const bool stopped =
      along(from, way, kMaxSegmentCubes, reached, [&](const Cube& cube, double begin, double end) noexcept {
        ++counters.cells_visited;
        const std::uint32_t cell = grid_->cell_at(cube);
        double at = 0.0;
        if (cell != CellBlocks::kNone && enter_in(cube, cell, from, way, begin, end, values, at, 0)) {
          contact_ = true;
          god_ = from + way * at;
          moved_ = Vec3::Zero();
          cube_ = cube;
          // Which sheet goes on across a wall is told by it: it must not be that of an earlier contact.
          const Jet jet = layers_jet(&grid_->bricks[brick_], place_in(cube, god_));
          normal_ = jet.gradient.cast<double>().normalized();
          return true;
        }
        return values <= 0;
      });
  if (contact_) return true;
  if (stopped || reached < 1.0) {
    bound_hit_ = true;
    tested_to_ = from + way * reached;
    return false;
  }
  tested_to_ = h;
  note_free(h);
  return false;
}

/// The sign of a piece's distance at the near end of the first place where the way to `target` meets it, or
/// 0.
float SmoothContact::side_seen(const Vec3& h, const Vec3& target, std::uint16_t piece) noexcept {
  // A voxel beyond: the target is near the surface.
  const Vec3 way = (target - h) + (target - h).normalized();
  double reached = 0.0;
  const int most = static_cast<int>(std::min(way.cwiseAbs().sum(), kFar)) + 3;
  float side = 0.0f;
  (void)along(h, way, most, reached, [&](const Cube& cube, double begin, double end) noexcept {
    const std::uint32_t cell = grid_->cell_at(cube);
    int values = kMaxSegmentValues;
    double at = 0.0;
    if (cell == CellBlocks::kNone || !enter_in(cube, cell, h, way, begin, end, values, at, piece))
      return false;
    side = side_;
    return true;
  });
  return side;
}

/// The first root on the part [begin, end] of the segment, which lies in one cube, of any of its sheets; or
/// of one closed piece alone.
bool SmoothContact::enter_in(const Cube& cube, std::uint32_t cell, const Vec3& from, const Vec3& way,
                             double begin, double end, int& values, double& at,
                             std::uint16_t piece) noexcept {
  const std::uint32_t first = grid_->first[cell],
                      past = std::min(grid_->first[cell + 1], first + kMaxSmoothSheets);
  const double length = way.norm();
  const double per = length > 0.0 ? 1.0 / length : 0.0;
  bool found = false;
  at = end;
  for (std::uint32_t b = first; b < past; b += layers_from(&grid_->bricks[b])) {
    const Brick& brick = grid_->bricks[b];
    if (piece != 0 && brick.piece() != piece) continue;
    const float allowed = free_side_[brick.piece()];
    const bool layered = brick.joint() != Joint::kLast;
    const auto value = [&](double t) noexcept {
      --values;
      const BrickPlace place = place_in(cube, from + way * t);
      return static_cast<double>(layered ? layers_value(&brick, place) : spline_value(brick, place));
    };
    double low = std::max(begin - kOverlap * per, 0.0), f = value(low);
    while (low < at && values > 0) {
      const double high = std::min(low + std::max(kMarch * std::abs(f), kLeastMarch) * per, at);
      if (!(high > low)) break;
      const double next = value(high);
      if ((next > 0.0) == (f > 0.0)) {
        low = high;
        f = next;
        continue;
      }
      // Illinois: false position that does not hang on one end.
      double a = low, fa = f, z = high, fz = next;
      for (int i = 0; i < kRootSteps && std::abs(fz) > kRootError; ++i) {
        const double t = (a * fz - z * fa) / (fz - fa), ft = value(t);
        if ((ft > 0.0) != (fz > 0.0)) {
          a = z;
          fa = fz;
        } else {
          fa *= 0.5;
        }
        z = t;
        fz = ft;
      }
      const BrickPlace place = place_in(cube, from + way * z);
      const float side = f > 0.0 ? 1.0f : -1.0f;
      if ((brick.mask & mask_bit(place)) != 0 && allowed * side >= 0.0f) {
        at = std::clamp(z, 0.0, end);
        found = true;
        brick_ = b;
        side_ = side;
        break;
      }
      low = high;
      f = next;
    }
  }
  return found;
}

/// How far the HIP may go before anything can be met: to the wall of its cube, or to the surface in it.
void SmoothContact::note_free(const Vec3& h) noexcept {
  const Cube cube = cube_of(h);
  double clear = kBrickCells;
  for (std::size_t a = 0; a < 3; ++a) {
    const double x = h[static_cast<Eigen::Index>(a)] - kBrickCells * static_cast<double>(cube[a]);
    clear = std::min({clear, x, kBrickCells - x});
  }
  const std::uint32_t cell = grid_->cell_at(cube);
  if (cell != CellBlocks::kNone) {
    const std::uint32_t first = grid_->first[cell],
                        past = std::min(grid_->first[cell + 1], first + kMaxSmoothSheets);
    for (std::uint32_t b = first; b < past; b += layers_from(&grid_->bricks[b]))
      clear = std::min(
          clear, kMarch * std::abs(static_cast<double>(layers_value(&grid_->bricks[b], place_in(cube, h)))));
  }
  looked_at_ = h;
  clear_ = clear;
}

}  // namespace palpate::render
