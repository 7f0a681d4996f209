// Access to a mesh renderer's mesh, for --save-mesh.
#pragma once

#include <palpate/triangle_mesh.h>

namespace palpate::baselines {

/// Implemented by mesh renderers (dynamic_cast from HapticRenderer).
class MeshHolder {
 public:
  MeshHolder() = default;
  MeshHolder(const MeshHolder&) = delete;
  MeshHolder& operator=(const MeshHolder&) = delete;
  virtual ~MeshHolder() = default;
  /// The mesh of model `model` as used after prepare(), model frame, or null. The file's own faces are
  /// returned unchanged; others are assembled on first request, in walking order. Valid until the next
  /// prepare() or the renderer's end. Single-threaded; not for frames.
  [[nodiscard]] virtual const geometry::TriangleMesh* mesh(std::size_t model) const = 0;
};

}  // namespace palpate::baselines
