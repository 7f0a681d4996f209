// One triangle of a mesh, and its closest points. Mesh renderers and the reference walk it.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include <Eigen/Geometry>

#include <palpate/geometry.h>
#include <palpate/vec.h>
#include "toolkit/core/tolerances.h"

namespace palpate::baselines {

/// No facet, as beyond a boundary edge.
inline constexpr std::uint32_t kNoFacet = 0xFFFFFFFFu;

/// A side of a facet: 2 * facet + side. From side 0 the corners run counter-clockwise. Half-facets have
/// neighbours, so "the same side" also continues on open, two-sided, inconsistently oriented and non-manifold
/// meshes.
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

/// Location on a facet: inside, edge i (corner i to i + 1) as kEdge + i, or corner i as kCorner + i.
using Feature = std::uint8_t;
inline constexpr Feature kInside = 0;
inline constexpr Feature kEdge = 1;
inline constexpr Feature kCorner = 4;

[[nodiscard]] constexpr std::uint32_t after(std::uint32_t corner) noexcept {
  return corner == 2 ? 0 : corner + 1;
}
[[nodiscard]] constexpr std::uint32_t before(std::uint32_t corner) noexcept {
  return corner == 0 ? 2 : corner - 1;
}

/// Up to this share of the product of two sides, a doubled area and its normal are rounding: about eight
/// operations from corners to normal.
inline constexpr double kFlat = gamma(8);

/// 96 bytes with all that a walk reads: corners (mm, relative to the mesh's origin), welded vertex numbers,
/// coded neighbours (SurfaceMesh::neighbour).
struct Facet {
  std::array<Vec3, 3> corner;
  std::array<std::uint32_t, 3> vertex;
  std::array<std::uint32_t, 3> across;

  /// Normal of side 0 with length twice the area.
  [[nodiscard]] Vec3 scaled_normal() const noexcept {
    return (corner[1] - corner[0]).cross(corner[2] - corner[0]);
  }
  /// Whether the area is only rounding. `size`: length of scaled_normal().
  [[nodiscard]] bool flat(double size) const noexcept {
    return size <= kFlat * (corner[1] - corner[0]).norm() * (corner[2] - corner[0]).norm();
  }
};

struct FacetPoint {
  Vec3 point = Vec3::Zero();
  double distance_sq = 0.0;
  Feature feature = kInside;
};

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

/// Closest point to p on the facet, by Voronoi regions (Ericson 2005, section 5.1.5, with edge planes from
/// the normal). Unique, since a facet is convex. Without area, a facet is its edges.
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
  // p is beyond edge i if its product with the outward in-plane direction is not negative.
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

/// Whether two facets share a vertex.
[[nodiscard]] inline bool share_vertex(const Facet& f, const Facet& g) noexcept {
  for (const std::uint32_t a : f.vertex)
    for (const std::uint32_t b : g.vertex)
      if (a == b) return true;
  return false;
}

/// Shortens the part [first, last] of the line from + t way to what is in the box grown by `slack`; false if
/// nothing is.
[[nodiscard]] inline bool clip_to_box(const geometry::Aabb& box, const Vec3& from, const Vec3& way,
                                      double slack, double& first, double& last) noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    const double low = box.low_mm[axis] - slack - from[axis], high = box.high_mm[axis] + slack - from[axis];
    if (way[axis] == 0.0) {
      if (low > 0.0 || high < 0.0) return false;
      continue;
    }
    const double a = low / way[axis], b = high / way[axis];
    first = std::max(first, std::min(a, b));
    last = std::min(last, std::max(a, b));
  }
  return first <= last;
}

}  // namespace palpate::baselines
