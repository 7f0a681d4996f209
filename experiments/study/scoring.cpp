#include "experiments/study/scoring.h"

#include <algorithm>

#include <palpate/result.h>

namespace palpate::experiments {
namespace {

bool all_alike(const std::vector<double>& values) {
  return std::adjacent_find(values.begin(), values.end(), std::not_equal_to<>()) == values.end();
}

Status score_run(Study& study, std::size_t i) {
  StudyRun& run = study.runs[i];
  if (run.trace.frames.empty()) return Done{};
  metrics::RendererResult& result = study.document.renderers[i];
  const std::optional<metrics::Energy> measured = result.energy;
  const std::optional<metrics::TruthSamples> answers = run.per_frame.surface;
  const metrics::ScoreBasis& basis = *study.document.scoring;
  PALPATE_TRY(score_trace(study.path, run.trace,
                          {study.reference ? &*study.reference : nullptr, nullptr, &answers}, basis, result,
                          run.per_frame));
  // A trace does not tell which of several models was touched.
  if (!all_alike(basis.felt_stiffness_n_per_mm)) result.energy = measured;
  return Done{};
}

/// Energy, also by episodes if forces have a truth; empty if impossible.
std::optional<metrics::Energy> energy_of(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                         const trace::ReferenceTrace* reference,
                                         const metrics::ScoreBasis& basis) {
  Result<metrics::Energy> energy = metrics::observe_energy(path, trace, basis.felt_stiffness_n_per_mm);
  if (!energy) return std::nullopt;
  if (reference != nullptr && basis.forces_comparable &&
      !metrics::observe_episodes(path, trace, *reference, basis.felt_stiffness_n_per_mm, *energy))
    return std::nullopt;
  return *energy;
}

}  // namespace

metrics::AccuracyOptions options_of(const metrics::ScoreBasis& basis) {
  metrics::AccuracyOptions options;
  options.stiffness_n_per_mm = basis.stiffness_n_per_mm;
  options.device_resolution_mm = basis.device_resolution_mm;
  options.stored_rounding_mm = basis.stored_rounding_mm;
  options.static_friction = basis.static_friction;
  options.dynamic_friction = basis.dynamic_friction;
  return options;
}

Status score_trace(const trace::ProbePath& path, const trace::ForceTrace& trace, const ScoreAgainst& truth,
                   const metrics::ScoreBasis& basis, metrics::RendererResult& result,
                   metrics::AccuracyFrames& per_frame) {
  const std::optional<metrics::Energy> energy = energy_of(path, trace, truth.reference, basis);
  if (truth.reference == nullptr) {
    result.energy = energy;
    return Done{};
  }
  const metrics::AccuracyOptions options = options_of(basis);
  const std::optional<metrics::TruthSamples> none;
  PALPATE_ASSIGN(
      metrics::Accuracy accuracy,
      truth.surface != nullptr
          ? metrics::score(path, trace, *truth.reference, truth.surface, options, &per_frame)
          : metrics::rescore(path, trace, *truth.reference, truth.answers != nullptr ? *truth.answers : none,
                             options, &per_frame));
  if (!basis.forces_comparable) metrics::keep_contact_scores(accuracy, per_frame);
  result.energy = energy;
  result.accuracy = std::move(accuracy);
  return Done{};
}

Status score_study(Study& study) {
  for (std::size_t i = 0; i < study.runs.size(); ++i)
    if (Status scored = score_run(study, i); !scored) {
      Error error = std::move(scored).error();
      error.what = study.document.renderers[i].label + ": " + error.what;
      return error;
    }
  return Done{};
}

}  // namespace palpate::experiments
