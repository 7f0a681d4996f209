// A mesh seen from one side. Internal to trace.
#pragma once

#include <memory>

#include "toolkit/trace/seen_surface.h"

namespace palpate::trace {

/// The outermost facet along every line of sight, its height exact and its normal blended from those of its
/// corners, so that the normal runs on from facet to facet. Keeps a reference to the mesh. An Error where no
/// facet shows its outer side. O(faces).
[[nodiscard]] Result<std::unique_ptr<SeenSurface>> see_mesh(const View& view,
                                                            const geometry::TriangleMesh& mesh,
                                                            const Vec3& origin_mm);

}  // namespace palpate::trace
