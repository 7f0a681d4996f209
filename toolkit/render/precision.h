// Whether single precision is enough for a cloud's coordinates, decided from its extent over its spacing.
#pragma once

#include "toolkit/cloud/cloud.h"
#include "toolkit/render/decision.h"

namespace palpate::render {

/// Coordinates are floats relative to the middle of the box: they round to 2^-25 of the extent. A hundredth
/// of the spacing moves no point past another and no normal by more than half a degree.
inline constexpr double kFloatShare = 0.01;

/// Of a stored coordinate.
[[nodiscard]] double coordinate_rounding_mm(const cloud::Cloud& cloud);
/// In words, with the numbers it rests on. `spacing_mm`: between neighbours, 0: not known.
[[nodiscard]] Decision coordinates_decision(const cloud::Cloud& cloud, double spacing_mm);
/// Whether floats are fine enough.
[[nodiscard]] bool floats_fit(const cloud::Cloud& cloud, double spacing_mm);

}  // namespace palpate::render
