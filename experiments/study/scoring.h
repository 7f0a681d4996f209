// The scores of a study from its traces and its truth: no renderer runs.
#pragma once

#include "experiments/study/study.h"

namespace palpate::experiments {

[[nodiscard]] metrics::AccuracyOptions options_of(const metrics::ScoreBasis& basis);

/// Scores every run of the study again: accuracy and per-frame scores where there is a truth, energy where
/// the models feel alike (a trace does not say which of several was touched). An Error names the run.
[[nodiscard]] Status score_study(Study& study);

}  // namespace palpate::experiments
