// The consistency rule of all renderers with a god object: the held place must agree with the surface around
// the HIP. Without it a god object stuck on an edge or false piece stays while the HIP moves on and out, and
// contact ends in a kick.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include <palpate/vec.h>

namespace palpate::geometry {

/// The surface nearest to the HIP, as far as found.
struct NearestSurface {
  bool known = false;
  double signed_distance = 0.0;  ///< of the HIP, positive outside
  Vec3 outward = Vec3::Zero();   ///< of that surface, unit
  std::uint32_t piece = 0;       ///< closed piece it belongs to, from 1 on; 0: unknown
};

enum class GodObjectVerdict : unsigned char {
  kKeep,
  kMove,  ///< to the surface nearest to the HIP
  kFree,
};

/// A HIP within this many spacings of its god object counts as adjacent, whatever else is near.
inline constexpr double kAdjacentSpacings = 0.5;
/// A surface nearer than this share of the held distance overrides the held place. Beside a sharp 120-degree
/// edge a correct god object is up to 1.8 times as far; a rounded edge switches early or late, held at most
/// 1.4 times as far as the nearest surface.
inline constexpr double kMuchNearerShare = 0.5, kMuchNearerShareRounded = 0.7;
/// Above a surface by this many spacings the HIP is outside; surfaces are known better than that.
inline constexpr double kOutsideSpacings = 0.05;
/// A nearer place is taken only beyond this: below it, noise decides which side of an edge is nearer.
inline constexpr double kMoveSpacings = 1.25;
/// Least cosine between the outward directions of two places on one surface: 135 degrees with the HIP above
/// it, 120 behind it. The far side of a thin plate fails this, so the plate is not popped through. Around a
/// tip inside a body the nearest surface turns by less than kFacingBehind per query; through a plate it flips
/// at once.
inline constexpr double kFacingAbove = -0.7, kFacingBehind = -0.5;
/// A god object at rest pulls along its normal, within 18 degrees. One that waits at the end of a surface is
/// compared by the direction of its pull.
inline constexpr double kPullCosine = 0.95;

/// Frames between unforced checks: 8 ms at 1 kHz, less than a hand needs to feel a wrong pull (20 ms).
/// Following by single field values is done twice as often: around a tip of one spacing the direction turns
/// by a right angle in 8 ms.
inline constexpr int kCheckPeriodFrames = 8, kFollowPeriodFrames = 4;

/// Samples between the held place and the HIP.
inline constexpr int kSegmentSamples = 8;

/// Follows the outward direction of the surface behind which the HIP is. `followed` is the last result of
/// this contact, at first `held_outward` (unit, at the held place). `at`: the surface around the HIP.
[[nodiscard]] inline Vec3 follow_outward(const NearestSurface& at, const Vec3& followed,
                                         const Vec3& held_outward) noexcept {
  if (!at.known) return followed;
  return at.outward.dot(followed) > kFacingBehind ? at.outward : held_outward;
}

/// Decides the correction from the surface `at` around the HIP. Before any correction it samples the way from
/// the held place with `query(place)`: if the way leaves a plate's far side and meets another surface beyond,
/// the plate holds. `followed`: from follow_outward(), or `held_outward`. `spacing`: of the points around, in
/// the unit of lengths. `much_nearer`: one of the two shares above.
template <class Query>
[[nodiscard]] GodObjectVerdict check_god_object(const NearestSurface& at, const Vec3& hip, const Vec3& held,
                                                const Vec3& held_outward, const Vec3& followed,
                                                double spacing, double much_nearer,
                                                const Query& query) noexcept {
  const double far = (hip - held).norm();
  if (!(far > kAdjacentSpacings * spacing)) return GodObjectVerdict::kKeep;
  if (!at.known || std::abs(at.signed_distance) > much_nearer * far) return GodObjectVerdict::kKeep;
  const Vec3 pull = (held - hip) / far;
  const bool holds = pull.dot(held_outward) > kPullCosine;
  const double cosine = holds ? std::max(at.outward.dot(held_outward), at.outward.dot(followed))
                              : at.outward.dot(pull),
               out = kOutsideSpacings * spacing;
  GodObjectVerdict verdict = GodObjectVerdict::kKeep;
  if (at.signed_distance > out && cosine > kFacingAbove) verdict = GodObjectVerdict::kFree;
  if (at.signed_distance < 0.0 && far > kMoveSpacings * spacing && cosine > kFacingBehind)
    verdict = GodObjectVerdict::kMove;
  if (verdict == GodObjectVerdict::kKeep || !holds) return verdict;
  NearestSurface last;
  int last_k = 0;
  // Signed distance changes by at most the length of the way, also from one piece to another if both say the
  // same of inside. Otherwise one lies within the other, as the inner sheet of a hollow ball felt from
  // outside, and tells nothing of the HIP.
  const auto is_within_last = [&](const NearestSurface& here, int k) noexcept {
    const double way = far * static_cast<double>(k - last_k) / kSegmentSamples,
                 change = std::abs(here.signed_distance - last.signed_distance);
    const bool other = last.known && here.piece != last.piece;
    last = here;
    last_k = k;
    return other && change > way + out;
  };
  for (int k = 1; k < kSegmentSamples; ++k) {
    const NearestSurface along_segment =
        query(held + (hip - held) * (static_cast<double>(k) / kSegmentSamples));
    if (!along_segment.known) continue;
    if (is_within_last(along_segment, k)) return GodObjectVerdict::kKeep;
    if (!(along_segment.signed_distance > out)) continue;
    return along_segment.outward.dot(held_outward) > kFacingAbove ? verdict : GodObjectVerdict::kKeep;
  }
  return is_within_last(at, kSegmentSamples) ? GodObjectVerdict::kKeep : verdict;
}

}  // namespace palpate::geometry
