// First hit of a ray on a mesh, for the simulated scanner.
#pragma once

#include <cmath>
#include <optional>

#include <Eigen/Geometry>

#include <palpate/analytic_surface.h>
#include <palpate/triangle_mesh.h>
#include "toolkit/geometry/aabb_tree.h"

namespace palpate::geometry {

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
