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
  /// The mesh of model `model` as it is used after prepare(), model frame, or null. The file's own faces as
  /// they came; any other is put together when it is asked for first, in the order in which it is walked,
  /// since no frame needs it in this form. It lives until the next prepare(), or as long as the renderer. Not
  /// for several threads at once; not for a frame.
  [[nodiscard]] virtual const geometry::TriangleMesh* mesh(std::size_t model) const = 0;
};

}  // namespace palpate::baselines
