// A plain indexed triangle mesh, as read from files, reconstructed, or used by mesh renderers.
//
// First:
//   palpate::geometry::TriangleMesh mesh;
//   mesh.vertices_mm = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}};
//   mesh.triangles = {{0, 1, 2}};  // counter-clockwise from outside
//   if (auto wrote = io::write_mesh_ply("facet.ply", mesh); !wrote) return failed(wrote.error());
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <palpate/vec.h>

namespace palpate::geometry {

/// Vertices in mm (model frame) and triangles of vertex indices, counter-clockwise from outside if the source
/// knows it. Only valid indices are guaranteed.
struct TriangleMesh {
  std::vector<Vec3> vertices_mm;
  std::vector<std::array<std::uint32_t, 3>> triangles;

  [[nodiscard]] bool empty() const noexcept { return triangles.empty(); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return vertices_mm.size() * sizeof(Vec3) + triangles.size() * sizeof(triangles[0]);
  }
};

}  // namespace palpate::geometry
