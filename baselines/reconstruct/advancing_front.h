// Surface reconstruction by CGAL's advancing front (Cohen-Steiner and Da 2004), default settings.
#pragma once

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

/// The mesh over the cloud's points, vertices in the cloud's order, model frame, mm. One thread, cannot be
/// cancelled: CGAL offers no hook; some 25 s a million points. A cloud without a surface (fewer than four
/// points, all in a plane that Delaunay cannot fill, all at one place) is an Error.
[[nodiscard]] Result<geometry::TriangleMesh> advancing_front(const cloud::Cloud& cloud, Progress& progress);

}  // namespace palpate::baselines
