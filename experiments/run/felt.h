// What a simulated hand feels of a scene while its path is made.
#pragma once

#include <palpate/paths.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>

namespace palpate::experiments {

enum class FeltKind { kFormula, kFaces, kPoints };

/// The scene at rest, rigid and without friction: the formula or the faces of `truth`, its first model with
/// what is true of it, or else what the plan takes for the points. Prepares it; errors are that one's.
[[nodiscard]] Result<paths::ForceFunction> felt_of(FeltKind kind, const render::ModelInput& truth,
                                                   const render::SceneInput& scene, int threads,
                                                   Progress& progress);

}  // namespace palpate::experiments
