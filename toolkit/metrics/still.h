// The limit of a god object's accuracy.
#pragma once

#include "toolkit/core/tolerances.h"

namespace palpate::metrics {

/// The tracker's stopping error is some tens of coordinate roundings; below this share of the coordinates it
/// is at rest.
inline constexpr double kConvergedPerSize = 256.0 * kUnitRoundoff;

}  // namespace palpate::metrics
