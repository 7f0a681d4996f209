// Reconstruction of a surface from points: CGAL's advancing front (Cohen-Steiner and Da 2004), default
// settings.
#pragma once

#include <string>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

struct ReconstructionReport {
  double triangulation_ms = 0.0;  ///< Delaunay
  double front_ms = 0.0;
  std::size_t duplicates = 0;  ///< points at the place of an earlier one: one vertex for all
};

/// The mesh through the cloud's points, in double; vertex i is point i (duplicates stay as unused vertices),
/// triangle order and orientation as CGAL gives them. One thread; CGAL offers no way to stop it, so
/// `progress` is told the phases and asked for cancellation only before and between them. Points that span no
/// volume's worth of triangles (fewer than three, or on a line) are an Error. About 25 us a point.
[[nodiscard]] Result<geometry::TriangleMesh> advancing_front(const cloud::Cloud& cloud, Progress& progress,
                                                             ReconstructionReport* report = nullptr);

}  // namespace palpate::baselines
