// Copies of the points around each cell, and the bytes of cells.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include "toolkit/prepared/box_tree.h"
#include "toolkit/prepared/cell_file.h"
#include "toolkit/prepared/point_scratch.h"

namespace palpate::prepared {

/// Points of the cells that a halo is searched in. Beyond, the halo is as wide as the cells leave: a few
/// points before a dense scan do not read all of it.
inline constexpr std::uint64_t kMostCandidates = 64 * std::uint64_t{kMostCellPoints};

/// Gives every cell its halo and its bytes, reading sorted points cell by cell. Results do not depend on the
/// order of calls, on threads or on memory. Not thread-safe.
class HaloMaker {
 public:
  /// `cells` and `scratch` outlive this.
  HaloMaker(const std::vector<CellEntry>& cells, const CellLattice& lattice, const PointScratch& scratch,
            std::size_t memory_bytes, int threads);

  struct MadeCell {
    CellEntry entry;
    std::vector<std::byte> bytes;
  };
  /// Completes the cells from `first`: as many as make a good piece of work, at least one. Offsets are left
  /// at 0.
  [[nodiscard]] Result<std::vector<MadeCell>> make_from(std::size_t first);

 private:
  /// A block of a cell's points is passed by where its box is too far.
  static constexpr std::size_t kBlock = 64;
  struct LoadedCell {
    std::vector<LatticePoint> points;
    std::vector<geometry::Aabb> blocks;
  };
  struct Surrounding {
    std::vector<std::uint32_t> cells;  ///< ascending
    double distance = 0.0;             ///< in cubes
    std::uint64_t points = 0;
  };
  [[nodiscard]] Surrounding surrounding(std::size_t cell) const;
  [[nodiscard]] Status load(const std::vector<std::uint32_t>& needed);
  [[nodiscard]] Result<LoadedCell> read(std::uint32_t cell) const;
  [[nodiscard]] MadeCell make(std::size_t cell, const Surrounding& around) const;
  [[nodiscard]] const LoadedCell& loaded(std::size_t cell) const {
    return *loaded_.at(static_cast<std::uint32_t>(cell));
  }

  const std::vector<CellEntry>* cells_;
  CellLattice lattice_;
  const PointScratch* scratch_;
  std::uint64_t most_loaded_;  ///< points
  int threads_;
  BoxTree boxes_;                      ///< in cubes
  std::vector<std::uint64_t> firsts_;  ///< number of each cell's first point
  std::unordered_map<std::uint32_t, std::unique_ptr<LoadedCell>> loaded_;
  std::uint64_t loaded_points_ = 0;
};

}  // namespace palpate::prepared
