// Ground truth on a scan's own mesh.
#pragma once

#include <memory>

#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/metrics/truth.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/trace.h"

namespace palpate::experiments {

/// The truth along a path, and the surface that it is of.
struct GroundTruth {
  trace::ReferenceTrace reference;
  std::unique_ptr<metrics::TruthSurface> surface;
};

/// The converged god object on model.original_mesh along `path`.
[[nodiscard]] Result<GroundTruth> ground_truth_on_mesh(const render::ModelInput& model,
                                                       const trace::ProbePath& path, double force_limit_n,
                                                       Progress& progress);

}  // namespace palpate::experiments
