// Ground truth for scans with a mesh: the converged god object on it in double, and the mesh as a true
// surface. Slow, untimed, independent of mesh-godobject: no Embree, another walk and index.
#pragma once

#include <memory>

#include <palpate/accuracy.h>
#include <palpate/geometry.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "baselines/mesh/surface_mesh.h"
#include "baselines/reference/facet_tree.h"

namespace palpate::baselines {

/// The mesh as a true surface: exact closest points in double from its own box tree, signs by the
/// angle-weighted pseudonormal (Baerentzen and Aanaes 2005). Triangles run counter-clockwise seen from
/// outside; beyond an open rim the nearest facet's plane gives the sign.
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
  FacetTree tree_;  ///< refers to mesh_, which must not move
  geometry::RigidTransform world_from_model_, model_from_world_;
};

struct MeshReferenceOptions {
  /// Longest piece of a frame's way in median edges of the mesh.
  double piece_per_edge = 0.25;
  int max_pieces = 256;  ///< per frame; frames that reach it are counted in `exactness`
};

/// The true god object step by step, to choose the next motion by what was felt. Keeps a reference to the
/// truth. Not thread-safe.
class MeshFollower {
 public:
  explicit MeshFollower(const MeshTruth& truth, const MeshReferenceOptions& options = {});
  MeshFollower(MeshFollower&&) noexcept;
  MeshFollower& operator=(MeshFollower&&) noexcept;
  ~MeshFollower();
  /// Moves the HIP to `hip_mm` (world); the first one is free. True in contact.
  bool advance(const Vec3& hip_mm);
  /// In contact, world frame.
  [[nodiscard]] Vec3 god_object_mm() const;

  struct State;

 private:
  std::unique_ptr<State> state_;
};

/// The god object along `path` (world frame). It is free until the way pierces the mesh, then the local
/// minimum of the distance reached along the surface, walked in pieces until nothing moves; past an open rim
/// by more than an edge it is free again, and a surface much nearer to the HIP that faces the same way takes
/// it over (geometry/god_object_check.h). Force = stiffness x (god object - HIP), limited (0 = none).
/// signed_distance_mm is minus the depth in contact, else the unsigned distance. local_resolution_mm stays 0
/// (metrics::fill_local_resolution). `exactness` says how often the god object's distance, tested in every
/// frame, agrees with the exact closest point. A path that starts inside is an Error. Never timed.
[[nodiscard]] Result<trace::ReferenceTrace> mesh_reference(const MeshTruth& truth,
                                                           const trace::ProbePath& path,
                                                           double stiffness_n_per_mm, double force_limit_n,
                                                           Progress& progress,
                                                           const MeshReferenceOptions& options = {});

}  // namespace palpate::baselines
