// The sparse uniform grid of section 3.1.2.3: memory follows occupied cells, not volume.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include "toolkit/core/large_pages.h"
#include "toolkit/search/morton_order.h"
#include "toolkit/search/partition.h"

namespace palpate::search {

/// Integer cell coordinates; cells outside the cloud's box are empty.
struct Cell {
  std::int64_t x = 0, y = 0, z = 0;
};

/// Cubic cells from the cloud's low corner. A cell's points are contiguous in order(), a Morton curve eight
/// times finer with ties by cloud index, so neighbours share cache lines. Immutable after build; thread-safe
/// to read. Look-ups allocate nothing.
class UniformGrid {
 public:
  /// O(n). `cell_mm` > 0 is doubled until the cloud spans under 2^21 cells (see cell_mm()).
  [[nodiscard]] static UniformGrid build(const cloud::Cloud& cloud, double cell_mm, int threads);
  [[nodiscard]] static UniformGrid build(const cloud::Cloud& cloud, const PartitionOptions& options,
                                         int threads) {
    return build(cloud, options.cell_mm, threads);
  }

  /// The cell_mm() that build() will choose. O(n).
  [[nodiscard]] static double cell_for(const cloud::Cloud& cloud, double cell_mm, int threads);

  [[nodiscard]] double cell_mm() const noexcept { return lattice_.unit_mm; }
  /// Cloud index per place.
  [[nodiscard]] std::span<const std::uint32_t> order() const noexcept { return order_; }
  /// Frees order(), which only preparation needs.
  void drop_order() noexcept { std::vector<std::uint32_t>().swap(order_); }
  [[nodiscard]] Cell cell_of(const Vec3& local_mm) const noexcept {
    return {lattice_.coordinate(local_mm.x(), 0), lattice_.coordinate(local_mm.y(), 1),
            lattice_.coordinate(local_mm.z(), 2)};
  }
  /// The places of a cell; empty if none.
  [[nodiscard]] IndexRange find(const Cell& cell) const noexcept;
  /// The hash slot of an occupied cell, and its places; kNoSlot if empty.
  static constexpr std::size_t kNoSlot = ~std::size_t{0};
  [[nodiscard]] std::size_t slot_of(const Cell& cell) const noexcept;
  [[nodiscard]] IndexRange places_of(std::size_t slot) const noexcept { return slots_[slot].places; }
  [[nodiscard]] std::size_t slots() const noexcept { return slots_.size(); }
  /// The largest occupied cell coordinate on any axis.
  [[nodiscard]] std::int64_t last_cell() const noexcept { return last_cell_; }
  [[nodiscard]] std::size_t occupied_cells() const noexcept { return occupied_; }
  [[nodiscard]] std::uint32_t max_points_per_cell() const noexcept { return max_points_; }
  [[nodiscard]] const Lattice& lattice() const noexcept { return lattice_; }
  [[nodiscard]] LeafStatistics statistics() const noexcept;
  [[nodiscard]] std::size_t bytes() const noexcept {
    return slots_.capacity() * sizeof(Slot) + order_.capacity() * sizeof(std::uint32_t);
  }

 private:
  struct Slot {
    std::uint64_t key = kNoKey;
    IndexRange places;
  };
  static constexpr std::uint64_t kNoKey = ~std::uint64_t{0};
  void insert(std::uint64_t key, IndexRange places) noexcept;

  Lattice lattice_;
  std::vector<std::uint32_t> order_;
  LargePageVector<Slot> slots_;  ///< open addressing, linear probing, at most half full
  int shift_ = 0;
  std::size_t occupied_ = 0;
  std::int64_t last_cell_ = 0;
  std::uint32_t max_points_ = 0;
};

}  // namespace palpate::search
