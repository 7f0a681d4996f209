// Coulomb friction: the cone of Harwin and Melder (2002) with an anchor on the surface.
//
// The god object sticks without drift within static x depth of the anchor, else slides at the dynamic
// coefficient, and sticks again only well inside the cone. In slip the tangential force is exactly dynamic x
// the normal force.
#pragma once

#include <palpate/vec.h>

namespace palpate::render {

/// The anchor kept between frames. Belongs to one contact and thread.
class CoulombFriction {
 public:
  /// A sliding contact sticks again below this share of the sliding pull. The gap stops noise of depth or
  /// position (a few per cent) from switching back and forth. CHAI3D uses the same share.
  static constexpr double kStickShare = 0.6;

  /// The HIP is free.
  void release() noexcept { held_ = false; }

  /// The tangential part of the pull, mm, of a HIP `depth` below the frictionless god object `target`.
  /// Coefficients of static and dynamic friction. O(1), allocates nothing.
  Vec3 apply(double static_coefficient, double dynamic_coefficient, const Vec3& target, const Vec3& normal,
             double depth) noexcept {
    if (!held_) {
      held_ = true;
      sliding_ = false;
      anchor_ = target;
      return Vec3::Zero();
    }
    Vec3 away = anchor_ - target;
    away -= normal * normal.dot(away);
    const double length = away.norm();
    const double slip = dynamic_coefficient * depth;
    if (sliding_ && length < kStickShare * slip) sliding_ = false;
    const double limit = sliding_ ? slip : static_coefficient * depth;
    if (length <= limit) return away;
    sliding_ = true;
    away *= slip / length;
    anchor_ = target + away;
    return away;
  }

 private:
  Vec3 anchor_ = Vec3::Zero();
  bool held_ = false;
  bool sliding_ = false;
};

}  // namespace palpate::render
