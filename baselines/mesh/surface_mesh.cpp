#include "baselines/mesh/surface_mesh.h"

#include <algorithm>
#include <cmath>

namespace palpate::baselines {

geometry::TriangleMesh SurfaceMesh::as_mesh() const {
  geometry::TriangleMesh mesh;
  mesh.vertices_mm.reserve(vertices_.size());
  for (const Vec3& v : vertices_) mesh.vertices_mm.push_back(v + origin_mm_);
  mesh.triangles.reserve(facets_.size());
  for (const Facet& facet : facets_) mesh.triangles.push_back(facet.vertex);
  return mesh;
}

std::size_t SurfaceMesh::bytes() const noexcept {
  return vertices_.capacity() * sizeof(Vec3) + facets_.capacity() * sizeof(Facet) +
         (stars_.begin.capacity() + stars_.items.capacity()) * sizeof(std::uint32_t) +
         radial_.capacity() * sizeof(radial_[0]);
}

double SurfaceMesh::longest_edge_sq(std::uint32_t facet) const noexcept {
  const Facet& f = facets_[facet];
  double longest = 0.0;
  for (std::uint32_t e = 0; e < 3; ++e)
    longest = std::max(longest, (f.corner[after(e)] - f.corner[e]).squaredNorm());
  return longest;
}

Vec3 SurfaceMesh::normal(HalfFacet half) const noexcept {
  const Facet& f = facets_[facet_of(half)];
  const Vec3 n = f.scaled_normal();
  const double size = n.norm();
  if (f.flat(size)) return Vec3::Zero();
  return n * ((side_of(half) == 0 ? 1.0 : -1.0) / size);
}

namespace {

double corner_angle(const Facet& f, std::uint32_t corner) noexcept {
  const Vec3 u = f.corner[after(corner)] - f.corner[corner];
  const Vec3 w = f.corner[before(corner)] - f.corner[corner];
  return std::atan2(u.cross(w).norm(), u.dot(w));
}

Vec3 unit_or_zero(const Vec3& v, double noise) noexcept {
  const double size = v.norm();
  return size > noise ? Vec3(v / size) : Vec3(Vec3::Zero());
}

}  // namespace

bool SurfaceMesh::goes_round(HalfFacet half, Feature feature) const noexcept {
  const HalfFacet back = half ^ 1u;
  if (feature == kInside) return false;
  if (feature < kCorner) return neighbour(half, static_cast<std::uint32_t>(feature - kEdge)) == back;
  bool round = false;
  around_corner(half, static_cast<std::uint32_t>(feature - kCorner),
                [&](HalfFacet other) { round = round || other == back; });
  return round;
}

Vec3 SurfaceMesh::pseudonormal(HalfFacet half, Feature feature, bool* boundary) const noexcept {
  *boundary = false;
  if (feature == kInside) return normal(half);
  if (feature < kCorner) {
    const HalfFacet other = neighbour(half, static_cast<std::uint32_t>(feature - kEdge));
    *boundary = other == kNoFacet;
    if (*boundary) return normal(half);
    return unit_or_zero(normal(half) + normal(other), kFlat);
  }
  const std::uint32_t corner = static_cast<std::uint32_t>(feature - kCorner);
  const std::uint32_t vertex = facets_[facet_of(half)].vertex[corner];
  Vec3 sum = normal(half) * corner_angle(facets_[facet_of(half)], corner);
  *boundary = around_corner(half, corner, [&](HalfFacet other) {
    const Facet& f = facets_[facet_of(other)];
    std::uint32_t at = 0;
    while (at < 2 && f.vertex[at] != vertex) ++at;
    sum += normal(other) * corner_angle(f, at);
  });
  return *boundary ? normal(half) : unit_or_zero(sum, kFlat);
}

}  // namespace palpate::baselines
