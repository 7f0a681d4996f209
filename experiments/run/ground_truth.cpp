#include "experiments/run/ground_truth.h"

#include <utility>

#include <palpate/reference.h>
#include <palpate/result.h>
#include "baselines/reference/closest_mesh.h"
#include "baselines/reference/mesh_reference.h"
#include "toolkit/metrics/closest_point_reference.h"

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

}  // namespace palpate::experiments
