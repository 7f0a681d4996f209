// Which patches count in which cubes of the lattice.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// One patch that may reach one cube.
struct CubePair {
  std::uint64_t code;  ///< Morton's, of the cube
  std::uint32_t patch;
  bool through;  ///< its surface may go through the cube
};

/// Of the first `count` patches and all cubes that some surface may go through: by cube, and of one by patch.
/// The same for any number of threads. O(patches).
[[nodiscard]] std::vector<CubePair> find_pairs(const std::vector<Patch>& patches, std::size_t count,
                                               const BrickGrid& grid, int threads);

}  // namespace palpate::render
