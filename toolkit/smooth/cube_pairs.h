// Which patches count in which cubes of the lattice.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// One patch that may reach one cube.
struct CubePatch {
  std::uint32_t patch : 31;
  std::uint32_t through : 1;  ///< its surface may go through the cube
};

/// The patches of each cube that some surface may go through, ascending.
struct CubePatches {
  std::vector<std::uint64_t> codes;  ///< Morton's, of the cubes, ascending
  std::vector<std::uint32_t> begin;  ///< of each cube its first in `all`, and behind the last one
  std::vector<CubePatch> all;
  [[nodiscard]] std::span<const CubePatch> of(std::size_t cube) const {
    return std::span(all).subspan(begin[cube], begin[cube + 1] - begin[cube]);
  }
};

/// Of the first `count` patches. The same for any number of threads. O(patches).
[[nodiscard]] CubePatches find_pairs(const std::vector<Patch>& patches, std::size_t count,
                                     const BrickGrid& grid, int threads);

}  // namespace palpate::render
