// Accepted ranges of physical quantities: at least a thousand times beyond every use, with squares and
// products still finite doubles.
#pragma once

#include <palpate/options.h>

namespace palpate {

/// Lengths up to a million kilometres. Signed quantities: see symmetric().
inline constexpr NumberRange kLengthsMm{0.0, 1e15, true};
inline constexpr NumberRange kSpeedsMmPerS{0.0, 1e15, true};
/// From micrometres read as kilometres to the reverse, with a factor of a thousand.
inline constexpr NumberRange kScales{1e-12, 1e12};
/// The stiffest devices show some 100 N/mm; a cubic metre of steel has 2e5.
inline constexpr NumberRange kStiffnessesNPerMm{0.0, 1e9, true};
inline constexpr NumberRange kDampingsNSPerMm{0.0, 1e9, true};
/// Indium on itself has about 10.
inline constexpr NumberRange kFrictionCoefficients{0.0, 1e4};
inline constexpr NumberRange kForcesN{0.0, 1e9, true};
inline constexpr NumberRange kForceRatesNPerS{0.0, 1e12, true};
inline constexpr NumberRange kAngularSpeedsDegPerS{0.0, 1e9, true};
inline constexpr NumberRange kRatesHz{0.0, 1e6, true};
/// Thirty years.
inline constexpr NumberRange kTimesS{0.0, 1e9};

/// The same range with either sign, for directions and places.
[[nodiscard]] constexpr NumberRange symmetric(const NumberRange& range) noexcept {
  return {-range.high, range.high};
}

}  // namespace palpate
