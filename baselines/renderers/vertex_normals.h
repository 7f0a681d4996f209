// Values interpolated over facets: what force shading and properties that vary read.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// Per vertex the area-weighted mean over its fan, unit, on the side that its first facet calls 0; zero where
/// it vanishes. O(facets).
[[nodiscard]] std::vector<Vec3f> interpolation_normals(const SurfaceMesh& mesh);

/// Shares of the corners at a point of the facet: the areas opposite to them, adding up to 1; all at the
/// first corner where there is no area.
[[nodiscard]] std::array<double, 3> corner_shares(const Facet& f, const Vec3& point) noexcept;

/// At a point of the facet, each corner's normal taken on the side of `side`, weighted by the area opposite
/// to it; `side` itself where they cancel. Unit where `side` is.
[[nodiscard]] Vec3 interpolated_normal(const Facet& f, std::span<const Vec3f> vertex_normals,
                                       const Vec3& point, const Vec3& side) noexcept;

}  // namespace palpate::baselines
