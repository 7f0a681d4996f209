#include "experiments/run/stage.h"

#include <memory>
#include <utility>

#include <palpate/accuracy.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include "baselines/reference/closest_mesh.h"
#include "baselines/reference/mesh_reference.h"
#include "toolkit/metrics/closest_point.h"
#include "toolkit/plan/plan.h"

namespace palpate::experiments {
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
