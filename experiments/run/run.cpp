#include "experiments/run/run.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "baselines/mesh_holder.h"
#include "experiments/run/cleaning.h"
#include "experiments/run/doubts.h"
#include "experiments/study/scoring.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/control/controlled_renderer.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/try.h"
#include "toolkit/deformation/editable.h"
#include "toolkit/io/write_mesh.h"
#include "toolkit/metrics/score_io.h"
#include "toolkit/trace/replay.h"
#include "toolkit/trace/trace_io.h"

namespace palpate::experiments {
namespace {

/// Passes progress on and asks to stop when time is up.
class TimeLimit final : public Progress {
 public:
  TimeLimit(Progress& inner, double limit_s) : inner_(inner), limit_s_(limit_s) {}
  void report(std::string_view what, double fraction) override { inner_.report(what, fraction); }
  [[nodiscard]] bool cancelled() const override { return inner_.cancelled() || expired(); }
  [[nodiscard]] bool expired() const { return limit_s_ > 0.0 && watch_.ms() * 1e-3 > limit_s_; }

 private:
  Progress& inner_;
  double limit_s_;
  Stopwatch watch_;
};

metrics::RendererResult begin(const Stage& stage, const RendererRequest& request,
                              const render::Registry& registry, int threads) {
  metrics::RendererResult result;
  result.label = request.label;
  result.name = request.name;
  const render::RendererInfo& info = *registry.find(request.name);
  result.role = info.role;
  result.works_on = info.geometry;
  result.missing = render::names_of(render::asked_by(stage.scene.input).without(info.supports));
  result.threads = threads > 0 ? threads : available_threads();
  std::uint64_t points = 0;
  for (const render::ModelInput& model : stage.scene.input.models) points += model.cloud->size();
  result.model = metrics::RendererResult::Model{points, stage.spacing.resolution_mm};
  if (const Result<Options> complete = validate(request.options, info.options, request.name))
    result.options.assign(complete->all().begin(), complete->all().end());
  if (!request.clean.empty()) result.options.emplace_back("clean", cleaning_text(request.clean));
  return result;
}

/// What cleaning took stands before the renderer's own phases: it is needed as well before the first frame.
void put_before(const std::vector<render::PreparePhase>& phases, const std::vector<std::string>& notes,
                render::PrepareReport& report) {
  report.phases.insert(report.phases.begin(), phases.begin(), phases.end());
  report.notes.insert(report.notes.begin(), notes.begin(), notes.end());
  for (const render::PreparePhase& phase : phases) report.total_ms += phase.ms;
}

Status save_mesh(const render::HapticRenderer& renderer, const std::string& file, bool& saved) {
  const auto* holder = dynamic_cast<const baselines::MeshHolder*>(&renderer);
  const geometry::TriangleMesh* mesh = holder == nullptr ? nullptr : holder->mesh(0);
  if (mesh != nullptr) {
    saved = true;
    return io::write_mesh_ply(file, *mesh);
  }
  saved = false;
  return Done{};
}

/// What each model feels like once its uniform deformation and a coupling have softened it.
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

Status save_edited(const render::HapticRenderer& renderer, const std::string& file) {
  const auto* editable = dynamic_cast<const render::Editable*>(&renderer);
  if (editable == nullptr)
    return Error{
        "this renderer does not change its model", "run cloud, on a scene with [model.surface.dent]", {}, 0};
  const Result<cloud::Cloud> edited = editable->edited(0);
  if (!edited) return edited.error();
  return io::write_cloud(file, *edited);
}

/// What the stage's scores are made with.
metrics::ScoreBasis score_basis(const Stage& stage) {
  const render::ModelInput& first = stage.scene.input.models.front();
  metrics::ScoreBasis basis;
  basis.stiffness_n_per_mm = first.surface.stiffness_n_per_mm;
  basis.device_resolution_mm = metrics::kOmniResolutionMm;
  basis.stored_rounding_mm = cloud::stored_rounding_mm(*first.cloud);
  basis.felt_stiffness_n_per_mm = felt_stiffness(stage.scene);
  basis.forces_comparable = stage.forces_comparable;
  return basis;
}

Status add_scores(const Stage& stage, Run& run, Progress& progress) {
  progress.report("scoring " + run.result.label, -1.0);
  const metrics::ScoreBasis basis = score_basis(stage);
  if (const Result<metrics::Energy> energy =
          metrics::observe_energy(stage.path, run.trace, basis.felt_stiffness_n_per_mm))
    run.result.energy = *energy;
  if (!stage.reference) return Done{};
  const Result<metrics::Accuracy> accuracy = metrics::score(
      stage.path, run.trace, *stage.reference, stage.truth.get(), options_of(basis), &run.per_frame);
  if (!accuracy) return accuracy.error();
  run.result.accuracy = *accuracy;
  if (!stage.forces_comparable) metrics::keep_contact_scores(*run.result.accuracy, run.per_frame);
  return Done{};
}

void warn(Run& run, const std::string& text) {
  run.result.prepare->warnings.push_back(text);
}

}  // namespace

Result<Run> run_renderer(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
                         const RunOptions& options, Progress& progress) {
  Run run;
  run.result = begin(stage, request, registry, options.threads);
  Result<std::unique_ptr<render::HapticRenderer>> renderer = registry.make(request.name, request.options);
  if (!renderer) return std::move(renderer).error();
  const render::HapticRenderer& inner = **renderer;  // whose mesh is saved; control has none
  renderer = control::wrap(*std::move(renderer), stage.scene.control);
  TimeLimit limit(progress, options.prepare_limit_s);
  const auto give_up = [&](metrics::RunStatus status, std::string reason) {
    run.result.status = status;
    run.result.reason = std::move(reason);
    return std::move(run);
  };
  std::optional<CleanedScene> cleaned;
  if (!request.clean.empty()) {
    Result<CleanedScene> made = clean_scene(stage.scene.input, request.clean, options.threads, limit);
    if (!made) return give_up(metrics::RunStatus::kFailed, made.error().message());
    cleaned = *std::move(made);
    run.result.model->points = 0;
    for (const render::ModelInput& model : cleaned->input.models)
      run.result.model->points += model.cloud->size();
  }
  progress.report("preparing " + request.label, -1.0);
  Result<render::PrepareReport> prepared =
      (*renderer)->prepare(cleaned ? cleaned->input : stage.scene.input, {options.threads, &limit});
  if (!prepared)
    return limit.expired() ? give_up(metrics::RunStatus::kDidNotFinish,
                                     fmt::format("preparation stopped after {} s", options.prepare_limit_s))
                           : give_up(prepared.error().gave_up ? metrics::RunStatus::kDidNotFinish
                                                              : metrics::RunStatus::kFailed,
                                     prepared.error().message());
  run.result.prepare = *std::move(prepared);
  for (const std::string& text : render::left_out(*registry.find(request.name), stage.scene.input))
    warn(run, text);
  if (cleaned) put_before(cleaned->phases, cleaned->notes, *run.result.prepare);
  for (const scene::Provenance& p : stage.scene.provenance)
    put_before(p.cleaning, p.cleaned, *run.result.prepare);
  if (!options.save_mesh.empty()) PALPATE_TRY(save_mesh(inner, options.save_mesh, run.saved_mesh));

  trace::ReplayOptions replay;
  replay.paced_frames = options.paced_frames;
  replay.paced_evicted_frames =
      (options.paced_frames + kWarmFramesPerEvictedFrame - 1) / kWarmFramesPerEvictedFrame;
  replay.simulation = stage.scene.input.simulation.get();
  replay.progress = &progress;
  Result<trace::ReplayReport> report = trace::measure(**renderer, stage.path, replay);
  if (!report) {
    // The path is named where the path is at fault.
    if (report.error().file == stage.path.name) return std::move(report).error();
    return give_up(metrics::RunStatus::kFailed, report.error().message());
  }
  run.result.take(*report);
  if (report->counters.edges > 0)
    warn(run, fmt::format(
                  "Nothing is felt under the surface after a border or a hole until the HIP has been above "
                  "again: it came there {} time{}.",
                  report->counters.edges, report->counters.edges == 1 ? "" : "s"));
  if (!options.save_edited.empty()) PALPATE_TRY(save_edited(inner, options.save_edited));
  run.trace = std::move(report->trace);
  run.trace.label = request.label;
  if (!stage.starts_free && run.trace.frames.front().contact)
    warn(run,
         "It is in contact at the path's first position already: it feels the surface from so far away, or "
         "the path starts inside. Without a ground truth nobody can tell; start farther away.");
  if (const Status scored = add_scores(stage, run, progress); !scored)
    return give_up(metrics::RunStatus::kFailed, scored.error().message());
  return run;
}

void finish_document(StagedStudy& study) {
  study.document.scene = study.stage.scene_name;
  study.document.path = study.stage.path.name;
  study.document.warnings = study.stage.warnings;
  for (std::string& doubt : doubts_about_contact(study)) study.document.warnings.push_back(std::move(doubt));
  study.document.notes = study.stage.notes;
  for (std::string& remark : remarks_on_reference(study)) study.document.notes.push_back(std::move(remark));
  study.document.renderers.clear();
  for (const Run& run : study.runs) study.document.renderers.push_back(run.result);
}

metrics::RendererResult unfinished(const Stage& stage, const RendererRequest& request,
                                   const render::Registry& registry, int threads) {
  metrics::RendererResult result = begin(stage, request, registry, threads);
  result.status = metrics::RunStatus::kDidNotFinish;
  result.reason = "the run was interrupted before this renderer was finished";
  return result;
}

std::string to_text(const Run& run) {
  metrics::ResultDocument document;
  document.renderers.push_back(run.result);
  return nlohmann::ordered_json{{"saved_mesh", run.saved_mesh}, {"result", metrics::to_json(document)}}.dump(
      -1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

Result<Run> run_from_text(const Stage& stage, const std::string& text, const OutputFolder& folder) {
  const nlohmann::json kept = nlohmann::json::parse(text, nullptr, false);
  const bool is_run = kept.is_object() && kept.contains("result") && kept["result"].is_string();
  Result<metrics::ResultDocument> document = metrics::parse_result(
      is_run ? kept["result"].get<std::string>() : std::string(), "what was kept of an interrupted run");
  if (!document) return std::move(document).error();
  Run run;
  if (document->renderers.size() != 1) return Error{"what was kept is not one run", {}, {}, 0};
  run.result = std::move(document->renderers.front());
  run.saved_mesh = kept.contains("saved_mesh") && kept["saved_mesh"] == true;
  if (run.result.trace_hash.empty()) return run;  // it failed before it had one
  const std::string trace_file = folder.file(run.result.trace_file).string();
  Result<trace::PathAndTrace> read = trace::read_trace_csv(trace_file);
  if (!read) return std::move(read).error();
  run.trace = std::move(read->trace);
  run.trace.label = run.result.label;
  if (trace::trace_hash(run.trace) != run.result.trace_hash || read->path.t_s != stage.path.t_s)
    return Error{"is not the trace of the run that was kept", {}, trace_file, 0};
  return run;
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
    document.models.push_back({model.name, from.source, from.content_hash, model.cloud->size(), *sample});
  }
  document.truth.reset();
  if (!stage.reference) return Done{};
  document.truth = {stage.reference->name, stage.reference->exactness, kReferenceFile};
  const Result<std::string> file = folder.claim(kReferenceFile);
  if (!file) return file.error();
  return trace::write_reference_csv(stage.path, *stage.reference, *file);
}

Status write_run(const Stage& stage, Run& run, bool alone, const OutputFolder& folder) {
  if (run.trace.frames.empty()) return Done{};
  run.result.trace_file = trace_name(run.result.label, alone);
  const Result<std::string> file = folder.claim(run.result.trace_file);
  if (!file) return file.error();
  PALPATE_TRY(trace::write_trace_csv(stage.path, run.trace, *file));
  if (run.per_frame.missed_contact.empty()) return Done{};
  run.result.scores_file = scores_name(run.result.label, alone);
  const Result<std::string> scores = folder.claim(run.result.scores_file);
  if (!scores) return scores.error();
  return metrics::write_scores_csv(stage.path, run.per_frame, *scores);
}

Status write_study(StagedStudy& study, const OutputFolder& folder) {
  PALPATE_TRY(write_stage(study, folder));
  for (Run& run : study.runs) PALPATE_TRY(write_run(study.stage, run, study.runs.size() == 1, folder));
  finish_document(study);
  return folder.write(kResultFile, metrics::to_json(study.document));
}

}  // namespace palpate::experiments
