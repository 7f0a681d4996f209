// Ground truth for scans that come with a mesh: the converged god object on that mesh, in double, and the
// mesh as a surface to ask. Slow, never timed, and apart from mesh-godobject: no Embree, another walk,
// another index.
#pragma once

#include <memory>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/reference/facet_tree.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/rigid_transform.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/metrics/truth.h"
#include "toolkit/trace/trace.h"

namespace palpate::baselines {

/// The mesh as a true surface: exact closest points in double from its own box tree, signs by the
/// angle-weighted pseudonormal there (Baerentzen and Aanaes 2005). Outside is the side from which triangles
/// run counter-clockwise; beyond the rim of an open mesh the sign is that of the nearest facet's plane.
class MeshTruth final : public metrics::TruthSurface {
 public:
  [[nodiscard]] static Result<std::unique_ptr<MeshTruth>> build(
      const geometry::TriangleMesh& mesh, const geometry::RigidTransform& world_from_model);
  [[nodiscard]] double signed_distance_mm(const Vec3& p_mm) const override;
  [[nodiscard]] geometry::SurfacePoint closest(const Vec3& p_mm) const override;

  [[nodiscard]] const SurfaceMesh& mesh() const noexcept { return mesh_; }
  [[nodiscard]] const FacetTree& tree() const noexcept { return tree_; }
  [[nodiscard]] const geometry::RigidTransform& world_from_model() const noexcept {
    return world_from_model_;
  }

 private:
  MeshTruth(SurfaceMesh mesh, const geometry::RigidTransform& world_from_model);
  [[nodiscard]] Vec3 outward(const FacetTree::Nearest& near) const noexcept;

  SurfaceMesh mesh_;
  FacetTree tree_;  ///< of mesh_, which therefore never moves
  geometry::RigidTransform world_from_model_, model_from_world_;
};

struct MeshReferenceOptions {
  /// Pieces of a frame's way are at most this part of the mesh's median edge.
  double piece_per_edge = 0.25;
  int max_pieces = 256;  ///< a frame; where it is reached, frames are counted in `exactness`
};

/// The god object of the truth, step by step: for whoever decides by what it felt where to go next. Keeps a
/// reference to the truth. Not thread-safe.
class MeshFollower {
 public:
  explicit MeshFollower(const MeshTruth& truth, const MeshReferenceOptions& options = {});
  MeshFollower(MeshFollower&&) noexcept;
  MeshFollower& operator=(MeshFollower&&) noexcept;
  ~MeshFollower();
  /// The HIP (world) has gone to `hip_mm`; the first one is free. True in contact.
  bool advance(const Vec3& hip_mm);
  /// In contact, world.
  [[nodiscard]] Vec3 god_object_mm() const;

  struct State;

 private:
  std::unique_ptr<State> state_;
};

/// The god object along `path` (world frame): free until the way pierces the mesh, then the local minimum of
/// the distance reached along the surface, the HIP's way taken in pieces and the walk repeated until nothing
/// moves; past the rim of an open mesh by more than an edge's length it is free again. Force = stiffness x
/// (god object - HIP), limited (0 = none). signed_distance_mm: minus the depth in contact, else the distance
/// to the mesh, whatever the side. local_resolution_mm stays 0 (metrics::fill_local_resolution). In every
/// frame the god object's distance is compared with the exact closest point of the whole mesh; how often they
/// agree is said in `exactness`. A path that starts inside is an Error. Never timed.
[[nodiscard]] Result<trace::ReferenceTrace> mesh_reference(const MeshTruth& truth,
                                                           const trace::ProbePath& path,
                                                           double stiffness_n_per_mm, double force_limit_n,
                                                           Progress& progress,
                                                           const MeshReferenceOptions& options = {});

}  // namespace palpate::baselines
