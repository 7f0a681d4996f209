// Ground truth for scans that come with a mesh: a converged god object on that mesh in double precision.
#pragma once

#include <memory>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/proximity/segment_index.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/rigid_transform.h"
#include "toolkit/metrics/truth.h"
#include "toolkit/trace/trace.h"

namespace palpate::baselines {

/// The mesh as a true surface: closest points over all facets, computed in double (Embree's tree only says
/// which facets to look at, with its float bounds widened), signs by pseudonormals. Outside is the side from
/// which triangles run counter-clockwise; on open meshes the sign is that of the nearest facet.
class MeshTruth final : public metrics::TruthSurface {
 public:
  [[nodiscard]] static Result<std::unique_ptr<MeshTruth>> build(
      const geometry::TriangleMesh& mesh, const geometry::RigidTransform& world_from_model);
  [[nodiscard]] double signed_distance_mm(const Vec3& p_mm) const override;
  [[nodiscard]] geometry::SurfacePoint closest(const Vec3& p_mm) const override;

  [[nodiscard]] const SurfaceMesh& mesh() const noexcept { return *mesh_; }
  [[nodiscard]] const SegmentIndex& index() const noexcept { return *index_; }
  [[nodiscard]] const geometry::RigidTransform& world_from_model() const noexcept {
    return world_from_model_;
  }

 private:
  MeshTruth() = default;
  std::unique_ptr<SurfaceMesh> mesh_;
  std::unique_ptr<SegmentIndex> index_;
  geometry::RigidTransform world_from_model_, model_from_world_;
};

/// Follows the god object along `path`: free until the signed distance turns negative, then the local minimum
/// of the distance reached along the mesh from there, each frame's way walked in pieces until more pieces
/// change nothing. Contact is found by signed distance, not by the segment queries that mesh-godobject uses.
/// In contact the exact closest point of all facets is looked up too; how often it is the god object itself
/// is stated in `exactness`. local_resolution_mm stays 0 (metrics::fill_local_resolution). Never timed.
[[nodiscard]] Result<trace::ReferenceTrace> mesh_reference(const MeshTruth& truth,
                                                           const trace::ProbePath& path,
                                                           double stiffness_n_per_mm, double force_limit_n,
                                                           Progress& progress);

}  // namespace palpate::baselines
