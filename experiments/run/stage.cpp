#include "experiments/run/stage.h"

#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <utility>

#include <palpate/accuracy.h>
#include <palpate/baselines.h>
#include <palpate/paths.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include "baselines/reference/closest_mesh.h"
#include "baselines/reference/mesh_reference.h"
#include "experiments/run/arguments.h"
#include "experiments/run/run.h"
#include "toolkit/core/hardware.h"
#include "toolkit/metrics/closest_point.h"
#include "toolkit/plan/plan.h"
#include "toolkit/search/knn.h"

namespace palpate::experiments {
namespace {

/// The properties of the points that were kept.
std::shared_ptr<const surface::PointProperties> follow(const surface::PointProperties& before,
                                                       const std::vector<std::uint32_t>& from) {
  auto after = std::make_shared<surface::PointProperties>();
  for (auto values :
       {&surface::PointProperties::stiffness_n_per_mm, &surface::PointProperties::static_friction,
        &surface::PointProperties::dynamic_friction, &surface::PointProperties::deformation}) {
    if ((before.*values).empty()) continue;
    ((*after).*values).reserve(from.size());
    for (const std::uint32_t i : from) ((*after).*values).push_back((before.*values)[i]);
  }
  return after;
}

}  // namespace

const scene::Cleaning& all_cleaning() {
  static const scene::Cleaning cleaning = [] {
    scene::Cleaning all;
    baselines::register_cleaning(all);
    return all;
  }();
  return cleaning;
}

std::string cleaning_text(std::span<const NamedOptions> steps) {
  std::string text;
  for (const NamedOptions& step : steps) {
    text += (text.empty() ? "" : "+") + step.name;
    for (const auto& [key, value] : step.options.all()) text += fmt::format("/{}={}", key, value);
  }
  return text;
}

Result<CleanedScene> clean_scene(const render::SceneInput& input, std::span<const NamedOptions> steps,
                                 int threads, Progress& progress) {
  CleanedScene cleaned{input, {}, {}};
  for (render::ModelInput& model : cleaned.input.models) {
    Result<scene::CleanedCloud> own = all_cleaning().run(*model.cloud, steps, threads, progress);
    if (!own) return Error{model.name + ": " + own.error().what, own.error().remedy};
    model.cloud = std::make_shared<const cloud::Cloud>(std::move(own->cloud));
    model.original_mesh = nullptr;
    model.prepared = nullptr;
    if (model.surface.per_point) model.surface.per_point = follow(*model.surface.per_point, own->from);
    cleaned.phases.insert(cleaned.phases.end(), own->phases.begin(), own->phases.end());
    cleaned.notes.insert(cleaned.notes.end(), own->notes.begin(), own->notes.end());
  }
  return cleaned;
}

namespace {

void add(std::vector<std::string>& to, const std::vector<std::string>& sentences) {
  to.insert(to.end(), sentences.begin(), sentences.end());
}

/// The first model as the truth knows it: with the faces that its points were taken from.
render::ModelInput with_truth(const scene::LoadedScene& loaded) {
  render::ModelInput model = loaded.input.models.front();
  if (loaded.sampled_mesh.front() != nullptr) model.original_mesh = loaded.sampled_mesh.front();
  return model;
}

/// The corners of a truth that is not the model's own mesh: the path follows them, so that it is one and the
/// same however the model was sampled. None where they are too few to be explored: a box has eight.
Result<std::optional<cloud::Cloud>> corners_of_truth(const render::ModelInput& truth,
                                                     const render::ModelInput& model) {
  if (truth.original_mesh == nullptr || truth.original_mesh == model.original_mesh)
    return std::optional<cloud::Cloud>();
  PALPATE_ASSIGN(cloud::Cloud corners,
                 cloud::build_cloud(truth.original_mesh->vertices_mm, cloud::NonFinite::kDrop));
  constexpr std::size_t kFewestCorners =
      256;  // sixteen balls of the sixteen points that a plane is fitted to
  if (corners.size() < kFewestCorners) return std::optional<cloud::Cloud>();
  return std::optional<cloud::Cloud>(std::move(corners));
}

/// The reference that `choice` means for this scene, or an Error where it cannot be had.
Result<ReferenceChoice> resolve(ReferenceChoice choice, const scene::LoadedScene& loaded,
                                std::vector<std::string>& notes) {
  const render::SceneInput& scene = loaded.input;
  const render::ModelInput model = with_truth(loaded);
  const std::optional<Error> none = why_no_truth(scene);
  if (none && choice != ReferenceChoice::kNone && choice != ReferenceChoice::kAuto)
    return Error{none->what, none->remedy + ", or use --reference none"};
  const bool single = !none;
  switch (choice) {
    case ReferenceChoice::kNone:
      return choice;
    case ReferenceChoice::kAnalytic:
      if (model.analytic) return choice;
      return Error{"the analytic reference needs one generated model", "use --reference auto"};
    case ReferenceChoice::kOriginalMesh:
      if (model.original_mesh) return choice;
      return Error{"the original-mesh reference needs one model with a mesh of its own",
                   "use --reference auto"};
    case ReferenceChoice::kClosest:
      if (model.analytic || model.original_mesh) return choice;
      return Error{"the closest-point reference needs one model with a formula or a mesh of its own",
                   "use --reference auto"};
    case ReferenceChoice::kMeshFile:
      return choice;
    case ReferenceChoice::kAuto:
      break;
  }
  if (single && model.analytic) return ReferenceChoice::kAnalytic;
  if (single && model.original_mesh) return ReferenceChoice::kOriginalMesh;
  notes.push_back(single ? "There is no ground truth: the model has neither a formula nor a mesh of its own."
                         : fmt::format("There is no ground truth: {}.", none->what));
  return ReferenceChoice::kNone;
}

/// The mesh that the request names as truth, in mm of the model's frame; what is doubtful about it.
Result<std::shared_ptr<const geometry::TriangleMesh>> read_truth(const StageRequest& request,
                                                                 const scene::LoadedScene& loaded,
                                                                 const io::Readers& readers,
                                                                 std::vector<std::string>& warnings,
                                                                 Progress& progress) {
  io::ReadOptions read;
  read.unit = loaded.provenance.front().unit;
  read.scale = request.load.scale.value_or(request.scene.models.front().scale);
  read.max_bytes = request.load.max_bytes;
  PALPATE_ASSIGN(io::ReadModel got, readers.read(request.reference_file, read, progress));
  if (got.mesh == nullptr || got.mesh->empty())
    return Error{"has no faces, so it cannot be the truth", "give a mesh, or --reference none",
                 request.reference_file};
  PALPATE_ASSIGN(const std::vector<std::string> of_reference,
                 warnings_about_reference(*got.mesh, loaded.input.models.front(), request.reference_file));
  add(warnings, of_reference);
  return std::shared_ptr<const geometry::TriangleMesh>(std::move(got.mesh));
}

/// `model` is the first one, with the truth as its mesh.
Status add_reference(Stage& stage, const render::ModelInput& model, ReferenceChoice choice,
                     const search::NeighbourTable& neighbours, Progress& progress) {
  const double limit = stage.scene.input.force_limit_n;
  progress.report("computing the ground truth", -1.0);
  const TruthKind kind = choice == ReferenceChoice::kClosest ? TruthKind::kClosest : TruthKind::kFollowed;
  const bool by_formula = model.analytic != nullptr && choice != ReferenceChoice::kOriginalMesh;
  PALPATE_ASSIGN(GroundTruth truth, by_formula
                                        ? ground_truth_on_formula(model, stage.path, limit, kind, progress)
                                        : ground_truth_on_mesh(model, stage.path, limit, kind, progress));
  stage.reference = std::move(truth.reference);
  stage.truth = std::move(truth.surface);
  return metrics::fill_local_resolution(*stage.reference, stage.path, *model.cloud, neighbours,
                                        model.world_from_model);
}

/// A hand that felt the truth all along its path came to each place as the truth has it: its history is
/// known, and no frame is left out for it.
void keep_history_of_hand(Stage& stage) {
  std::size_t frames = 0;
  for (trace::TruthFrame& frame : stage.reference->frames) {
    frames += frame.history_decides ? 1u : 0u;
    frame.history_decides = false;
  }
  if (frames > 0)
    stage.notes.push_back(fmt::format(
        "In {} frames, at edges, another place of the surface is as near as the one that the hand felt; they "
        "are scored as all others, for the hand came there feeling the truth.",
        frames));
}

void cut(Stage& stage, std::uint64_t contact_frames) {
  if (contact_frames == 0 || !stage.reference) return;
  std::uint64_t seen = 0;
  for (std::size_t i = 0; i < stage.path.size(); ++i) {
    if (stage.reference->frames[i].frame.contact) ++seen;
    if (seen < contact_frames) continue;
    stage.path.t_s.resize(i + 1);
    stage.path.hip_mm.resize(i + 1);
    stage.reference->frames.resize(i + 1);
    stage.path.name += fmt::format(" (ended after {} frames of true contact)", contact_frames);
    return;
  }
  stage.notes.push_back(
      fmt::format("The path has {} frames of true contact, not the {} asked for.", seen, contact_frames));
}

}  // namespace

std::optional<Error> why_no_truth(const render::SceneInput& scene) {
  for (const render::ModelInput& model : scene.models)
    if (model.motion != nullptr)
      return Error{
          fmt::format("the model '{}' moves, and truth is known of a model at rest only", model.name),
          "leave out its motion"};
  if (scene.models.size() > 1)
    return Error{fmt::format("the scene has {} models, and truth is known of one alone", scene.models.size()),
                 "give a scene of one model"};
  if (scene.simulation != nullptr)
    return Error{"the scene is simulated, and truth is known of a model at rest only", "leave that out"};
  return std::nullopt;
}

Result<ReferenceChoice> parse_reference(const std::string& text) {
  if (text == "auto") return ReferenceChoice::kAuto;
  if (text == "analytic") return ReferenceChoice::kAnalytic;
  if (text == "original-mesh") return ReferenceChoice::kOriginalMesh;
  if (text == "closest-point") return ReferenceChoice::kClosest;
  if (text == "none") return ReferenceChoice::kNone;
  std::error_code code;
  if (std::filesystem::exists(text, code)) return ReferenceChoice::kMeshFile;
  return Error{fmt::format("there is no reference '{}', nor a file of this name", text),
               "choose from auto, analytic, original-mesh, closest-point, none, or give a mesh file"};
}

std::vector<std::string> files_read(const scene::SceneFile& scene) {
  std::vector<std::string> files = {scene.path};
  for (const scene::SceneModel& model : scene.models) {
    files.insert(files.end(), {model.cloud, model.sources.texture_image,
                               model.sources.friction_map ? model.sources.friction_map->image : ""});
    for (const scene::SceneView& view : model.views) files.push_back(view.cloud);
  }
  std::erase_if(files, [](const std::string& file) {
    std::error_code code;
    return !std::filesystem::exists(file, code);  // a generator, or nothing
  });
  return files;
}

std::vector<std::string> files_read(const StageRequest& request) {
  std::vector<std::string> files = files_read(request.scene);
  if (const std::string path = file_of_path(request.path); !path.empty()) files.push_back(path);
  if (request.reference == ReferenceChoice::kMeshFile) files.push_back(request.reference_file);
  return files;
}

Result<Stage> set_up(const StageRequest& request, const io::Readers& readers, Progress& progress) {
  if (!request.stream.source.empty()) return set_up_stream(request, readers, progress);
  PALPATE_ASSIGN(scene::LoadedScene loaded, scene::load(request.scene, readers, request.load, progress));
  return set_up(std::move(loaded), std::nullopt, request, readers, progress);
}

Result<Stage> set_up(scene::LoadedScene loaded, std::optional<trace::ProbePath> path,
                     const StageRequest& request, const io::Readers& readers, Progress& progress) {
  Stage stage;
  stage.scene_name = request.scene_name;
  stage.scene = std::move(loaded);
  for (const scene::Provenance& p : stage.scene.provenance)
    for (const std::string& warning : p.warnings) stage.warnings.push_back(warning);
  PALPATE_TRY(check_surfaces(stage.scene));
  add(stage.warnings, request.surfaces.warnings);
  add(stage.warnings, warnings_about_models(stage.scene));
  add(stage.notes, request.surfaces.notes);
  PALPATE_ASSIGN(const ReferenceChoice choice, resolve(request.reference, stage.scene, stage.notes));
  render::ModelInput model = with_truth(stage.scene);
  if (choice == ReferenceChoice::kMeshFile) {
    PALPATE_ASSIGN(model.original_mesh, read_truth(request, stage.scene, readers, stage.warnings, progress));
    model.analytic = nullptr;
  }

  progress.report("finding neighbours", -1.0);
  // The printed resolutions of rasters are those of the scanner's path.
  bool has_spacing = false;
  if (model.cloud->raster) {
    if (const auto along = search::scanner_path(*model.cloud, request.threads)) {
      stage.spacing = search::describe_spacing(*model.cloud, *along);
      has_spacing = true;
    }
  }
  // A table takes more memory than the points: none is held that is not asked for.
  search::NeighbourTable nearest;
  if (!has_spacing || choice != ReferenceChoice::kNone)
    nearest = search::exact_knn(*model.cloud, request.threads);
  if (!has_spacing) stage.spacing = search::describe_spacing(*model.cloud, nearest);
  if (choice == ReferenceChoice::kNone) release_memory(nearest.of);

  progress.report("making the path", -1.0);
  PALPATE_ASSIGN(const std::optional<cloud::Cloud> corners,
                 corners_of_truth(model, stage.scene.input.models.front()));
  paths::PathTarget target;
  target.surface = model.analytic.get();
  target.cloud = corners ? &*corners : model.cloud.get();
  target.mesh = model.original_mesh.get();
  target.box_mm = target.cloud->box_mm();
  target.spacing_mm = stage.spacing.nearest_mm.p50;
  if (corners) {
    const search::NeighbourTable of_corners = search::exact_knn(*corners, request.threads);
    target.spacing_mm = search::describe_spacing(*corners, of_corners).nearest_mm.p50;
  }
  target.world_from_model = model.world_from_model;
  target.stiffness_n_per_mm = model.surface.stiffness_n_per_mm;
  bool felt_the_truth = false;
  target.felt = [&] {
    FeltKind kind = FeltKind::kPoints;
    felt_the_truth = choice != ReferenceChoice::kNone;
    if (felt_the_truth) kind = model.analytic != nullptr ? FeltKind::kFormula : FeltKind::kFaces;
    return felt_of(kind, model, stage.scene.input, request.threads, progress);
  };
  std::string named;
  if (!path) {
    if (request.path.empty())
      if (const std::string hint = size_hint(target.box_mm); !hint.empty()) stage.notes.push_back(hint);
    named = !request.path.empty() ? request.path : usual_path(target, request.usual_frames);
    PALPATE_ASSIGN(path, open_path(named, target, request.load.max_bytes, &stage.warnings));
  }
  stage.path = *std::move(path);
  // Whether the path starts free a formula knows, reference or not, and a mesh that is the reference.
  bool formulas = true;
  for (const render::ModelInput& m : stage.scene.input.models) {
    formulas = formulas && m.analytic != nullptr;
    if (!m.analytic) continue;
    PALPATE_TRY(paths::check_path_starts_free(stage.path, *m.analytic, m.world_from_model));
  }
  stage.starts_free = formulas || choice != ReferenceChoice::kNone || is_generated_path(named);
  const surface::Surface& surface = model.surface;
  stage.forces_comparable = !surface.friction.any() && surface.deformation == 0.0 && !surface.texture.any() &&
                            !surface.dent.any() && surface.per_point == nullptr;
  if (choice != ReferenceChoice::kNone && !stage.forces_comparable)
    stage.notes.push_back(
        "The ground truth is the rigid surface without friction, deformation or texture: contact is compared "
        "with it, forces are not.");
  if (choice != ReferenceChoice::kNone) PALPATE_TRY(add_reference(stage, model, choice, nearest, progress));
  if (felt_the_truth && choice != ReferenceChoice::kClosest) keep_history_of_hand(stage);
  if (choice == ReferenceChoice::kMeshFile) add(stage.warnings, warnings_about_alignment(stage));
  cut(stage, request.contact_frames);
  return stage;
}

namespace {

/// The truth of the wanted kind, marked where the other one answers otherwise.
Result<GroundTruth> compared(trace::ReferenceTrace followed, std::unique_ptr<metrics::TruthSurface> surface,
                             const render::ModelInput& model, const trace::ProbePath& path,
                             double force_limit_n, TruthKind kind, Progress& progress) {
  PALPATE_ASSIGN(trace::ReferenceTrace closest,
                 metrics::closest_point_reference(*surface, path, model.surface.stiffness_n_per_mm,
                                                  force_limit_n, progress));
  if (kind == TruthKind::kClosest) std::swap(followed, closest);
  const Result<metrics::HistoryCounts> tally = metrics::compare_references(followed, closest, path);
  if (!tally) return tally.error();
  return GroundTruth{std::move(followed), std::move(surface)};
}

}  // namespace

Result<GroundTruth> ground_truth_on_mesh(const render::ModelInput& model, const trace::ProbePath& path,
                                         double force_limit_n, TruthKind kind, Progress& progress) {
  PALPATE_ASSIGN(std::unique_ptr<baselines::ClosestMesh> closest,
                 baselines::ClosestMesh::build(*model.original_mesh, model.world_from_model));
  PALPATE_ASSIGN(const std::unique_ptr<baselines::MeshTruth> mesh,
                 baselines::MeshTruth::build(*model.original_mesh, model.world_from_model));
  PALPATE_ASSIGN(
      trace::ReferenceTrace followed,
      baselines::mesh_reference(*mesh, path, model.surface.stiffness_n_per_mm, force_limit_n, progress));
  return compared(std::move(followed), std::move(closest), model, path, force_limit_n, kind, progress);
}

Result<GroundTruth> ground_truth_on_formula(const render::ModelInput& model, const trace::ProbePath& path,
                                            double force_limit_n, TruthKind kind, Progress& progress) {
  PALPATE_ASSIGN(trace::ReferenceTrace followed,
                 metrics::analytic_reference(*model.analytic, path, model.surface.stiffness_n_per_mm,
                                             force_limit_n, model.world_from_model));
  auto surface = std::make_unique<metrics::AnalyticTruth>(*model.analytic, model.world_from_model);
  return compared(std::move(followed), std::move(surface), model, path, force_limit_n, kind, progress);
}

namespace {

constexpr double kFeltStepS = 1e-3;

/// Stiffness alone: what a truth knows.
render::ModelInput plain(render::ModelInput model) {
  const double stiffness = model.surface.stiffness_n_per_mm;
  model.surface = {};
  model.surface.stiffness_n_per_mm = stiffness;
  model.motion = nullptr;
  model.moves = nullptr;
  return model;
}

Result<paths::ForceFunction> through(const std::string& name, std::vector<render::ModelInput> models,
                                     int threads, Progress& progress) {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  PALPATE_ASSIGN(std::unique_ptr<render::HapticRenderer> made, registry.make(name, {}));
  render::SceneInput scene;
  scene.models = std::move(models);
  PALPATE_TRY(made->prepare(scene, {threads, &progress}));
  const std::shared_ptr<render::HapticRenderer> renderer = std::move(made);
  return paths::ForceFunction([renderer, t_s = -kFeltStepS](const Vec3& hip_mm) mutable {
    if (t_s < 0.0) renderer->restart(hip_mm, t_s);
    t_s += kFeltStepS;
    return renderer->step(hip_mm, t_s).force_n;
  });
}

/// A truth and what follows it, which refers to it.
struct FollowedMesh {
  explicit FollowedMesh(std::unique_ptr<baselines::MeshTruth> of) : truth(std::move(of)), follower(*truth) {}
  std::unique_ptr<baselines::MeshTruth> truth;
  baselines::MeshFollower follower;
};

Result<paths::ForceFunction> on_faces(const render::ModelInput& model) {
  PALPATE_ASSIGN(std::unique_ptr<baselines::MeshTruth> truth,
                 baselines::MeshTruth::build(*model.original_mesh, model.world_from_model));
  const auto mesh = std::make_shared<FollowedMesh>(std::move(truth));
  return paths::ForceFunction(
      [mesh, stiffness = model.surface.stiffness_n_per_mm](const Vec3& hip_mm) -> Vec3 {
        if (!mesh->follower.advance(hip_mm)) return Vec3::Zero();
        return (mesh->follower.god_object_mm() - hip_mm) * stiffness;
      });
}

}  // namespace

Result<paths::ForceFunction> felt_of(FeltKind kind, const render::ModelInput& truth,
                                     const render::SceneInput& scene, int threads, Progress& progress) {
  progress.report("a hand feels the model", -1.0);
  switch (kind) {
    case FeltKind::kFormula:
      return through("analytic", {plain(truth)}, threads, progress);
    case FeltKind::kFaces:
      return on_faces(truth);
    case FeltKind::kPoints:
      break;
  }
  std::vector<render::ModelInput> models;
  for (const render::ModelInput& model : scene.models) models.push_back(plain(model));
  render::SceneInput at_rest;
  at_rest.models = models;
  return through(plan::choose_renderer(at_rest).choice, std::move(models), threads, progress);
}

}  // namespace palpate::experiments
