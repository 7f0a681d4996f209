#include "experiments/run/run.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/run/arguments.h"
#include "experiments/run/work.h"
#include "experiments/study/study.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/metrics/result_json.h"
#include "toolkit/metrics/scores.h"
#include "toolkit/plan/plan.h"

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

namespace {

namespace fs = std::filesystem;

// A hand presses some millimetres into a thing that it holds, and strokes along it in a few seconds: shares
// of the diagonal of its box.
constexpr double kDepthPerSize = 1.0 / 200.0, kSizesPerSecond = 1.0 / 5.0;
constexpr double kHandMm = 300.0;           // what a desktop device reaches
constexpr double kFarFromAHand = 10.0;      // times as large or as small
constexpr double kClearancePerDepth = 0.2;  // as path generators have it
constexpr double kSlowestPerFastest = 0.2;  // the same
/// An entry every 0.3 s: bounds are taken over entries.
constexpr int kUsualPeriod = 300;
constexpr int kMostFolders = 1000;  // then something else is wrong
constexpr const char* kMesh = "mesh-godobject";

/// Two significant digits: what a person would have typed.
std::string round_text(double value) {
  return fmt::format("{}", parse_number(fmt::format("{:.1e}", value)).value());
}

bool has_faces(const render::ModelInput& model) {
  return model.original_mesh != nullptr && !model.original_mesh->empty();
}

/// Points, of the models that bring no faces.
double points_to_mesh(const render::SceneInput& scene) {
  double points = 0;
  for (const render::ModelInput& model : scene.models)
    if (!has_faces(model)) points += static_cast<double>(model.cloud->size());
  return points;
}

/// The god object on the best mesh, and what is to be said of it.
NamedOptions best_mesh(const render::SceneInput& scene, std::vector<std::string>& notes) {
  NamedOptions mesh{kMesh, {}};
  const double points = points_to_mesh(scene);
  const bool all_rasters = std::all_of(scene.models.begin(), scene.models.end(), [](const auto& model) {
    return !has_faces(model) && model.cloud->raster.has_value();
  });
  if (points == 0) return mesh;  // mesh=auto takes the faces
  if (all_rasters) {
    mesh.options.set("mesh", "organised");
  } else if (points > kMostPointsMeshed) {
    // On a surface their number falls with the square of the distance between them.
    const std::string cell = round_text(std::sqrt(points / kMostPointsMeshed));
    mesh.options.set("clean", "thin/cell=" + cell);
    mesh.options.set("label", "mesh-thinned");
    notes.push_back(fmt::format(
        "The mesh is made of points {} spacings apart, some {} of {}: of all it would take minutes. "
        "--renderers {}:mesh_time_limit_s=0 takes them all.",
        cell, format_count(static_cast<std::uint64_t>(kMostPointsMeshed)),
        format_count(static_cast<std::uint64_t>(points)), kMesh));
  }
  return mesh;
}

std::string scene_of_results(const fs::path& folder) {
  const Result<std::string> text = read_file((folder / "result.json").string(), kMemoryLimitBytes);
  const auto document = text ? metrics::parse_result(*text) : Error{};
  return document ? document->scene : std::string();
}

/// Whether results of this scene may go there.
bool is_for(const fs::path& folder, const std::string& scene) {
  std::error_code code;
  if (!fs::exists(folder, code)) return true;
  if (!fs::is_directory(folder, code)) return false;
  if (fs::is_empty(folder, code)) return true;
  if (!fs::exists(folder / kFolderMark, code)) return false;
  const std::string other = scene_of_results(folder);
  return other.empty() || other == scene;
}

/// The model's name, without folders, endings and options, as a folder may be called.
std::string folder_name(const std::string& scene) {
  std::error_code code;
  std::string name = fs::exists(scene, code) ? fs::path(scene).filename().string() : scene;
  name = name.substr(0, name.find_first_of(".:", 1));
  for (char& c : name) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
    if (!plain) c = '-';
  }
  return name.empty() ? "scene" : name;
}

}  // namespace

std::string usual_path(const paths::PathTarget& target, int frames) {
  const double size_mm = target.box_mm.extent_mm().norm();
  const double depth_mm = std::max(kDepthPerSize * size_mm, target.spacing_mm);
  const double fastest_mm_s = kSizesPerSecond * size_mm;
  const std::string clearance = round_text(kClearancePerDepth * depth_mm), fastest = round_text(fastest_mm_s);
  if (target.surface != nullptr)
    return fmt::format("weave:frames={}:depth_mm={}:clearance_mm={}:speed_mm_s={}:period_frames={}", frames,
                       round_text(depth_mm), clearance, fastest, kUsualPeriod);
  if (target.felt)
    return fmt::format("hand:frames={}:force_n={}:slowest_mm_s={}:fastest_mm_s={}", frames,
                       round_text(depth_mm * target.stiffness_n_per_mm),
                       round_text(kSlowestPerFastest * fastest_mm_s), fastest);
  return fmt::format("exploration:frames={}:depth_mm={}:clearance_mm={}:slowest_mm_s={}:fastest_mm_s={}",
                     frames, round_text(depth_mm), clearance, round_text(kSlowestPerFastest * fastest_mm_s),
                     fastest);
}

std::string size_hint(const geometry::Aabb& box_mm) {
  const double times = box_mm.extent_mm().norm() / kHandMm;
  if (!(times > kFarFromAHand || times < 1.0 / kFarFromAHand) || !(times > 0.0)) return {};
  return fmt::format(
      "The model is {} mm across, and the path is as large: nobody feels that with one hand. --scale {} "
      "brings it to a hand's size.",
      format_number(times * kHandMm), round_text(1.0 / times));
}

Chosen usual_renderers(const render::SceneInput& scene, const std::optional<RendererRequest>& own,
                       const render::Registry& registry) {
  Chosen chosen;
  const auto add = [&](const RendererRequest& request) {
    for (const RendererRequest& there : chosen.renderers)
      if (there.label == request.label || there.name == request.name) return;
    if (const Status able = registry.check_supports(*registry.find(request.name), scene); able)
      chosen.renderers.push_back(request);
    else
      chosen.notes.push_back(fmt::format("Left out: {}.", able.error().what));
  };
  if (own) {
    chosen.renderers.push_back(*own);
  } else {
    const render::Decision planned = plan::choose_renderer(scene);
    chosen.renderers.push_back({planned.choice, planned.choice, {}});
    chosen.notes.push_back(fmt::format("Renderer by plan: {} ({}).", planned.choice, planned.reason));
  }
  add({"cloud", "cloud", {}});
  if (registry.find(kMesh) == nullptr) return chosen;
  std::vector<std::string> notes;
  const Result<RendererRequest> mesh = request_of(best_mesh(scene, notes), registry);
  if (!mesh) {
    chosen.notes.push_back(fmt::format("There is no mesh to compare with: {}.", mesh.error().message()));
    return chosen;
  }
  const std::size_t before = chosen.renderers.size();
  add(*mesh);
  if (chosen.renderers.size() > before) chosen.notes.insert(chosen.notes.end(), notes.begin(), notes.end());
  return chosen;
}

std::string usual_folder(const std::string& command, const std::string& scene) {
  const std::string first = fmt::format("out/{}-{}", command, folder_name(scene));
  std::string folder = first;
  for (int k = 2; !is_for(folder, scene) && k < kMostFolders; ++k) folder = fmt::format("{}-{}", first, k);
  return folder;
}

}  // namespace palpate::experiments
