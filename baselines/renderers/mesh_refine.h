// The speed-accuracy knob of the mesh side: repair, smoothing and decimation as options of every mesh
// renderer, each a timed phase, with what it costs in shape.
#pragma once

#include <memory>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/render/prepare_phases.h"
#include "toolkit/render/renderer.h"

namespace palpate::baselines {

/// repair, repair_holes, smooth, decimate; all off by default.
[[nodiscard]] std::vector<OptionSpec> mesh_refine_specs();

/// `source` after repair, smoothing and decimation, in this order, as `options` ask; itself where they ask
/// for nothing. Notes say what was mended, how many facets are left and how far the result is from the points
/// and from `source`, both ways; that measurement is a phase of its own, which a pipeline in use would leave
/// out.
[[nodiscard]] Result<std::shared_ptr<const geometry::TriangleMesh>> refined(
    std::shared_ptr<const geometry::TriangleMesh> source, const render::ModelInput& input,
    const Options& options, int threads, render::PreparePhases& phases);

}  // namespace palpate::baselines
