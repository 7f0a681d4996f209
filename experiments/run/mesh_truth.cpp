#include "experiments/run/mesh_truth.h"

namespace palpate::experiments {

Result<MeshTruth> mesh_truth(const render::ModelInput&, const trace::ProbePath&, double, Progress&) {
  return Error{"the original-mesh reference is not built yet", "use --reference none", {}, 0};
}

}  // namespace palpate::experiments
