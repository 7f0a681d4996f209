// A mesh as a true surface, through CGAL. It is independent of the mesh renderers and their reference: CGAL's
// triangle tree and exact predicates, no facet neighbours, no pseudonormals.
#pragma once

#include <memory>

#include <palpate/accuracy.h>
#include <palpate/geometry.h>
#include <palpate/result.h>

namespace palpate::baselines {

/// Closest points of the whole mesh. The sign is that of the first facet on the straight way from the point
/// to the centre of its nearest facet, found by exact predicates: counter-clockwise is outside. If the way
/// meets opposite facets at one place, another place of the nearest facet is tried. Beyond the rim of an open
/// mesh (nearest place on an edge of a single facet, point not over that facet) a point is outside. Facets
/// without area are ignored; corners at one place are merged. Not for frames: some microseconds a query.
class ClosestMesh final : public metrics::TruthSurface {
 public:
  /// An Error if no facet has an area or a vertex is not finite. O(n log n).
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
