// Charts of a study.
#pragma once

#include <vector>

#include "experiments/psychophysics/blinded.h"
#include "experiments/report/figures.h"

namespace palpate::experiments::psychophysics {

/// Charts by kind of study. A varied option: psychometric function, and an adaptive procedure's course.
/// Compared renderers: running share of right answers with its exact interval.
[[nodiscard]] std::vector<Chart> charts_of(const ObservedDocument& document);

}  // namespace palpate::experiments::psychophysics
