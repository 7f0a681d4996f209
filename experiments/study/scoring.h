// The scores of a study from its traces and its truth: no renderer runs.
#pragma once

#include "experiments/study/study.h"

namespace palpate::experiments {

[[nodiscard]] metrics::AccuracyOptions options_of(const metrics::ScoreBasis& basis);

/// A truth, and what its surface answers about the trace or the surface to ask; null where there is none.
struct ScoreAgainst {
  const trace::ReferenceTrace* reference = nullptr;
  const metrics::TruthSurface* surface = nullptr;
  const std::optional<metrics::SurfaceAnswers>* answers = nullptr;  ///< used where there is no surface
};

/// The one place where a trace becomes energy and accuracy: both, in `result`, with the scores frame by frame
/// in `per_frame`. An Error leaves neither.
[[nodiscard]] Status score_trace(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                 const ScoreAgainst& truth, const metrics::ScoreBasis& basis,
                                 metrics::RendererResult& result, metrics::AccuracyFrames& per_frame);

/// Scores every run of the study again: accuracy and per-frame scores where there is a truth, energy where
/// the models feel alike (a trace does not say which of several was touched). An Error names the run.
[[nodiscard]] Status score_study(Study& study);

}  // namespace palpate::experiments
