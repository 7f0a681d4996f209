// The jam test: whether a frictionless proxy may rest where it does.
#pragma once

#include <cstddef>

#include "baselines/reference/facet_tree.h"

namespace palpate::baselines {

struct Rest {
  std::size_t touched = 0;  ///< distinct directions from which facets hold the proxy
  double off_rad =
      0.0;  ///< angle between the pull and the nearest pull they can bear; pi / 2 if nothing is touched
};

/// A proxy at `proxy`, a sphere of `radius` (0: a point) pulled towards `hip`, is held by facets within
/// `reach` of its skin. They push along their normals (a point), or from their nearest point to the centre (a
/// sphere). At a local minimum of the distance to the HIP such pushes add up to the pull; any other rest is a
/// jam. Relative to the mesh's origin, mm. O(log facets + touched^3); not for frames.
[[nodiscard]] Rest rest_of(const SurfaceMesh& mesh, const FacetTree& tree, const Vec3& proxy, double radius,
                           double reach, const Vec3& hip);

}  // namespace palpate::baselines
