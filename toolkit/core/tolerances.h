// Tolerances and accepted ranges of physical quantities, with sources. Two kinds of tolerances are never
// mixed: rounding bounds from arithmetic and coordinate size; contact tolerances from the model (spacing) or
// device. No length is absolute.
#pragma once

#include <limits>

#include <palpate/options.h>

namespace palpate {

/// Unit roundoff of double: half the distance from 1 to the next double.
inline constexpr double kUnitRoundoff = 0.5 * std::numeric_limits<double>::epsilon();
/// The same of float.
inline constexpr double kUnitRoundoffFloat = 0.5 * static_cast<double>(std::numeric_limits<float>::epsilon());

/// Bound on the relative error of n rounded operations (Higham 2002, lemma 3.1): n u / (1 - n u).
[[nodiscard]] constexpr double gamma(int n) noexcept {
  return n * kUnitRoundoff / (1.0 - n * kUnitRoundoff);
}

/// Smallest force step of a common desktop device: stiffness x resolution of the Phantom Omni, 0.5 N/mm x
/// 0.055 mm. Larger jumps between points are felt, so `cloud` shades above it (stiffness x local spacing).
inline constexpr double kPerceptibleForceStepN = 0.0275;

/// Section 3.4 of the thesis: no force shading below this resolution. Used by `cloud-literal` only.
inline constexpr double kLiteralShadingResolutionMm = 0.2;

/// Section 1.6: a cloud at or below this resolution is "highly detailed"; `palpate info` warns where half of
/// the points are farther apart.
inline constexpr double kHighResolutionMm = 2.5;

/// Section 3.1.3: a grid cell is a cube of five times the cloud's worst resolution.
inline constexpr double kCellPerResolution = 5.0;

/// Weber fraction of force magnitude (Pang, Tan, Durlach 1991): the band of the score within_7_percent.
inline constexpr double kForceJnd = 0.07;

// Accepted ranges of physical quantities: at least a thousand times beyond every use, with squares and
// products still finite doubles.

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
