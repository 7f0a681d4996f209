// What a person may give for a physical quantity, in one table: a thousand times and more beyond every use,
// and so far within the numbers of a double that squares and products of any of them are numbers as well.
#pragma once

#include "toolkit/core/options.h"

namespace palpate {

/// Lengths: a million kilometres. Positions, offsets and velocities may be negative: see symmetric().
inline constexpr NumberRange kLengthsMm{0.0, 1e15, true};
inline constexpr NumberRange kSpeedsMmPerS{0.0, 1e15, true};
/// From micrometres read as kilometres to the reverse, and a thousand times beyond.
inline constexpr NumberRange kScales{1e-12, 1e12};
/// The stiffest devices show some 100 N/mm, a block of steel of a cubic metre has 2e5.
inline constexpr NumberRange kStiffnessesNPerMm{0.0, 1e9, true};
inline constexpr NumberRange kDampingsNSPerMm{0.0, 1e9, true};
/// Indium on itself has some 10.
inline constexpr NumberRange kFrictionCoefficients{0.0, 1e4};
inline constexpr NumberRange kForcesN{0.0, 1e9, true};
inline constexpr NumberRange kForceRatesNPerS{0.0, 1e12, true};
inline constexpr NumberRange kTurnsDegPerS{0.0, 1e9, true};
inline constexpr NumberRange kRatesHz{0.0, 1e6, true};
/// Thirty years.
inline constexpr NumberRange kTimesS{0.0, 1e9};

/// The same quantity with either sign, for directions and places.
[[nodiscard]] constexpr NumberRange symmetric(const NumberRange& range) noexcept {
  return {-range.high, range.high};
}

}  // namespace palpate
