#include "toolkit/local_delaunay/mesh_descent.h"

#include <algorithm>
#include <cmath>

namespace palpate::local_delaunay {
namespace {

/// The facet's angle at the corner `place`.
double angle_at(const Facet& f, std::uint32_t place) noexcept {
  std::uint32_t k = 0;
  while (k < 2 && f.place[k] != place) ++k;
  const Vec3 u = f.corner[next_corner(k)] - f.corner[k];
  const Vec3 v = f.corner[next_corner(next_corner(k))] - f.corner[k];
  return std::atan2(u.cross(v).norm(), u.dot(v));
}

bool at_border(const LocalDelaunayMesh& mesh, const SurfacePosition& position) noexcept {
  if (position.closest.feature == Feature::kInside) return false;
  const std::uint32_t k = feature_index(position.closest.feature);
  if (is_edge(position.closest.feature)) return across(mesh, position.facet, k).place[0] == kNoPlace;
  return mesh.ring(position.facet.place[k]).open != 0;
}

/// Adds the area normals at a place, and their lengths.
void add_areas(const LocalDelaunayMesh& mesh, std::uint32_t place, Vec3& sum, double& area) noexcept {
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

MeanOrientation mean_orientation_around(const LocalDelaunayMesh& mesh, const Facet& facet,
                                        bool wide) noexcept {
  MeanOrientation trend;
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

Side side_of(const LocalDelaunayMesh& mesh, const SurfacePosition& position, const Vec3& h) noexcept {
  const Vec3 r = h - position.closest.point;
  Side side;
  side.border = at_border(mesh, position);
  // If all facets here see h on one side, so does any weighted sum of their normals.
  bool above = false, below = false;
  for_facets_at(mesh, position, [&](const Facet& f) noexcept {
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
  const Feature feature = position.closest.feature;
  const bool at_corner = !is_edge(feature) && feature != Feature::kInside;
  const std::uint32_t at = at_corner ? position.facet.place[feature_index(feature)] : kNoPlace;
  Vec3 sum = Vec3::Zero();
  for_facets_at(mesh, position, [&](const Facet& f) noexcept {
    const Vec3 n = f.area_normal();
    const double size = n.norm();
    if (size > 0.0) sum += n * ((at_corner ? angle_at(f, at) : 1.0) / size);
  });
  side.height = sum.dot(r);
  return side;
}

}  // namespace palpate::local_delaunay
