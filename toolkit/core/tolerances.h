// Every number that decides a branch on rounding or on contact, with where it comes from. Two kinds, never
// mixed: rounding bounds follow from the arithmetic and the size of the coordinates; contact tolerances
// follow from the model (point spacing) or the device. Nothing here is an absolute length.
#pragma once

#include <limits>

namespace palpate {

/// Unit roundoff of double: half the distance from 1 to the next double.
inline constexpr double kUnitRoundoff = 0.5 * std::numeric_limits<double>::epsilon();
/// The same of float.
inline constexpr double kUnitRoundoffFloat = 0.5 * static_cast<double>(std::numeric_limits<float>::epsilon());

/// Bound on the relative error of n rounded operations in a row (Higham 2002, lemma 3.1): n u / (1 - n u).
[[nodiscard]] constexpr double gamma(int n) noexcept {
  return n * kUnitRoundoff / (1.0 - n * kUnitRoundoff);
}

/// The smallest force step a common desktop device can show: stiffness x resolution of the Phantom Omni, 0.5
/// N/mm x 0.055 mm. Above it a jump from point to point is felt, so `cloud` shades (stiffness x local spacing
/// > this).
inline constexpr double kFeltForceStepN = 0.0275;

/// Section 3.4 of the thesis: no force shading below this cloud resolution. The rule of `cloud-literal`
/// alone.
inline constexpr double kLiteralShadingResolutionMm = 0.2;

/// Section 1.6: a cloud at or below this resolution is "highly detailed"; `palpate info` warns above it.
inline constexpr double kHighResolutionMm = 2.5;

/// Section 3.1.3: a grid cell is a cube of five times the cloud's worst resolution.
inline constexpr double kCellPerResolution = 5.0;

/// Weber fraction of force magnitude (Pang, Tan, Durlach 1991): the band of the score within_7_percent.
inline constexpr double kForceJnd = 0.07;

}  // namespace palpate
