#include "toolkit/stars/star_walk.h"

#include <algorithm>
#include <cmath>

namespace palpate::stars {
namespace {

/// The angle of a facet at the corner that is `place`.
double angle_at(const Facet& f, std::uint32_t place) noexcept {
  std::uint32_t k = 0;
  while (k < 2 && f.place[k] != place) ++k;
  const Vec3 u = f.corner[corner_after(k)] - f.corner[k];
  const Vec3 v = f.corner[corner_after(corner_after(k))] - f.corner[k];
  return std::atan2(u.cross(v).norm(), u.dot(v));
}

bool at_border(const StarMesh& mesh, const Stand& stand) noexcept {
  if (stand.foot.feature == Feature::kInside) return false;
  const std::uint32_t k = number_of(stand.foot.feature);
  if (is_edge(stand.foot.feature)) return across(mesh, stand.facet, k).place[0] == kNoPlace;
  return mesh.ring(stand.facet.place[k]).open != 0;
}

}  // namespace

Side side_of(const StarMesh& mesh, const Stand& stand, const Vec3& h) noexcept {
  const Vec3 r = h - stand.foot.point;
  Side side;
  side.border = at_border(mesh, stand);
  // Where all facets that meet here see h on one side the sum of their normals, however weighted, does too.
  bool above = false, below = false;
  Vec3 sum = Vec3::Zero();
  for_facets_at(mesh, stand, [&](const Facet& f) noexcept {
    const Vec3 n = f.area_normal();
    const double d = n.dot(r);
    above = above || d > 0.0;
    below = below || d < 0.0;
    const double size = n.norm();
    if (size > 0.0) sum += n / size;
  });
  if (above && below && !is_edge(stand.foot.feature) && stand.foot.feature != Feature::kInside) [[unlikely]] {
    sum = Vec3::Zero();
    const std::uint32_t at = stand.facet.place[number_of(stand.foot.feature)];
    for_facets_at(mesh, stand, [&](const Facet& f) noexcept {
      const Vec3 n = f.area_normal();
      const double size = n.norm();
      if (size > 0.0) sum += n * (angle_at(f, at) / size);
    });
  }
  const double size = sum.norm();
  side.height = size > 0.0 ? sum.dot(r) / size : 0.0;
  return side;
}

}  // namespace palpate::stars
