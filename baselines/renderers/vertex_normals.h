// Normals interpolated over facets: what force shading on a mesh reads.
#pragma once

#include <span>
#include <vector>

#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// Per vertex the area-weighted mean over its fan, unit, on the side that its first facet calls 0; zero where
/// it vanishes. O(facets).
[[nodiscard]] std::vector<Vec3f> interpolation_normals(const SurfaceMesh& mesh);

/// At a point of the facet, each corner's normal taken on the side of `side`, weighted by the area opposite
/// to it; `side` itself where they cancel. Unit where `side` is.
[[nodiscard]] Vec3 interpolated_normal(const Facet& f, std::span<const Vec3f> vertex_normals,
                                       const Vec3& point, const Vec3& side) noexcept;

}  // namespace palpate::baselines
