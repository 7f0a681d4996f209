#include "toolkit/geometry/triangle_meshes.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <tuple>

namespace palpate::geometry {

std::vector<TriangleSide> sides_of(const std::vector<std::array<std::uint32_t, 3>>& triangles) {
  std::vector<TriangleSide> sides;
  sides.reserve(3 * triangles.size());
  for (std::uint32_t t = 0; t < triangles.size(); ++t)
    for (std::uint32_t c = 0; c < 3; ++c) {
      const auto [low, high] = std::minmax(triangles[t][c], triangles[t][(c + 1) % 3]);
      sides.push_back({low, high, t, c});
    }
  std::sort(sides.begin(), sides.end(), [](const TriangleSide& a, const TriangleSide& b) {
    return std::tie(a.low, a.high, a.triangle, a.corner) < std::tie(b.low, b.high, b.triangle, b.corner);
  });
  return sides;
}

namespace {

bool repeats(const std::array<std::uint32_t, 3>& t) {
  return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
}

/// Sums over a vertex's ring.
struct Ring {
  Vec3 sum = Vec3::Zero(), rim_sum = Vec3::Zero();
  std::uint32_t count = 0, rim_count = 0;
};

Vec3 moved(const Vec3& p, const Ring& ring) {
  if (ring.rim_count > 0)  // a corner of several borders stays
    return ring.rim_count == 2 ? Vec3(0.75 * p + 0.125 * ring.rim_sum) : p;
  if (ring.count < 3) return p;
  const double n = ring.count, weight = ring.count == 3 ? 3.0 / 16.0 : 3.0 / (8.0 * n);
  return (1.0 - n * weight) * p + weight * ring.sum;
}

}  // namespace

TriangleMesh loop_subdivided(const TriangleMesh& mesh) {
  std::vector<std::array<std::uint32_t, 3>> triangles;
  for (const auto& t : mesh.triangles)
    if (!repeats(t)) triangles.push_back(t);
  const std::vector<TriangleSide> sides = sides_of(triangles);
  TriangleMesh fine;
  fine.vertices_mm = mesh.vertices_mm;
  std::vector<Ring> rings(mesh.vertices_mm.size());
  std::vector<std::array<std::uint32_t, 3>> middle(triangles.size());
  for (std::size_t i = 0, end = 0; i < sides.size(); i = end) {
    while (end < sides.size() && sides[end].same(sides[i])) ++end;
    const std::uint32_t a = sides[i].low, b = sides[i].high;
    const Vec3 &pa = mesh.vertices_mm[a], &pb = mesh.vertices_mm[b];
    const auto opposite = [&](const TriangleSide& s) {
      return mesh.vertices_mm[triangles[s.triangle][(s.corner + 2) % 3]];
    };
    const bool inner = end - i == 2;
    for (std::size_t k = i; k < end; ++k)
      middle[sides[k].triangle][sides[k].corner] = static_cast<std::uint32_t>(fine.vertices_mm.size());
    fine.vertices_mm.push_back(
        inner ? Vec3(0.375 * (pa + pb) + 0.125 * (opposite(sides[i]) + opposite(sides[i + 1])))
              : Vec3(0.5 * (pa + pb)));
    for (const auto& [at, other] : {std::pair(a, pb), std::pair(b, pa)}) {
      rings[at].sum += other;
      ++rings[at].count;
      if (inner) continue;
      rings[at].rim_sum += other;
      ++rings[at].rim_count;
    }
  }
  for (std::size_t v = 0; v < rings.size(); ++v) fine.vertices_mm[v] = moved(mesh.vertices_mm[v], rings[v]);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const auto& v = triangles[t];
    const auto& m = middle[t];
    fine.triangles.insert(fine.triangles.end(),
                          {{v[0], m[0], m[2]}, {m[0], v[1], m[1]}, {m[2], m[1], v[2]}, {m[0], m[1], m[2]}});
  }
  return fine;
}

TriangleMesh welded(const TriangleMesh& mesh) {
  const auto key = [&](std::uint32_t i) {
    const Vec3& p = mesh.vertices_mm[i];
    return std::array<double, 3>{p.x(), p.y(), p.z()};
  };
  std::vector<std::uint32_t> order(mesh.vertices_mm.size()), first(order.size()), number(order.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return key(a) != key(b) ? key(a) < key(b) : a < b; });
  for (std::size_t k = 0; k < order.size(); ++k)
    first[order[k]] = k > 0 && key(order[k]) == key(order[k - 1]) ? first[order[k - 1]] : order[k];
  TriangleMesh one;
  for (std::uint32_t v = 0; v < first.size(); ++v) {
    if (first[v] == v) {
      number[v] = static_cast<std::uint32_t>(one.vertices_mm.size());
      one.vertices_mm.push_back(mesh.vertices_mm[v]);
    }
  }
  for (const auto& t : mesh.triangles) {
    const std::array<std::uint32_t, 3> corners = {number[first[t[0]]], number[first[t[1]]],
                                                  number[first[t[2]]]};
    if (!repeats(corners)) one.triangles.push_back(corners);
  }
  return one;
}

}  // namespace palpate::geometry
