// One triangle of a mesh as the mesh renderers and the reference walk it, and the closest point on it.
#pragma once

#include <array>
#include <cstdint>

#include <Eigen/Geometry>

#include "toolkit/core/tolerances.h"
#include "toolkit/core/vec.h"

namespace palpate::baselines {

/// No facet: beyond a boundary edge.
inline constexpr std::uint32_t kNoFacet = 0xFFFFFFFFu;

/// A facet seen from one side: 2 * facet + side. Side 0 is the one from which its corners run
/// counter-clockwise, side 1 the other. Neighbourhood is between half-facets, so that a mesh may be open,
/// two-sided, inconsistently oriented or non-manifold and "the same side, further on" still has one meaning.
using HalfFacet = std::uint32_t;
[[nodiscard]] constexpr std::uint32_t facet_of(HalfFacet half) noexcept {
  return half >> 1;
}
[[nodiscard]] constexpr std::uint32_t side_of(HalfFacet half) noexcept {
  return half & 1u;
}
[[nodiscard]] constexpr HalfFacet half_facet(std::uint32_t facet, std::uint32_t side) noexcept {
  return facet * 2 + side;
}

/// Where on a facet: its inside, edge i (corner i to corner i + 1) as kEdge + i, or corner i as kCorner + i.
using Feature = std::uint8_t;
inline constexpr Feature kInside = 0;
inline constexpr Feature kEdge = 1;
inline constexpr Feature kCorner = 4;

/// The corner after corner i.
[[nodiscard]] constexpr std::uint32_t after(std::uint32_t corner) noexcept {
  return corner == 2 ? 0 : corner + 1;
}
[[nodiscard]] constexpr std::uint32_t before(std::uint32_t corner) noexcept {
  return corner == 0 ? 2 : corner - 1;
}

/// A facet whose doubled area is within this of the product of its sides has a normal of rounding alone:
/// about eight rounded operations stand between corners and normal.
inline constexpr double kFlat = gamma(8);

/// 96 bytes, everything a walk reads: corners in mm relative to the mesh's origin, welded vertex numbers, and
/// what lies across each edge (SurfaceMesh::neighbour decodes it).
struct Facet {
  std::array<Vec3, 3> corner;
  std::array<std::uint32_t, 3> vertex;
  std::array<std::uint32_t, 3> across;

  /// Not normalised: twice the area long, seen from side 0.
  [[nodiscard]] Vec3 scaled_normal() const noexcept {
    return (corner[1] - corner[0]).cross(corner[2] - corner[0]);
  }
  /// Whether it has no area but for rounding. `size`: the length of scaled_normal().
  [[nodiscard]] bool flat(double size) const noexcept {
    return size <= kFlat * (corner[1] - corner[0]).norm() * (corner[2] - corner[0]).norm();
  }
};

struct FacetPoint {
  Vec3 point = Vec3::Zero();
  double distance_sq = 0.0;
  Feature feature = kInside;
};

/// The point of edge `edge` closest to p.
[[nodiscard]] inline FacetPoint closest_on_edge(const Facet& f, std::uint32_t edge, const Vec3& p) noexcept {
  const Vec3& a = f.corner[edge];
  const Vec3& b = f.corner[after(edge)];
  const Vec3 ab = b - a;
  const double along = ab.dot(p - a);
  const double length_sq = ab.squaredNorm();
  if (along <= 0.0) return {a, (p - a).squaredNorm(), static_cast<Feature>(kCorner + edge)};
  if (along >= length_sq) return {b, (p - b).squaredNorm(), static_cast<Feature>(kCorner + after(edge))};
  const Vec3 q = a + ab * (along / length_sq);
  return {q, (p - q).squaredNorm(), static_cast<Feature>(kEdge + edge)};
}

/// The point of the facet closest to p, by the Voronoi regions of its features (Ericson 2005, section 5.1.5,
/// here with the edge planes built from the normal). Unique, since a facet is convex. A facet without area is
/// its edges.
[[nodiscard]] inline FacetPoint closest_on_facet(const Facet& f, const Vec3& p) noexcept {
  const Vec3& a = f.corner[0];
  const Vec3& b = f.corner[1];
  const Vec3& c = f.corner[2];
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return {a, ap.squaredNorm(), kCorner};
  const Vec3 bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return {b, bp.squaredNorm(), kCorner + 1};
  const Vec3 cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return {c, cp.squaredNorm(), kCorner + 2};
  // Edge planes: p is beyond edge i where its product with the outward in-plane direction is not negative.
  const Vec3 n = ab.cross(ac);
  const double beyond_ab = ab.cross(ap).dot(n);
  const double beyond_bc = (c - b).cross(bp).dot(n);
  const double beyond_ca = (a - c).cross(cp).dot(n);
  if (beyond_ab > 0.0 && beyond_bc > 0.0 && beyond_ca > 0.0) {
    const double nn = n.squaredNorm();
    const Vec3 q = p - n * (n.dot(ap) / nn);
    return {q, (p - q).squaredNorm(), kInside};
  }
  FacetPoint best = closest_on_edge(f, 0, p);
  for (std::uint32_t edge = 1; edge < 3; ++edge) {
    const FacetPoint other = closest_on_edge(f, edge, p);
    if (other.distance_sq < best.distance_sq) best = other;
  }
  return best;
}

}  // namespace palpate::baselines
