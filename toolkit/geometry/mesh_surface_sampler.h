// Random points on a mesh, uniform by area.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include <Eigen/Geometry>

#include <palpate/triangle_mesh.h>
#include "toolkit/core/random.h"

namespace palpate::geometry {

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

}  // namespace palpate::geometry
