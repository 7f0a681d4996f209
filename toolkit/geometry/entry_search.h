// The first sign change of a smooth function along a segment, found without ever stepping over one.
//
// From t, a function g with g'' >= -m cannot reach zero before the smallest root of g(t) + g'(t) s - m s^2 /
// 2: a step that is always safe and converges quadratically at a transverse crossing (Newton from one side),
// by halving at a tangent one. Thin parts cannot be tunnelled, however long the segment.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace palpate::geometry {

/// Steps a search may take. A safe step is never shorter than a fixed part of the surface's shortest wave, so
/// this suffices for segments of hundreds of waves; beyond it the search ends without an answer.
inline constexpr int kEntrySteps = 4096;

/// Value, derivative along t, and the rounding bound of the value.
struct AlongSegment {
  double value = 0.0;
  double slope = 0.0;
  double rounding = 0.0;
};

/// The largest s such that value + slope * s - m s^2 / 2 > 0 on (0, s): infinite where it stays positive.
/// value >= 0.
[[nodiscard]] inline double safe_step(double value, double slope, double m) noexcept {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const double discriminant = slope * slope + 2.0 * m * value;
  if (slope < 0.0) return discriminant < 0.0 ? kNever : 2.0 * value / (std::sqrt(discriminant) - slope);
  return m > 0.0 ? (slope + std::sqrt(discriminant)) / m : kNever;
}

/// Smallest t in [from, to] where sign * g falls through zero; steps is what is left of kEntrySteps. A start
/// within rounding of zero counts as not yet through; a touch within rounding counts as through.
template <class Along>
[[nodiscard]] std::optional<double> first_fall(const Along& along, double sign, double m, double from,
                                               double to, int& steps) noexcept {
  double t = from;
  while (t <= to && steps-- > 0) {
    const AlongSegment g = along(t);
    const double value = sign * g.value, slope = sign * g.slope;
    if (value <= g.rounding && slope < 0.0) return t;
    // At least the rounding bound, so that every step advances; also past a zero that rises again.
    t += std::max(safe_step(std::max(value, g.rounding), slope, m), std::numeric_limits<double>::epsilon());
  }
  return std::nullopt;
}

/// Smallest t in [from, to] where g goes from outside (g >= 0 within rounding) to inside. -drop <= g'' <=
/// rise.
template <class Along>
[[nodiscard]] std::optional<double> first_entry_along(const Along& along, double drop, double rise,
                                                      double from, double to) noexcept {
  int steps = kEntrySteps;
  const AlongSegment start = along(from);
  double t = from;
  if (start.value < -start.rounding) {  // begins inside: must come out first
    const std::optional<double> exit = first_fall(along, -1.0, rise, from, to, steps);
    if (!exit) return std::nullopt;
    t = *exit;
  }
  return first_fall(along, 1.0, drop, t, to, steps);
}

}  // namespace palpate::geometry
