// A plain indexed triangle mesh: what files hold, reconstructions make and mesh renderers take.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toolkit/core/vec.h"

namespace palpate::geometry {

/// Vertices in mm (model frame) and triangles of vertex indices, counter-clockwise seen from outside where
/// the source knows an outside. Nothing is guaranteed beyond indices in range: files hold what they hold.
struct TriangleMesh {
  std::vector<Vec3> vertices_mm;
  std::vector<std::array<std::uint32_t, 3>> triangles;

  [[nodiscard]] bool empty() const noexcept { return triangles.empty(); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return vertices_mm.size() * sizeof(Vec3) + triangles.size() * sizeof(triangles[0]);
  }
};

}  // namespace palpate::geometry
