// A reconstruction or a file's faces held in OpenMesh and checked: what a person should know before trusting
// it.
#pragma once

#include <cstddef>
#include <string>

#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

struct MeshReport {
  std::size_t vertices = 0;
  std::size_t faces = 0;
  std::size_t refused_faces =
      0;  ///< that a half-edge mesh cannot hold: an edge of three or more, or repeated
  std::size_t boundary_edges = 0;
  std::size_t boundary_loops = 0;
  std::size_t components = 0;  ///< connected parts with faces
  std::size_t isolated_vertices = 0;
  [[nodiscard]] bool closed() const noexcept { return boundary_edges == 0 && refused_faces == 0; }
  /// One line.
  [[nodiscard]] std::string text() const;
};

/// O(n). Refused faces are counted and left out of the other numbers.
[[nodiscard]] MeshReport check_mesh(const geometry::TriangleMesh& mesh);

}  // namespace palpate::baselines
