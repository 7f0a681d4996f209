// For --save-mesh: a renderer that works on a mesh can hand it out.
#pragma once

#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

/// A mesh renderer is one of these too (dynamic_cast from HapticRenderer).
class MeshHolder {
 public:
  MeshHolder() = default;
  MeshHolder(const MeshHolder&) = delete;
  MeshHolder& operator=(const MeshHolder&) = delete;
  virtual ~MeshHolder() = default;
  /// The mesh of model `model` as it is used after prepare(), model frame, or null. Lives as long as the
  /// renderer.
  [[nodiscard]] virtual const geometry::TriangleMesh* mesh(std::size_t model) const noexcept = 0;
};

}  // namespace palpate::baselines
