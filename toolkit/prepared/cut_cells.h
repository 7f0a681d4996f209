// Sorts the points of a chunk along the Morton curve and cuts them into cells: the largest nodes of the
// binary tree with few enough points and a fine enough quantum. The tree is the lattice's, so the cells do
// not depend on the chunks.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/prepared/cell_file.h"
#include "toolkit/prepared/cell_lattice.h"
#include "toolkit/prepared/count_tree.h"

namespace palpate::prepared {

struct CutRules {
  CellLattice lattice;
  double quantum_mm = 0.0;  ///< at most
  double halo_spacings = 0.0;
};

/// Bytes that sort_points() and the points need per point: the points, and two copies with their codes.
inline constexpr std::size_t kSortBytesPerPoint =
    sizeof(PackedPoint) + 2 * (sizeof(PackedPoint) + sizeof(std::uint64_t));

/// Sorts by Morton key. O(n) unless most points share the upper half of their key. Parallel.
void sort_points(std::vector<PackedPoint>& points, int threads);

/// The least power of two, in cubes, in which a coordinate from `low` to `high` counts at most kMostSteps.
[[nodiscard]] std::uint8_t quantum_shift(const LatticePoint& low, const LatticePoint& high) noexcept;

/// Cuts sorted points at the nodes that hold them, in order, which together have as many points. Offsets,
/// halos and quanta of the entries are not yet known. Parallel.
[[nodiscard]] std::vector<CellEntry> cut_cells(std::span<const PackedPoint> sorted,
                                               std::span<const CountedNode> nodes, const CutRules& rules,
                                               int threads);

}  // namespace palpate::prepared
