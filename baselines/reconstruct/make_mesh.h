// Runs a reconstruction here and now, in this process: no limits, no cache. What most want is reconstruct.h.
#pragma once

#include "baselines/reconstruct/methods.h"
#include "toolkit/cloud/cloud.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {

/// The mesh of `cloud` by `method`, in double, model frame, never empty, every index in range; seen from
/// outside where it closes. `options` is complete (validate() over the method's specs). Each step is a phase.
/// The same for any number of threads, and on every run of a process that makes one: CGAL may break ties of
/// regular grids otherwise the second time. The libraries offer no way to stop them.
///
/// Errors: fewer than three different points, or all on a line; a raster where there is none; the library
/// gave up; memory ran out. The libraries' exceptions end here.
[[nodiscard]] Result<geometry::TriangleMesh> make_mesh(const Method& method, const cloud::Cloud& cloud,
                                                       const Options& options, int threads,
                                                       render::PreparePhases& phases);

}  // namespace palpate::baselines
