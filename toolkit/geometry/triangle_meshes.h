// Triangle meshes: smooth subdivision, welding, random points uniform by area, and the first hit of a ray.
#pragma once

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/geometry.h>
#include <palpate/vec.h>
#include "toolkit/core/random.h"
#include "toolkit/geometry/broad_phase.h"

namespace palpate::geometry {

/// One side of a triangle, sortable next to the other side of its edge.
struct TriangleSide {
  std::uint32_t low, high, triangle, corner;  ///< corner: start of the side
  [[nodiscard]] bool same(const TriangleSide& o) const { return low == o.low && high == o.high; }
};
/// All sides, those of an edge together, by triangle and corner. O(n log n).
[[nodiscard]] std::vector<TriangleSide> sides_of(const std::vector<std::array<std::uint32_t, 3>>& triangles);

/// One step of Loop subdivision (1987, weights of Warren 1995): each triangle becomes four, old vertices
/// move, every edge gets a vertex. Edges without exactly two triangles, and their ends, follow border rules;
/// facets that repeat a vertex are dropped. Vertices are distinguished by index, so weld first. O(n log n).
[[nodiscard]] TriangleMesh loop_subdivided(const TriangleMesh& mesh);

/// Merges vertices at bit-identical places, in order of the first; drops facets that lose a corner. O(n log
/// n).
[[nodiscard]] TriangleMesh welded(const TriangleMesh& mesh);

/// Weight of the ends' tangent difference in the middle of a cubic Hermite segment.
inline constexpr double kHermiteMidpointWeight = 0.125;

/// The middle of the curve that leaves both ends along their planes. Normals are unit, or zero for none.
[[nodiscard]] inline Vec3 hermite_midpoint(const Vec3& a, const Vec3& b, const Vec3& normal_a,
                                           const Vec3& normal_b) noexcept {
  const Vec3 chord = b - a;
  const Vec3 middle = 0.5 * (a + b);
  if (normal_a == Vec3::Zero() || normal_b == Vec3::Zero()) return middle;
  const Vec3 along_a = chord - normal_a * normal_a.dot(chord);
  const Vec3 along_b = chord - normal_b * normal_b.dot(chord);
  return middle + kHermiteMidpointWeight * (along_a - along_b);
}

/// Keeps a reference to the mesh, which needs a triangle with area. Building O(triangles), a sample O(log
/// triangles). Concurrent reads are safe.
class MeshSurfaceSampler {
 public:
  explicit MeshSurfaceSampler(const TriangleMesh& mesh) : mesh_(mesh) {
    double area = 0.0;
    cumulative_area_.reserve(mesh.triangles.size());
    for (std::uint32_t i = 0; i < mesh.triangles.size(); ++i)
      cumulative_area_.push_back(area += 0.5 * scaled_normal(i).norm());
  }

  struct Pick {
    Vec3 point = Vec3::Zero();
    std::uint32_t facet = 0;
  };
  /// A uniform sample; takes three numbers from `random`.
  [[nodiscard]] Pick pick(Random& random) const { return pick_at(random.uniform() * area(), random); }
  /// A sample in the facet where the cumulative area reaches `at`; takes two numbers from `random`.
  [[nodiscard]] Pick pick_at(double at, Random& random) const {
    const auto found = std::upper_bound(cumulative_area_.begin(), cumulative_area_.end() - 1, at);
    const auto facet = static_cast<std::uint32_t>(found - cumulative_area_.begin());
    const auto& t = mesh_.triangles[facet];
    // Uniform over a triangle (Turk 1990).
    const double root = std::sqrt(random.uniform()), v = random.uniform();
    return {(1.0 - root) * mesh_.vertices_mm[t[0]] + root * (1.0 - v) * mesh_.vertices_mm[t[1]] +
                root * v * mesh_.vertices_mm[t[2]],
            facet};
  }
  [[nodiscard]] double area() const noexcept {
    return cumulative_area_.empty() ? 0.0 : cumulative_area_.back();
  }
  /// Twice the facet's area long, towards the side from which it is counter-clockwise.
  [[nodiscard]] Vec3 scaled_normal(std::uint32_t facet) const {
    const auto& t = mesh_.triangles[facet];
    return (mesh_.vertices_mm[t[1]] - mesh_.vertices_mm[t[0]])
        .cross(mesh_.vertices_mm[t[2]] - mesh_.vertices_mm[t[0]]);
  }

 private:
  const TriangleMesh& mesh_;
  std::vector<double> cumulative_area_;
};

/// Keeps a reference to the mesh. Building O(n log n); concurrent reads are safe.
class MeshRayCaster {
 public:
  explicit MeshRayCaster(const TriangleMesh& mesh)
      : mesh_(mesh),
        tree_(
            static_cast<std::uint32_t>(mesh.triangles.size()),
            [&mesh](std::uint32_t i) {
              Aabb box;
              for (const std::uint32_t v : mesh.triangles[i]) box.add(mesh.vertices_mm[v]);
              return box;
            },
            kLeaf) {}

  /// The first facet between a and b, from either side; the normal points back along the ray. Double
  /// arithmetic: a ray through an edge may slip between two facets. Usually O(log n).
  [[nodiscard]] std::optional<SurfacePoint> first_hit(const Vec3& a, const Vec3& b) const {
    const Vec3 d = b - a;
    double first = 1.0;
    std::optional<std::uint32_t> facet;
    tree_.visit([&](const Aabb& box) { return meets(box, a, d, first); },
                [&](std::uint32_t i) {
                  const std::optional<double> at = share(i, a, d);
                  if (!at || *at > first || (*at == first && facet && i > *facet)) return;
                  first = *at;
                  facet = i;
                });
    if (!facet) return std::nullopt;
    const auto& t = mesh_.triangles[*facet];
    Vec3 n = (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])).normalized();
    if (n.dot(d) > 0.0) n = -n;
    return SurfacePoint{a + first * d, n};
  }

 private:
  static constexpr std::uint32_t kLeaf = 4;  ///< facets a leaf; affects speed only

  [[nodiscard]] const Vec3& corner(std::uint32_t vertex) const { return mesh_.vertices_mm[vertex]; }

  static bool meets(const Aabb& box, const Vec3& a, const Vec3& d, double end) noexcept {
    double from = 0.0, to = end;
    for (int axis = 0; axis < 3; ++axis) {
      const double low = box.low_mm[axis] - a[axis], high = box.high_mm[axis] - a[axis];
      if (d[axis] == 0.0) {
        if (low > 0.0 || high < 0.0) return false;
        continue;
      }
      from = std::max(from, std::min(low / d[axis], high / d[axis]));
      to = std::min(to, std::max(low / d[axis], high / d[axis]));
    }
    return from <= to;
  }
  /// Moeller and Trumbore 1997.
  [[nodiscard]] std::optional<double> share(std::uint32_t facet, const Vec3& a, const Vec3& d) const {
    const auto& t = mesh_.triangles[facet];
    const Vec3 e1 = corner(t[1]) - corner(t[0]), e2 = corner(t[2]) - corner(t[0]), s = a - corner(t[0]);
    const Vec3 p = d.cross(e2), q = s.cross(e1);
    const double determinant = e1.dot(p);
    if (determinant == 0.0) return std::nullopt;
    const double u = s.dot(p) / determinant, v = d.dot(q) / determinant, at = e2.dot(q) / determinant;
    if (!(u >= 0.0) || !(v >= 0.0) || !(u + v <= 1.0) || !(at >= 0.0)) return std::nullopt;
    return at;
  }

  const TriangleMesh& mesh_;
  AabbTree tree_;
};

}  // namespace palpate::geometry
