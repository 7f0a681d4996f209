#include <cmath>
#include <utility>

#include "baselines/reference/mesh_reference.h"

namespace palpate::baselines {

MeshTruth::MeshTruth(SurfaceMesh mesh, const geometry::RigidTransform& world_from_model)
    : mesh_(std::move(mesh)),
      tree_(mesh_),
      world_from_model_(world_from_model),
      model_from_world_(world_from_model.inverse()) {}

Result<std::unique_ptr<MeshTruth>> MeshTruth::build(const geometry::TriangleMesh& mesh,
                                                    const geometry::RigidTransform& world_from_model) {
  auto surface = SurfaceMesh::build(mesh, 0);
  if (!surface.ok()) return std::move(surface).error();
  return std::unique_ptr<MeshTruth>(new MeshTruth(std::move(surface).value(), world_from_model));
}

double MeshTruth::signed_distance_mm(const Vec3& p_mm) const {
  const Vec3 p = model_from_world_ * p_mm - mesh_.origin_mm();
  const FacetTree::Nearest near = tree_.closest(p);
  const double distance = std::sqrt(near.point.distance_sq);
  return outward(near).dot(p - near.point.point) < 0.0 ? -distance : distance;
}

geometry::SurfacePoint MeshTruth::closest(const Vec3& p_mm) const {
  const FacetTree::Nearest near = tree_.closest(model_from_world_ * p_mm - mesh_.origin_mm());
  return {world_from_model_ * (near.point.point + mesh_.origin_mm()),
          world_from_model_.rotate(outward(near))};
}

Vec3 MeshTruth::outward(const FacetTree::Nearest& near) const noexcept {
  bool boundary = false;
  return mesh_.pseudonormal(half_facet(near.facet, 0), near.point.feature, &boundary);
}

}  // namespace palpate::baselines
