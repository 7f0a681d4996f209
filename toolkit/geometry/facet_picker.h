// Places on a mesh, even by area.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include <Eigen/Geometry>

#include "toolkit/core/random.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::geometry {

/// Keeps a reference to the mesh, which has at least one triangle with an area. Building O(triangles), a
/// place O(log triangles). Reading is safe from many threads.
class FacetPicker {
 public:
  explicit FacetPicker(const TriangleMesh& mesh) : mesh_(mesh) {
    double area = 0.0;
    up_to_.reserve(mesh.triangles.size());
    for (std::uint32_t i = 0; i < mesh.triangles.size(); ++i)
      up_to_.push_back(area += 0.5 * scaled_normal(i).norm());
  }

  struct Pick {
    Vec3 point = Vec3::Zero();
    std::uint32_t facet = 0;
  };
  /// Anywhere: three numbers of `random`.
  [[nodiscard]] Pick pick(Random& random) const { return pick_at(random.uniform() * area(), random); }
  /// In the facet in which the running sum of areas reaches `at`: two numbers of `random`.
  [[nodiscard]] Pick pick_at(double at, Random& random) const {
    const auto found = std::upper_bound(up_to_.begin(), up_to_.end() - 1, at);
    const auto facet = static_cast<std::uint32_t>(found - up_to_.begin());
    const auto& t = mesh_.triangles[facet];
    // Evenly over a triangle (Turk 1990).
    const double root = std::sqrt(random.uniform()), v = random.uniform();
    return {(1.0 - root) * mesh_.vertices_mm[t[0]] + root * (1.0 - v) * mesh_.vertices_mm[t[1]] +
                root * v * mesh_.vertices_mm[t[2]],
            facet};
  }
  [[nodiscard]] double area() const noexcept { return up_to_.empty() ? 0.0 : up_to_.back(); }
  /// Twice the facet's area long, towards the side from which it is counter-clockwise.
  [[nodiscard]] Vec3 scaled_normal(std::uint32_t facet) const {
    const auto& t = mesh_.triangles[facet];
    return (mesh_.vertices_mm[t[1]] - mesh_.vertices_mm[t[0]])
        .cross(mesh_.vertices_mm[t[2]] - mesh_.vertices_mm[t[0]]);
  }

 private:
  const TriangleMesh& mesh_;
  std::vector<double> up_to_;
};

}  // namespace palpate::geometry
