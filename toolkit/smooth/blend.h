// The nodes of one brick: distances to the patches of one sheet, blended by weights that end smoothly where
// patches end.
#pragma once

#include <array>
#include <cstdint>

#include "toolkit/smooth/blend_rows.h"
#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/cover.h"

namespace palpate::render {

class NodeBlend {
 public:
  explicit NodeBlend(const SmoothWithout& without = {}) : without_(without) {}
  void clear();
  /// `middle`: of the brick, local mm.
  void add(const Patch& patch, const Vec3& middle, double per_voxel);
  /// What was added since is one face of a ridge: its greatest distance counts.
  void end_face();
  /// The faces ended since are one ridge: of several the least distance counts.
  void end_ridge();
  /// Node values in voxels, sharpened for the spline; what no patch reaches goes on from beside it.
  [[nodiscard]] const std::array<float, kBrickCoefficients>& finish();

 private:
  /// Of every node; where it is not known, nothing.
  struct Values {
    std::array<float, kBrickCoefficients> distance, x, y, z;  ///< and its gradient
    std::array<std::uint8_t, kBrickCoefficients> known;
  };
  void read_sums(Values& to) const;
  [[nodiscard]] float blurred_crease(const Values& a, const Values& b, std::size_t i, bool greater) const;
  void join(Values& with, const Values& other, bool greater) const;
  void fill();

  /// Without blending: where a patch counts more than those before it, it counts alone.
  void take_most(const RowPatch& patch);

  SmoothWithout without_;
  RowSums sums_;
  Values face_, ridge_, values_;
  int faces_ = 0, ridges_ = 0;
};

}  // namespace palpate::render
