// Divides points into regions that fit in memory, and cells.
//
// A CountTree counts points in a grid of up to 128 cubes per axis over the lattice, whose crowded cubes are
// divided again by further passes. Each region's points are sorted along the Morton curve and cut into cells:
// the largest nodes of the binary tree with few enough points and a fine enough quantum. The tree is the
// lattice's, so the cells do not depend on the chunks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/result.h>
#include "toolkit/prepared/cell_file.h"
#include "toolkit/prepared/cell_lattice.h"

namespace palpate::prepared {

/// A node of the binary tree over Morton keys.
struct CountedNode {
  CellKey key;
  int depth = 0;
  std::uint64_t points = 0;
};

/// Consecutive nodes whose points are kept together. Only a region of points with one key is larger than
/// asked.
struct Region {
  std::uint64_t first = 0;  ///< number of its first point in Morton order
  std::uint64_t points = 0;
  std::uint32_t first_node = 0, past_node = 0;
};

/// Not thread-safe; find() and region() are.
class CountTree {
 public:
  /// A cube of a grid.
  struct Place {
    std::uint32_t grid = 0;
    std::uint32_t slot = 0;
  };

  /// The grid has as many cubes as points are expected, within limits; nothing else depends on the number.
  explicit CountTree(std::uint64_t expected_points);
  [[nodiscard]] Place find(const LatticePoint& p) const noexcept {
    return grids_.size() == 1 ? Place{0, static_cast<std::uint32_t>(upper_code(p) >> root_shift_)}
                              : find_deep(p);
  }
  /// Counts a point; grids that were counted in an earlier pass stay as they are.
  void count(const Place& at) noexcept {
    if (at.grid >= first_uncounted_) ++grids_[at.grid].counts[at.slot];
  }
  /// Divides the cubes with more than `most` points. True: count all points again.
  [[nodiscard]] bool divide_crowded(std::uint64_t most);
  /// Makes nodes and regions. False: a pass counted other points than the one before.
  [[nodiscard]] bool make_regions(std::uint64_t most);

  [[nodiscard]] const std::vector<CountedNode>& nodes() const noexcept { return nodes_; }
  [[nodiscard]] const std::vector<Region>& regions() const noexcept { return regions_; }
  /// Region of a place with points; kNone where none was counted.
  [[nodiscard]] std::uint32_t region(const Place& at) const noexcept {
    return grids_[at.grid].regions[at.slot];
  }
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;

 private:
  static constexpr int kMostRootBits = 21;  ///< 128 cubes per axis: 16 MB of counts
  static constexpr int kLeastRootBits = 6;
  static constexpr int kDivideBits =
      14;  ///< 128 KB of counts for a crowded cube; three end where a code does
  struct Grid {
    CellKey key;
    int depth = 0, bits = 0;
    std::vector<std::uint64_t> counts;
    std::vector<std::uint32_t> children;  ///< grid of each crowded cube; 0: not divided; empty: none is
    std::vector<std::uint32_t> regions;   ///< of each cube, once made
  };
  [[nodiscard]] Place find_deep(const LatticePoint& p) const noexcept;
  [[nodiscard]] static Grid make_grid(const CellKey& key, int depth);
  [[nodiscard]] static CellKey key_below(const Grid& grid, std::uint32_t slot) noexcept;
  /// Emits the largest nodes that a cell may hold, or that no count divides.
  bool emit_nodes(std::uint32_t grid, const std::vector<std::uint64_t>& before, std::uint32_t slot, int bits);
  bool emit_grid(std::uint32_t grid, std::uint64_t expected);

  std::vector<Grid> grids_;
  int root_shift_ = 0;
  std::uint32_t first_uncounted_ = 0;
  std::vector<CountedNode> nodes_;
  std::vector<Region> regions_;
};

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
