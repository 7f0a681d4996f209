// Scores a study from traces and truth, without renderers.
#pragma once

#include "experiments/study/study.h"

namespace palpate::experiments {

[[nodiscard]] metrics::AccuracyOptions options_of(const metrics::ScoreBasis& basis);

/// A truth, and its surface's answers about the trace or the surface itself; null: none.
struct ScoreAgainst {
  const trace::ReferenceTrace* reference = nullptr;
  const metrics::TruthSurface* surface = nullptr;
  const std::optional<metrics::TruthSamples>* answers = nullptr;  ///< used without a surface
};

/// Computes energy and accuracy of a trace into `result`, with scores per frame in `per_frame`. The only such
/// place. An Error changes neither.
[[nodiscard]] Status score_trace(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                 const ScoreAgainst& truth, const metrics::ScoreBasis& basis,
                                 metrics::RendererResult& result, metrics::AccuracyFrames& per_frame);

/// Rescores every run: accuracy and per-frame scores with a truth, energy if the models feel alike (a trace
/// does not tell which was touched). Error: names the run.
[[nodiscard]] Status score_study(Study& study);

}  // namespace palpate::experiments
