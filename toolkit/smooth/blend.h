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
  /// After finish(): the faces apart, where each counts somewhere in the cube; of one layer that alone.
  /// Empty where there is one face, or what they come to is not what finish() told.
  struct Layer {
    std::array<float, kBrickCoefficients> distance;
    Joint on = Joint::kLast;
  };
  [[nodiscard]] std::span<const Layer> layers();
  /// Of one face alone, with what it goes on as; false where none of its patches reaches the cube. Two may be
  /// asked for, k = 0 and 1, after begin() and instead of the above.
  [[nodiscard]] bool alone(std::size_t k, std::span<const std::uint32_t> patches);
  [[nodiscard]] const std::array<float, kBrickCoefficients>& distance(std::size_t k) const noexcept {
    return kept_[k].distance;
  }

 private:
  /// Of every node; where it is not known, nothing.
  struct Values {
    std::array<float, kBrickCoefficients> distance, x, y, z;  ///< and its gradient
    std::array<std::uint8_t, kBrickCoefficients> known;
  };
  void read_face(std::span<const std::uint32_t> patches, Values& to);
  template <int kRow>
  static void read_rows(const Tile& tile, const std::array<int, 3>& first, Values& to);
  [[nodiscard]] float blurred_crease(const Values& a, const Values& b, std::size_t i, bool greater) const;
  void join(Values& with, const Values& other, bool greater) const;
  static void fill(Values& v);
  void keep(std::size_t k, const Values& face);
  [[nodiscard]] bool choose_layers();

  SmoothWithout without_;
  SharedTiles tiles_;
  BrickGrid::Coordinate cube_{};
  Values face_, ridge_, values_;
  int faces_ = 0, ridges_ = 0;
  /// The faces as they were added, and the body of each.
  std::array<Values, kMostLayers> kept_;
  std::array<std::array<std::uint8_t, kBrickCoefficients>, kMostLayers> known_;
  std::array<int, kMostLayers> body_{};
  std::array<bool, kMostLayers> any_{}, counts_{};
  int added_ = 0;
  std::array<Layer, kMostLayers> layers_;
};

}  // namespace palpate::render
