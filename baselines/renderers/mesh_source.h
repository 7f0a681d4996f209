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

/// The options that choose the mesh, the same for every mesh renderer.
[[nodiscard]] std::vector<OptionSpec> mesh_source_specs();

/// The mesh that `options` (complete, of mesh_source_specs() among others) mean for this model, never null or
/// empty; each step of making it is a phase. Errors: the model brings no mesh of its own; the reconstruction
/// failed.
[[nodiscard]] Result<std::shared_ptr<const geometry::TriangleMesh>> mesh_of(const render::ModelInput& input,
                                                                            const Options& options,
                                                                            render::PreparePhases& phases);

}  // namespace palpate::baselines
