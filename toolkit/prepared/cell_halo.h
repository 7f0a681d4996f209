// Gives cells their halo: copies of the points around them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include "toolkit/prepared/cell_file.h"
#include "toolkit/prepared/cell_lattice.h"
#include "toolkit/prepared/scratch_files.h"

namespace palpate::prepared {

/// Immutable once built; thread-safe.
class BoxTree {
 public:
  BoxTree() = default;
  explicit BoxTree(std::vector<geometry::Aabb> boxes) {
    levels_.push_back(std::move(boxes));
    while (levels_.back().size() > 1) {
      const std::vector<geometry::Aabb>& below = levels_.back();
      std::vector<geometry::Aabb> level((below.size() + kFan - 1) / kFan);
      for (std::size_t i = 0; i < below.size(); ++i) level[i / kFan].add(below[i]);
      levels_.push_back(std::move(level));
    }
  }

  [[nodiscard]] std::size_t size() const noexcept { return levels_.empty() ? 0 : levels_.front().size(); }
  [[nodiscard]] const geometry::Aabb& box(std::size_t i) const noexcept { return levels_.front()[i]; }
  [[nodiscard]] geometry::Aabb bounds() const noexcept {
    return size() == 0 ? geometry::Aabb() : levels_.back().front();
  }

  /// Calls visit(index) for every box that overlaps or touches `box`, in ascending order.
  template <class Visit>
  void visit_overlapping(const geometry::Aabb& box, Visit&& visit) const {
    if (size() != 0) descend(levels_.size() - 1, 0, box, visit);
  }

 private:
  static constexpr std::size_t kFan = 8;

  template <class Visit>
  void descend(std::size_t level, std::size_t node, const geometry::Aabb& box, Visit& visit) const {
    if (!levels_[level][node].overlaps(box)) return;
    if (level == 0) return visit(node);
    const std::size_t past = std::min((node + 1) * kFan, levels_[level - 1].size());
    for (std::size_t child = node * kFan; child < past; ++child) descend(level - 1, child, box, visit);
  }

  std::vector<std::vector<geometry::Aabb>> levels_;  ///< the boxes first, the root last
};

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
