// Where renderers answer otherwise than each other along a path: what can be said where there is no truth.
#pragma once

#include <string>
#include <vector>

#include "experiments/run/run.h"

namespace palpate::experiments {

/// Stretches of 20 ms and more in which a god object is farther from the others than 1 mm and two spacings, a
/// free one standing where the HIP is: the longest few, where, for how long, and who stands alone, in whole
/// sentences. Empty where there is a truth, or fewer than two traces.
[[nodiscard]] std::vector<std::string> disagreements(const StagedStudy& study);

}  // namespace palpate::experiments
