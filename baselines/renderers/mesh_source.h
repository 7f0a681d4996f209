// Which mesh a mesh renderer gets: the file's own, or one reconstructed from the points.
#pragma once

#include <memory>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/render/prepare_phases.h"
#include "toolkit/render/renderer.h"

namespace palpate::baselines {

/// The options that choose the mesh, the same for every mesh renderer: `mesh`, which is `usual` where nothing
/// is said, the limits and the cache of a reconstruction, and the options of every method.
[[nodiscard]] std::vector<OptionSpec> mesh_source_specs(const std::string& usual = "auto");

/// The mesh that `options` (complete, of mesh_source_specs() among others) mean for this model, never null or
/// empty. The steps of making it are phases, with the times of the day it was made where it comes from the
/// cache, and a note says so. Errors: the model brings no mesh of its own; those of reconstruct().
[[nodiscard]] Result<std::shared_ptr<const geometry::TriangleMesh>> mesh_of(const render::ModelInput& input,
                                                                            const Options& options,
                                                                            int threads,
                                                                            render::PreparePhases& phases);

}  // namespace palpate::baselines
