#include "experiments/run/run.h"

#include <fmt/format.h>

#ifdef PALPATE_WITH_BASELINES
#include "baselines/mesh_holder.h"
#endif
#include "experiments/run/cleaning.h"
#include "toolkit/control/controlled_renderer.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/parallel.h"
#include "toolkit/io/write_mesh.h"
#include "toolkit/render/editable.h"
#include "toolkit/render/on_virtual_clock.h"
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
  result.threads = threads > 0 ? threads : available_threads();
  std::uint64_t points = 0;
  for (const render::ModelInput& model : stage.scene.input.models) points += model.cloud->size();
  result.model = metrics::RendererResult::Model{points, stage.spacing.resolution_mm};
  if (const Result<Options> complete =
          validate(request.options, registry.find(request.name)->options, request.name))
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
#ifdef PALPATE_WITH_BASELINES
  const auto* holder = dynamic_cast<const baselines::MeshHolder*>(&renderer);
  const geometry::TriangleMesh* mesh = holder == nullptr ? nullptr : holder->mesh(0);
  if (mesh != nullptr) {
    saved = true;
    return io::write_mesh_ply(file, *mesh);
  }
#else
  (void)renderer, (void)file;
#endif
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
  return io::write_cloud_ply(file, *edited);
}

/// The truth is of a rigid surface without friction or texture: where the scene has more, only whether and
/// when there is contact can be compared.
void leave_contact_scores(metrics::Accuracy& a) {
  for (std::optional<double>* force :
       {&a.force_rms_n, &a.force_rms_percent, &a.force_normal_rms_n, &a.force_tangential_rms_n,
        &a.force_max_n, &a.within_7_percent, &a.within_10_percent, &a.direction_mean_deg,
        &a.direction_p99_deg, &a.direction_max_deg, &a.excess_jump_max_n, &a.excess_jumps_per_m,
        &a.god_object_rms_mm, &a.god_object_max_mm, &a.path_dependence_n})
    force->reset();
}

Status add_scores(const Stage& stage, Run& run, Progress& progress) {
  const double stiffness = stage.scene.input.models.front().surface.stiffness_n_per_mm;
  progress.report("scoring " + run.result.label, -1.0);
  if (const Result<metrics::Energy> energy =
          metrics::observe_energy(stage.path, run.trace, felt_stiffness(stage.scene)))
    run.result.energy = *energy;
  if (!stage.reference) return Done{};
  metrics::AccuracyOptions options;
  options.stiffness_n_per_mm = stiffness;
  const Result<metrics::Accuracy> accuracy =
      metrics::score(stage.path, run.trace, *stage.reference, stage.truth.get(), options, &run.per_frame);
  if (!accuracy) return accuracy.error();
  run.result.accuracy = *accuracy;
  if (!stage.forces_comparable) leave_contact_scores(*run.result.accuracy);
  return Done{};
}

}  // namespace

Result<Run> run_renderer(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
                         const RunOptions& options, Progress& progress) {
  Run run;
  run.result = begin(stage, request, registry, options.threads);
  Result<std::unique_ptr<render::HapticRenderer>> renderer = registry.make(request.name, request.options);
  if (!renderer) return std::move(renderer).error();
  const render::HapticRenderer& inner = **renderer;  // whose mesh is saved; control has none
  if (stage.scene.input.simulation != nullptr) {
    std::unique_ptr<render::HapticRenderer> bare = *std::move(renderer);
    renderer = std::unique_ptr<render::HapticRenderer>(
        std::make_unique<render::OnVirtualClock>(std::move(bare), stage.scene.input.simulation));
  }
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
  if (cleaned) put_before(cleaned->phases, cleaned->notes, *run.result.prepare);
  for (const scene::Provenance& p : stage.scene.provenance)
    put_before(p.cleaning, p.cleaned, *run.result.prepare);
  if (!options.save_mesh.empty())
    if (const Status saved = save_mesh(inner, options.save_mesh, run.saved_mesh); !saved)
      return saved.error();
  if (progress.cancelled()) return give_up(metrics::RunStatus::kDidNotFinish, "stopped by the user");

  trace::ReplayOptions replay;
  replay.paced_frames = options.paced_frames;
  replay.paced_evicted_frames =
      (options.paced_frames + kWarmFramesPerEvictedFrame - 1) / kWarmFramesPerEvictedFrame;
  replay.start_is_free = stage.starts_free;
  replay.progress = &progress;
  Result<trace::ReplayReport> report = trace::measure(**renderer, stage.path, replay);
  if (!report) {
    // The path is named where the path is at fault.
    if (report.error().file == stage.path.name) return std::move(report).error();
    return give_up(progress.cancelled() ? metrics::RunStatus::kDidNotFinish : metrics::RunStatus::kFailed,
                   report.error().message());
  }
  run.result.take(*report);
  if (!options.save_edited.empty())
    if (const Status saved = save_edited(inner, options.save_edited); !saved) return saved.error();
  run.trace = std::move(report->trace);
  run.trace.label = request.label;
  if (const Status scored = add_scores(stage, run, progress); !scored)
    return give_up(metrics::RunStatus::kFailed, scored.error().message());
  return run;
}

void finish_document(Study& study) {
  study.document.scene = study.stage.scene_name;
  study.document.path = study.stage.path.name;
  study.document.renderers.clear();
  for (const Run& run : study.runs) study.document.renderers.push_back(run.result);
}

Status write_study(const Study& study, const OutputFolder& folder) {
  const trace::ProbePath& path = study.stage.path;
  const bool alone = study.runs.size() == 1;
  for (const Run& run : study.runs) {
    if (run.trace.frames.empty()) continue;
    const std::string name = alone ? "trace.csv" : fmt::format("trace-{}.csv", run.result.label);
    if (const Status written = trace::write_trace_csv(path, run.trace, folder.file(name).string()); !written)
      return written.error();
  }
  if (study.stage.reference) {
    const trace::ForceTrace truth = metrics::as_trace(*study.stage.reference);
    if (const Status written = trace::write_trace_csv(path, truth, folder.file("reference.csv").string());
        !written)
      return written.error();
  }
  return folder.write("result.json", metrics::to_json(study.document));
}

}  // namespace palpate::experiments
