// Field reads of SplineSdfContact, included for inlining into each frame function.
#pragma once

#include "toolkit/spline_sdf/spline.h"
#include "toolkit/spline_sdf/spline_sdf_contact.h"

namespace palpate::spline_sdf {

/// A brick is valid this many voxels beyond its walls, where no other exists.
inline constexpr double kBrickMargin = 0.25;
/// Step along a surface-free way, as a share of the distance.
inline constexpr double kMarchShare = 0.7;
/// Remaining error of a normal step before the next tangential one.
inline constexpr double kOnSurface = 1e-4;
/// Longer steps, in voxels, are not trusted.
inline constexpr double kLongestStep = 1.0;

/// For a brick of any size, in the largest voxels: lengths halve exactly.
[[gnu::always_inline]] inline Jet SplineSdfContact::jet_at(const BrickRef& place,
                                                           const BrickPosition& in) const noexcept {
  Jet jet = spline_jet(grid_->bricks[place.brick], in);
  if (place.level != grid_->coarser) {
    const auto per = static_cast<float>(grid_->per_voxel_of(place.level));
    jet.value /= per;
    for (float& second : jet.second) second *= per;
  }
  return jet;
}
/// Bit-identical to jet_at().value.
[[gnu::always_inline]] inline float SplineSdfContact::value_at(const BrickRef& place,
                                                               const BrickPosition& in) const noexcept {
  const float value = spline_value(grid_->bricks[place.brick], in);
  return place.level != grid_->coarser ? value / static_cast<float>(grid_->per_voxel_of(place.level)) : value;
}

[[gnu::always_inline]] inline bool SplineSdfContact::query(const Vec3& at, BrickRef& place,
                                                           Jet& jet) const noexcept {
  const Vec3 own = at * grid_->per_voxel_of(place.level);
  const Voxel voxel = voxel_of(own);
  if (place.whole && is_in(voxel, place.cube)) {
    jet = jet_at(place, place_in_voxel(voxel, own));
    return true;
  }
  const BrickRef to = grid_->find(at);
  if (to.brick != BrickGrid::kNone) {
    place = to;
    jet = jet_at(place, place_in(place, at));
    return true;
  }
  // Bricks differ by their coefficients' rounding: a surface along a wall may be on its other side.
  const Vec3 off =
      own - (Vec3(place.cube[0], place.cube[1], place.cube[2]) + Vec3::Constant(0.5)) * kBrickCells;
  if (off.cwiseAbs().maxCoeff() > 0.5 * kBrickCells + kBrickMargin) return false;
  jet = jet_at(place, place_in(place, at));
  return true;
}

}  // namespace palpate::spline_sdf
