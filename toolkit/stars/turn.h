// Internal to stars: one side for each piece.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/core/unset_vector.h"
#include "toolkit/stars/draft.h"

namespace palpate::stars {

/// Whether a piece encloses a volume, and is felt from one side.
enum class Enclosure : std::uint8_t { kOpen, kWithHoles, kWhole };

/// Points of a part of what is seen from afar: many enough that a million points take no time, few enough
/// that a small piece has the 16 parts that it is judged by.
inline constexpr int kPointsPerPart = 16;

struct Pieces {
  UnsetVector<std::uint32_t> of;  ///< by point; kNoPoint where it has no triangle
  std::vector<Enclosure> closed;  ///< by piece
  double least_enclosed = 1.0;    ///< 1 less the widest geometry::mouth_share() of those with holes
  /// Corners of the triangles left out where sides would not agree.
  std::vector<std::array<std::uint32_t, 3>> torn;
};

/// Turns the stars so that neighbours run the same way around; of pieces that enclose a volume, but for holes
/// or wholly, counter-clockwise seen from outside. Every sector must be agreed. O(n), parallel but for what
/// lies across chunks of points or is in doubt; the same for any number of threads.
Pieces turn_stars(Draft& draft);

/// The other way around.
void reverse(Star& star) noexcept;

/// In noise, of turned stars: triangles that face away from the planes around. A probe that moves along is
/// held below such, and no surface as smooth as those planes has any.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> overhanging(const Draft& draft);

}  // namespace palpate::stars
