// Ground truth: the reference that follows the path, compared with one that has no history.
#pragma once

#include <memory>

#include <palpate/accuracy.h>
#include <palpate/paths.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>

namespace palpate::experiments {

/// The truth along a path, and the surface that it is of.
struct GroundTruth {
  trace::ReferenceTrace reference;
  std::unique_ptr<metrics::TruthSurface> surface;
};

/// Choice among the two references for the scores; the other one shows where history decides.
enum class TruthKind {
  kFollowed,  ///< the god object that came along the path
  kClosest,   ///< the closest point of the whole surface
};

/// On model.original_mesh: the converged god object, and the closest point by a library that shares nothing
/// with the mesh renderers.
[[nodiscard]] Result<GroundTruth> ground_truth_on_mesh(const render::ModelInput& model,
                                                       const trace::ProbePath& path, double force_limit_n,
                                                       TruthKind kind, Progress& progress);

/// On model.analytic, which must outlive it.
[[nodiscard]] Result<GroundTruth> ground_truth_on_formula(const render::ModelInput& model,
                                                          const trace::ProbePath& path, double force_limit_n,
                                                          TruthKind kind, Progress& progress);

// Surface that a simulated hand feels while its path is made.

enum class FeltKind { kFormula, kFaces, kPoints };

/// The scene at rest, rigid and without friction: the formula or the faces of `truth`, its first model with
/// what is true of it, or else what the plan takes for the points. Prepares it; errors are that one's.
[[nodiscard]] Result<paths::ForceFunction> felt_of(FeltKind kind, const render::ModelInput& truth,
                                                   const render::SceneInput& scene, int threads,
                                                   Progress& progress);

}  // namespace palpate::experiments
