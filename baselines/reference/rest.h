// Whether a frictionless proxy that has come to rest may rest there: the jam test.
#pragma once

#include <cstddef>

#include "baselines/reference/facet_tree.h"

namespace palpate::baselines {

struct Rest {
  std::size_t touched = 0;  ///< directions from which facets hold the proxy, equal ones counted once
  double off_rad = 0.0;     ///< angle between the pull and the nearest pull that those can bear; pi / 2 where
                            ///< nothing is touched
};

/// A proxy at `proxy`, a sphere of `radius` (0: a point) pulled towards `hip`, rests on facets within
/// `reach` of its skin: those push along their normals (a point), or from their nearest point to the centre
/// (a sphere). It is at a local minimum of the distance to the HIP when the pull is a sum of such pushes. Any
/// other rest is a jam. Relative to the mesh's origin, mm. O(log facets + touched^3); an oracle, not for
/// frames.
[[nodiscard]] Rest rest_of(const SurfaceMesh& mesh, const FacetTree& tree, const Vec3& proxy, double radius,
                           double reach, const Vec3& hip);

}  // namespace palpate::baselines
