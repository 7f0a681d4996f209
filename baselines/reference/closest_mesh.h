// A mesh as a true surface that shares nothing with the mesh renderers and their reference: CGAL's tree of
// triangles and its exact predicates, no neighbourhood of facets, no normals of vertices or edges.
#pragma once

#include <memory>

#include "toolkit/core/result.h"
#include "toolkit/geometry/rigid_transform.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/metrics/truth.h"

namespace palpate::baselines {

/// Closest points of the whole mesh. The side is that from which the first facet is seen on the straight way
/// from the point to the middle of its nearest facet: counter-clockwise is outside. What the way meets is
/// found by exact predicates; where two facets are met at one place and face opposite ways, another place of
/// the nearest facet is looked at. Beyond the rim of an open mesh (its nearest place is on an edge of one
/// facet alone, and it does not lie over that facet) a point is outside. Facets without area are left out;
/// corners at one and the same place are one. Not for frames: some microseconds a question.
class ClosestMesh final : public metrics::TruthSurface {
 public:
  /// An Error where no facet has an area, or a vertex is not finite. O(n log n).
  [[nodiscard]] static Result<std::unique_ptr<ClosestMesh>> build(
      const geometry::TriangleMesh& mesh, const geometry::RigidTransform& world_from_model);
  ~ClosestMesh() override;

  [[nodiscard]] double signed_distance_mm(const Vec3& p_mm) const override;
  /// The normal is that of the nearest facet.
  [[nodiscard]] geometry::SurfacePoint closest(const Vec3& p_mm) const override;

 private:
  struct Tree;
  ClosestMesh(std::unique_ptr<Tree> tree, const geometry::RigidTransform& world_from_model);

  std::unique_ptr<Tree> tree_;
  geometry::RigidTransform world_from_model_, model_from_world_;
};

}  // namespace palpate::baselines
