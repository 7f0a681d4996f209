// What the frames of SmoothContact read at a place; included where they are, so that it is a part of each.
#pragma once

#include "toolkit/smooth/smooth_contact.h"
#include "toolkit/smooth/voxel.h"

namespace palpate::render {

/// A brick tells of places so many voxels beyond its walls, where no other does.
inline constexpr double kBeyondWall = 0.25;
/// The next place along a way without a surface is this share of the distance on.
inline constexpr double kMarch = 0.7;
/// A normal step leaves less than this before the next tangential one.
inline constexpr double kOnSurface = 1e-4;
/// A step of more than so many voxels is not trusted.
inline constexpr double kLongestStep = 1.0;

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

}  // namespace palpate::render
