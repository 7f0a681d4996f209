// One rule for every renderer that holds a god object: the place held must agree with what the surface says
// of the HIP itself. Without it a god object that stopped on an edge or a false piece is held there while the
// HIP goes on and out, farther and farther, and ends in a kick.
#pragma once

#include <cmath>

#include "toolkit/core/vec.h"

namespace palpate::geometry {

/// The surface nearest to the HIP, as far as it was found.
struct Surroundings {
  bool known = false;
  double signed_distance = 0.0;  ///< of the HIP, positive outside
  Vec3 outward = Vec3::Zero();   ///< unit, of that surface
};

enum class HeldPlace : unsigned char {
  kKeep,
  kMove,  ///< to the surface nearest to the HIP
  kFree,
};

/// A HIP no farther from its god object than this many spacings is next to it, whatever else is near.
inline constexpr double kNextToSpacings = 0.5;
/// What is so near to the HIP, as a share of how far it is held, tells more of it than the place held. Beside
/// a sharp edge of 120 degrees the god object is held up to 1.8 times as far by right. A rounded edge lets it
/// over too early or too late: there it is held at most two fifths farther than the nearest surface is.
inline constexpr double kMuchNearer = 0.5, kMuchNearerRounded = 0.7;
/// Above a surface by this many spacings the HIP is out: the surface is known better than that.
inline constexpr double kOutSpacings = 0.05;
/// Farther than this a place nearer by is taken: below, which side of an edge is nearer changes with noise.
inline constexpr double kMoveSpacings = 1.25;
/// A surface that faces about the way of the place held: within 135 degrees where the HIP is above it, within
/// 120 where it is behind it. The far side of a thin plate faces the other way: it does not count, and the
/// plate is not popped through.
inline constexpr double kFacingAbove = -0.7, kFacingBehind = -0.5;
/// A god object that came to rest pulls along its normal, to 18 degrees. One that only waits, where no
/// surface goes on, holds nothing, whatever the HIP is through.
inline constexpr double kHolds = 0.95;

/// Frames between two looks while nothing else asks for one: 8 ms at 1 kHz, sooner than a hand feels a pull
/// as wrong (20 ms).
inline constexpr int kLookEvery = 8;

/// Places looked at on the way from the place held to the HIP.
inline constexpr int kPlacesOnWay = 8;

/// What is to be done, by what `look(place)` says of the surface around a place, a Surroundings. The HIP is
/// looked at always, the way to it only before anything is done: where that leads out of the far side of a
/// plate, with another surface beyond, the plate holds. `held_outward`: unit, at the place held. `spacing` of
/// the points around, in the unit of lengths. `much_nearer`: one of the two above.
template <class Look>
[[nodiscard]] HeldPlace judge_held_place(const Vec3& hip, const Vec3& held, const Vec3& held_outward,
                                         double spacing, double much_nearer, const Look& look) noexcept {
  const double far = (hip - held).norm();
  if (!(far > kNextToSpacings * spacing)) return HeldPlace::kKeep;
  const Surroundings at = look(hip);
  if (!at.known || std::abs(at.signed_distance) > much_nearer * far) return HeldPlace::kKeep;
  const bool holds = (held - hip).dot(held_outward) > kHolds * far;
  const double cosine = holds ? at.outward.dot(held_outward) : 1.0, out = kOutSpacings * spacing;
  HeldPlace verdict = HeldPlace::kKeep;
  if (at.signed_distance > out && cosine > kFacingAbove) verdict = HeldPlace::kFree;
  if (at.signed_distance < 0.0 && far > kMoveSpacings * spacing && cosine > kFacingBehind)
    verdict = HeldPlace::kMove;
  if (verdict == HeldPlace::kKeep || !holds) return verdict;
  for (int k = 1; k < kPlacesOnWay; ++k) {
    const Surroundings on_way = look(held + (hip - held) * (static_cast<double>(k) / kPlacesOnWay));
    if (!on_way.known || !(on_way.signed_distance > out)) continue;
    return on_way.outward.dot(held_outward) > kFacingAbove ? verdict : HeldPlace::kKeep;
  }
  return verdict;
}

}  // namespace palpate::geometry
