#include "experiments/study/scoring.h"

#include <algorithm>

#include "toolkit/core/try.h"

namespace palpate::experiments {
namespace {

bool all_alike(const std::vector<double>& values) {
  return std::adjacent_find(values.begin(), values.end(), std::not_equal_to<>()) == values.end();
}

Status score_run(Study& study, std::size_t i) {
  const metrics::ScoreBasis& basis = *study.document.scoring;
  metrics::RendererResult& result = study.document.renderers[i];
  StudyRun& run = study.runs[i];
  if (run.trace.frames.empty()) return Done{};
  if (!basis.felt_stiffness_n_per_mm.empty() && all_alike(basis.felt_stiffness_n_per_mm)) {
    PALPATE_ASSIGN(const metrics::Energy energy,
                   metrics::observe_energy(study.path, run.trace, basis.felt_stiffness_n_per_mm));
    result.energy = energy;
  }
  if (!study.reference) return Done{};
  const std::optional<metrics::SurfaceAnswers> answers = run.per_frame.surface;
  PALPATE_ASSIGN(const metrics::Accuracy accuracy,
                 metrics::score_again(study.path, run.trace, *study.reference, answers, options_of(basis),
                                      &run.per_frame));
  result.accuracy = accuracy;
  if (result.energy && basis.forces_comparable && all_alike(basis.felt_stiffness_n_per_mm))
    PALPATE_TRY(metrics::observe_episodes(study.path, run.trace, *study.reference,
                                          basis.felt_stiffness_n_per_mm, *result.energy));
  if (!basis.forces_comparable) metrics::keep_contact_scores(*result.accuracy, run.per_frame);
  return Done{};
}

}  // namespace

metrics::AccuracyOptions options_of(const metrics::ScoreBasis& basis) {
  metrics::AccuracyOptions options;
  options.stiffness_n_per_mm = basis.stiffness_n_per_mm;
  options.device_resolution_mm = basis.device_resolution_mm;
  options.stored_rounding_mm = basis.stored_rounding_mm;
  return options;
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
