// Rows of a brick's nodes, and what a patch adds to them: eight nodes at once where the machine can, with the
// same bits where it cannot.
#pragma once

#include <array>
#include <cstddef>

#include "toolkit/smooth/brick_grid.h"

namespace palpate::render {

inline constexpr int kNodeRows = kBrickNodes * kBrickNodes;
/// A row along z; the last one is no node.
inline constexpr int kRowLanes = 8;

/// A patch in a brick's voxels, from its middle.
struct RowPatch {
  std::array<float, 3> at, u, v, n;
  float uu, uv, vv, trust, support, per_support_sq, sharpen, bend, row_share;
};

/// Of each row.
using RowSum = std::array<float, std::size_t{kNodeRows} * std::size_t{kRowLanes}>;
struct alignas(32) RowSums {
  RowSum weight, distance, x, y, z;
};

/// Adds one patch to the rows that it reaches.
void add_to_rows(const RowPatch& patch, RowSums& sums);

}  // namespace palpate::render
