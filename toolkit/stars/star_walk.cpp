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

/// Adds the area normals at a place, and their lengths.
void add_areas(const StarMesh& mesh, std::uint32_t place, Vec3& sum, double& area) noexcept {
  const Ring ring = mesh.ring(place);
  const Vec3 p = mesh.at(place);
  for (std::uint32_t k = 0; k < ring.size; ++k) {
    if (!ring.has_sector(k)) continue;
    const Vec3 n = (mesh.at(ring.of[k]) - p).cross(mesh.at(ring.of[ring.next(k)]) - p);
    sum += n;
    area += n.norm();
  }
}

}  // namespace

Trend trend_around(const StarMesh& mesh, const Facet& facet, bool wide) noexcept {
  Trend trend;
  double area = 0.0;
  for (const std::uint32_t place : facet.place) {
    add_areas(mesh, place, trend.normal, area);
    if (!wide) continue;
    const Ring ring = mesh.ring(place);
    for (std::uint32_t k = 0; k < ring.size; ++k) add_areas(mesh, ring.of[k], trend.normal, area);
  }
  if (area > 0.0) trend.share = trend.normal.norm() / area;
  return trend;
}

Side side_of(const StarMesh& mesh, const Stand& stand, const Vec3& h) noexcept {
  const Vec3 r = h - stand.foot.point;
  Side side;
  side.border = at_border(mesh, stand);
  // Where all facets that meet here see h on one side any sum of their normals, however weighted, does too.
  bool above = false, below = false;
  for_facets_at(mesh, stand, [&](const Facet& f) noexcept {
    const Vec3 n = f.area_normal();
    const double d = side_over(n, r);
    above = above || d > 0.0;
    below = below || d < 0.0;
    side.area += n;
  });
  if (!(above && below)) [[likely]] {
    side.height = above ? 1.0 : below ? -1.0 : 0.0;
    return side;
  }
  const Feature feature = stand.foot.feature;
  const bool at_corner = !is_edge(feature) && feature != Feature::kInside;
  const std::uint32_t at = at_corner ? stand.facet.place[number_of(feature)] : kNoPlace;
  Vec3 sum = Vec3::Zero();
  for_facets_at(mesh, stand, [&](const Facet& f) noexcept {
    const Vec3 n = f.area_normal();
    const double size = n.norm();
    if (size > 0.0) sum += n * ((at_corner ? angle_at(f, at) : 1.0) / size);
  });
  side.height = sum.dot(r);
  return side;
}

}  // namespace palpate::stars
