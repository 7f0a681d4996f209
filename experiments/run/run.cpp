#include "experiments/run/run.h"

#include <fmt/format.h>

#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/run/result_warnings.h"
#include "experiments/run/work.h"
#include "experiments/study/study.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/metrics/scores.h"

namespace palpate::experiments {
namespace {

/// Stiffness of each model once its uniform deformation and a coupling have softened it.
std::vector<double> felt_stiffness(const scene::LoadedScene& scene) {
  std::vector<double> felt;
  for (const render::ModelInput& model : scene.input.models) {
    double k = model.surface.stiffness_n_per_mm * (1.0 - model.surface.deformation);
    if (scene.control.coupling) {
      const double coupled = scene.control.coupling->stiffness_n_per_mm;
      k = k * coupled / (k + coupled);
    }
    felt.push_back(k);
  }
  return felt;
}

/// Input of the stage's scores.
metrics::ScoreBasis score_basis(const Stage& stage) {
  const render::ModelInput& first = stage.scene.input.models.front();
  metrics::ScoreBasis basis;
  basis.stiffness_n_per_mm = first.surface.stiffness_n_per_mm;
  basis.device_resolution_mm = metrics::kOmniResolutionMm;
  basis.stored_rounding_mm = cloud::stored_rounding_mm(*first.cloud);
  if (first.surface.per_point == nullptr) {
    basis.static_friction = first.surface.friction.static_coefficient;
    basis.dynamic_friction = first.surface.friction.dynamic_coefficient;
  }
  basis.felt_stiffness_n_per_mm = felt_stiffness(stage.scene);
  basis.forces_comparable = stage.forces_comparable;
  return basis;
}

}  // namespace

Status score_run(const Stage& stage, Run& run) {
  const metrics::ScoreBasis basis = score_basis(stage);
  const metrics::AccuracyOptions options = options_of(basis);
  // Control's changes of a force (a filter's tail, a ramp) leave the renderer's flag as it is.
  if (!stage.scene.control.any()) PALPATE_TRY(metrics::check_contact_flags(stage.path, run.trace, options));
  return score_trace(stage.path, run.trace,
                     {stage.reference ? &*stage.reference : nullptr, stage.truth.get(), nullptr}, basis,
                     run.result, run.per_frame);
}

void finish_document(StagedStudy& study) {
  study.document.scene = study.stage.scene_name;
  study.document.path = study.stage.path.name;
  study.document.path_hash = trace::path_hash(study.stage.path);
  study.document.warnings = study.stage.warnings;
  for (std::string& warning : warnings_about_contact(study))
    study.document.warnings.push_back(std::move(warning));
  for (std::string& apart : disagreements(study)) study.document.warnings.push_back(std::move(apart));
  study.document.notes = study.stage.notes;
  for (std::string& remark : remarks_on_reference(study)) study.document.notes.push_back(std::move(remark));
  study.document.renderers.clear();
  for (const Run& run : study.runs) study.document.renderers.push_back(run.result);
}

metrics::RendererResult unfinished(const Stage& stage, const RendererRequest& request,
                                   const render::Registry& registry, int threads) {
  metrics::RendererResult result = begin_result(stage, request, registry, threads);
  result.status = metrics::RunStatus::kDidNotFinish;
  result.reason = "the run was interrupted before this renderer was finished";
  return result;
}

bool take_run(const OutputFolder& folder, const std::string& name, const std::string& key, const Stage& stage,
              Run& run) {
  return folder.take_over(name, key, [&](const std::string& text) {
    Result<Run> kept = run_of(text);
    if (!kept) return false;
    run = *std::move(kept);
    if (run.result.trace_hash.empty()) return true;  // it failed before it had one
    Result<trace::PathAndTrace> read = trace::read_trace_csv(folder.file(run.result.trace_file).string());
    if (!read) return false;
    run.trace = std::move(read->trace);
    run.trace.label = run.result.label;
    return trace::trace_hash(run.trace) == run.result.trace_hash && read->path.t_s == stage.path.t_s;
  });
}

Status write_stage(StagedStudy& study, const OutputFolder& folder) {
  metrics::ResultDocument& document = study.document;
  const Stage& stage = study.stage;
  document.scoring = score_basis(stage);
  document.models.clear();
  for (const render::ModelInput& model : stage.scene.input.models) {
    const std::size_t i = document.models.size();
    const Result<std::string> sample = write_sample(*model.cloud, model.world_from_model, i + 1, folder);
    if (!sample) return sample.error();
    const scene::Provenance& from = stage.scene.provenance[i];
    // Of a prepared file the cloud is a sample.
    const std::size_t points = model.prepared != nullptr ? from.file_points : model.cloud->size();
    document.models.push_back({model.name, from.source, from.content_hash, points, *sample});
  }
  document.truth.reset();
  if (!stage.reference) return Done{};
  document.truth = {stage.reference->name, stage.reference->exactness, kReferenceFile,
                    trace::trace_hash(metrics::as_trace(*stage.reference))};
  PALPATE_ASSIGN(const std::string file, folder.claim(kReferenceFile));
  return trace::write_reference_csv(stage.path, *stage.reference, file);
}

Status write_run(const Stage& stage, Run& run, bool alone, const OutputFolder& folder) {
  if (run.trace.frames.empty()) return Done{};
  run.result.trace_file = trace_name(run.result.label, alone);
  PALPATE_ASSIGN(const std::string file, folder.claim(run.result.trace_file));
  PALPATE_TRY(trace::write_trace_csv(stage.path, run.trace, file));
  if (run.per_frame.missed_contact.empty()) return Done{};
  run.result.scores_file = scores_name(run.result.label, alone);
  PALPATE_ASSIGN(const std::string scores, folder.claim(run.result.scores_file));
  return metrics::write_scores_csv(stage.path, run.per_frame, scores);
}

Status write_study(StagedStudy& study, const OutputFolder& folder) {
  PALPATE_TRY(write_stage(study, folder));
  for (Run& run : study.runs) PALPATE_TRY(write_run(study.stage, run, study.runs.size() == 1, folder));
  finish_document(study);
  return folder.write(kResultFile, metrics::to_json(study.document));
}

}  // namespace palpate::experiments
