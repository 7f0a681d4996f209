// How far places lie from a mesh: what smoothing and decimation cost in shape.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/proximity/segment_index.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

struct MeshGap {
  double rms_mm = 0.0;
  double max_mm = 0.0;  ///< one side of the Hausdorff distance, sampled
  std::size_t places = 0;
};

/// From `places` (model frame) to the nearest place of the mesh. The facet is chosen in float, the distance
/// computed in double. O(places x log facets), on `threads`; the same for any number of them.
[[nodiscard]] MeshGap gap_to(const SurfaceMesh& mesh, const SegmentIndex& index, std::span<const Vec3> places,
                             int threads);

/// `count` places spread evenly over the area of a mesh, the same on every run. Empty without area.
[[nodiscard]] std::vector<Vec3> places_on(const geometry::TriangleMesh& mesh, std::size_t count);

}  // namespace palpate::baselines
