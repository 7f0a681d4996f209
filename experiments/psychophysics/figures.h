// Pictures of a study.
#pragma once

#include <vector>

#include "experiments/psychophysics/blinded.h"
#include "experiments/report/figures.h"

namespace palpate::experiments::psychophysics {

/// Where an option is turned: the psychometric function, and of a procedure that adapts its course. Where
/// renderers are compared: the share of right answers as trials go on, with its exact interval.
[[nodiscard]] std::vector<Chart> charts_of(const ObservedDocument& document);

}  // namespace palpate::experiments::psychophysics
