#include "experiments/run/ground_truth.h"

#include "baselines/reference/mesh_reference.h"

namespace palpate::experiments {

Result<GroundTruth> ground_truth_on_mesh(const render::ModelInput& model, const trace::ProbePath& path,
                                         double force_limit_n, Progress& progress) {
  auto truth = baselines::MeshTruth::build(*model.original_mesh, model.world_from_model);
  if (!truth) return std::move(truth).error();
  Result<trace::ReferenceTrace> reference =
      baselines::mesh_reference(**truth, path, model.surface.stiffness_n_per_mm, force_limit_n, progress);
  if (!reference) return std::move(reference).error();
  return GroundTruth{std::move(*reference), std::move(*truth)};
}

}  // namespace palpate::experiments
