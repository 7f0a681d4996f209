// The nodes of one brick: distances to the patches of one sheet, blended by weights that end smoothly where
// patches end.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/shared_tiles.h"

namespace palpate::render {

class NodeBlend {
 public:
  /// Keeps references.
  NodeBlend(const std::vector<Patch>& patches, const BrickGrid& grid, const SmoothWithout& without)
      : without_(without), tiles_(patches, grid, without) {}
  /// Begins with the nodes of another cube.
  void begin(const BrickGrid::Coordinate& cube);
  /// One face of a ridge, by the numbers of its patches, in one order for all cubes: its greatest distance
  /// counts.
  void add_face(std::span<const std::uint32_t> patches);
  /// The faces added since are one ridge: of several the least distance counts.
  void end_ridge();
  /// Node values in voxels, sharpened for the spline; what no patch reaches goes on from beside it.
  [[nodiscard]] const std::array<float, kBrickCoefficients>& finish();

 private:
  /// Of every node; where it is not known, nothing.
  struct Values {
    std::array<float, kBrickCoefficients> distance, x, y, z;  ///< and its gradient
    std::array<std::uint8_t, kBrickCoefficients> known;
  };
  template <int kRow>
  static void read_rows(const Tile& tile, const std::array<int, 3>& first, Values& to);
  [[nodiscard]] float blurred_crease(const Values& a, const Values& b, std::size_t i, bool greater) const;
  void join(Values& with, const Values& other, bool greater) const;
  void fill();

  SmoothWithout without_;
  SharedTiles tiles_;
  BrickGrid::Coordinate cube_{};
  Values face_, ridge_, values_;
  int faces_ = 0, ridges_ = 0;
};

}  // namespace palpate::render
