// Decides whether single-precision coordinates suffice for a cloud, from its extent and spacing.
#pragma once

#include <palpate/cloud.h>
#include <palpate/decision.h>

namespace palpate::render {

/// Float coordinates round to 2^-25 of the extent. Rounding within a hundredth of the spacing keeps the order
/// of points and turns no normal by more than half a degree.
inline constexpr double kMaxRoundingShare = 0.01;

/// Rounding of a stored coordinate.
[[nodiscard]] double coordinate_rounding_mm(const cloud::Cloud& cloud);
/// The decision in words with its numbers. `spacing_mm` is the neighbour distance; 0 = unknown.
[[nodiscard]] Decision coordinates_decision(const cloud::Cloud& cloud, double spacing_mm);
/// True if float coordinates are precise enough.
[[nodiscard]] bool float_precision_suffices(const cloud::Cloud& cloud, double spacing_mm);

}  // namespace palpate::render
