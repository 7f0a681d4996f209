// The nodes of one brick: distances to the patches of one sheet, blended by weights that end smoothly where
// patches end.
#pragma once

#include <array>
#include <cstdint>

#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// Half a row of nodes along z; the last lane of the second half is no node.
inline constexpr int kRowHalves = 2;
inline constexpr int kNodeRows = kBrickNodes * kBrickNodes;

class NodeBlend {
 public:
  void clear();
  /// `middle`: of the brick, local mm.
  void add(const Patch& patch, const Vec3& middle, double per_voxel);
  /// Node values in voxels, sharpened for the spline; what no patch reaches goes on from beside it.
  [[nodiscard]] const std::array<float, kBrickCoefficients>& finish();

 private:
  struct Local;
  void add_row(const Local& patch, float dx, float dy, std::size_t row);
  int read_sums();
  void fill(int missing);

  struct Sums {
    std::array<Lanes, std::size_t{kNodeRows} * std::size_t{kRowHalves}> weight, distance, x, y, z;
  };
  Sums sums_;
  std::array<float, kBrickCoefficients> distance_, x_, y_, z_;  ///< and its gradient
  std::array<std::uint8_t, kBrickCoefficients> known_;
};

}  // namespace palpate::render
