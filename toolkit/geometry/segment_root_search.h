// First sign change of a smooth function along a segment. None is stepped over.
//
// A function g with g'' >= -m cannot reach zero from t before the smallest root of g(t) + g'(t) s - m s^2 /
// 2. Steps to that root are safe; they converge quadratically at a transverse crossing (one-sided Newton) and
// by halving at a tangent one. No thin part is tunnelled, however long the segment.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace palpate::geometry {

/// Most steps of a search. A safe step is at least a fixed part of the surface's shortest wave, so this
/// covers hundreds of waves; a longer search ends without an answer.
inline constexpr int kEntrySteps = 4096;

/// Value, derivative along t, and rounding bound of the value.
struct SegmentSample {
  double value = 0.0;
  double slope = 0.0;
  double rounding = 0.0;
};

/// The largest s with value + slope * s - m s^2 / 2 > 0 on (0, s); infinite if always positive. value >= 0.
[[nodiscard]] inline double root_free_step(double value, double slope, double m) noexcept {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const double discriminant = slope * slope + 2.0 * m * value;
  if (slope < 0.0) return discriminant < 0.0 ? kNever : 2.0 * value / (std::sqrt(discriminant) - slope);
  return m > 0.0 ? (slope + std::sqrt(discriminant)) / m : kNever;
}

/// The smallest t in [from, to] where sign * g falls through zero; steps counts down from kEntrySteps. A
/// start within rounding of zero is not yet through; a touch within rounding is.
template <class Along>
[[nodiscard]] std::optional<double> first_falling_root(const Along& along, double sign, double m, double from,
                                                       double to, int& steps) noexcept {
  double t = from;
  while (t <= to && steps-- > 0) {
    const SegmentSample g = along(t);
    const double value = sign * g.value, slope = sign * g.slope;
    if (value <= g.rounding && slope < 0.0) return t;
    // At least the rounding bound, so every step advances, also past a zero that rises again.
    t += std::max(root_free_step(std::max(value, g.rounding), slope, m),
                  std::numeric_limits<double>::epsilon());
  }
  return std::nullopt;
}

/// The smallest t in [from, to] where g goes from outside (g >= 0 within rounding) to inside. -drop <= g'' <=
/// rise.
template <class Along>
[[nodiscard]] std::optional<double> first_entry_along(const Along& along, double drop, double rise,
                                                      double from, double to) noexcept {
  int steps = kEntrySteps;
  const SegmentSample start = along(from);
  double t = from;
  if (start.value < -start.rounding) {  // starts inside: must come out first
    const std::optional<double> exit = first_falling_root(along, -1.0, rise, from, to, steps);
    if (!exit) return std::nullopt;
    t = *exit;
  }
  return first_falling_root(along, 1.0, drop, t, to, steps);
}

}  // namespace palpate::geometry
