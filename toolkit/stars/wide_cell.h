// Internal to stars: four FlatCells cut at a time, each by its own neighbours, where the processor has AVX2.
// A cut waits for the one before it; those of other cells do not.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "toolkit/core/vec.h"
#include "toolkit/stars/flat_cell.h"
#include "toolkit/stars/places.h"

namespace palpate::stars {

/// A point and how its nearest are laid out, see FlatNeighbours: with their distances in space.
struct FlatFrame {
  Vec3 at = Vec3::Zero();
  Vec3 normal = Vec3::Zero(), e = Vec3::Zero(), f = Vec3::Zero();
  double weight = 0.0;
  double steepest_sq = 1.0;  ///< squared: a neighbour that rises more is left out
  const std::uint32_t* near = nullptr;
  std::size_t count = 0;  ///< of `near`, sixteen at most
};

/// Cuts each cell by its neighbours in turn, to the bit as FlatNeighbours::cut() does where it leaves nobody
/// out. Of each by how many: fewer than there are where a cell gets more corners than eight, and the rest are
/// the caller's. None where the processor has no AVX2.
std::array<std::size_t, 4> cut_four(const Placed* point, const std::array<FlatFrame, 4>& frames,
                                    std::array<FlatCell, 4>& cells) noexcept;

}  // namespace palpate::stars
