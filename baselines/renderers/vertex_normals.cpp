#include "baselines/renderers/vertex_normals.h"

namespace palpate::baselines {

std::vector<Vec3f> interpolation_normals(const SurfaceMesh& mesh) {
  std::vector<Vec3f> normals(mesh.vertices().size(), Vec3f::Zero());
  for (std::uint32_t v = 0; v < normals.size(); ++v) {
    if (mesh.star(v).empty()) continue;
    const std::uint32_t facet = mesh.star(v)[0];
    std::uint32_t corner = 0;
    while (corner < 2 && mesh.facet(facet).vertex[corner] != v) ++corner;
    Vec3 sum = mesh.facet(facet).scaled_normal();
    mesh.around_corner(half_facet(facet, 0), corner, [&](HalfFacet half) {
      sum += mesh.facet(facet_of(half)).scaled_normal() * (side_of(half) == 0 ? 1.0 : -1.0);
    });
    const double size = sum.norm();
    if (size > 0.0) normals[v] = (sum / size).cast<float>();
  }
  return normals;
}

std::array<double, 3> corner_shares(const Facet& f, const Vec3& point) noexcept {
  std::array<double, 3> share;
  double sum = 0.0;
  for (std::uint32_t i = 0; i < 3; ++i) {
    share[i] = (f.corner[after(i)] - point).cross(f.corner[before(i)] - point).norm();
    sum += share[i];
  }
  if (!(sum > 0.0)) return {1.0, 0.0, 0.0};
  for (double& s : share) s /= sum;
  return share;
}

Vec3 interpolated_normal(const Facet& f, std::span<const Vec3f> vertex_normals, const Vec3& point,
                         const Vec3& side) noexcept {
  const std::array<double, 3> share = corner_shares(f, point);
  Vec3 blend = Vec3::Zero();
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 corner_normal = vertex_normals[f.vertex[i]].cast<double>();
    blend += corner_normal * (corner_normal.dot(side) < 0.0 ? -share[i] : share[i]);
  }
  const double size = blend.norm();
  return size > 0.0 ? Vec3(blend / size) : side;
}

}  // namespace palpate::baselines
