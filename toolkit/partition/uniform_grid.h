// The uniform grid of section 3.1.2.3, sparse: memory follows the occupied cells, not the box's volume.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/large_pages.h"
#include "toolkit/partition/morton_order.h"
#include "toolkit/partition/partition.h"

namespace palpate::partition {

/// Integer coordinates of a cell; cells outside the cloud's box are simply not occupied.
struct Cell {
  std::int64_t x = 0, y = 0, z = 0;
};

/// Cubic cells anchored at the cloud's low corner. Points of a cell are contiguous in order(); within and
/// between cells the order is a Morton curve eight times finer, ties by cloud index, so that neighbours share
/// cache lines. Immutable after build; safe to read from many threads. Look-ups allocate nothing.
class UniformGrid {
 public:
  /// O(n). `cell_mm` > 0 is doubled where the cloud would span 2^21 cells or more (cell_mm() tells).
  [[nodiscard]] static UniformGrid build(const cloud::Cloud& cloud, double cell_mm, int threads);
  [[nodiscard]] static UniformGrid build(const cloud::Cloud& cloud, const PartitionOptions& options,
                                         int threads) {
    return build(cloud, options.cell_mm, threads);
  }

  /// The cell_mm() that build() gives. O(n).
  [[nodiscard]] static double cell_for(const cloud::Cloud& cloud, double cell_mm, int threads);

  [[nodiscard]] double cell_mm() const noexcept { return lattice_.unit_mm; }
  /// Cloud index of each place.
  [[nodiscard]] std::span<const std::uint32_t> order() const noexcept { return order_; }
  /// Frees order(), which only preparation needs.
  void drop_order() noexcept { std::vector<std::uint32_t>().swap(order_); }
  [[nodiscard]] Cell cell_of(const Vec3& local_mm) const noexcept {
    return {lattice_.coordinate(local_mm.x(), 0), lattice_.coordinate(local_mm.y(), 1),
            lattice_.coordinate(local_mm.z(), 2)};
  }
  /// The places of a cell, empty if it holds none. At most max_probes() slots are read.
  [[nodiscard]] PlaceRange find(const Cell& cell) const noexcept;
  /// The hash slot of a cell that holds points, and its places; kNoSlot where the cell holds none.
  static constexpr std::size_t kNoSlot = ~std::size_t{0};
  [[nodiscard]] std::size_t slot_of(const Cell& cell) const noexcept;
  [[nodiscard]] PlaceRange places_of(std::size_t slot) const noexcept { return slots_[slot].places; }
  [[nodiscard]] std::size_t slots() const noexcept { return slots_.size(); }
  /// The largest cell coordinate of any axis that holds points.
  [[nodiscard]] std::int64_t last_cell() const noexcept { return last_cell_; }
  [[nodiscard]] std::size_t occupied_cells() const noexcept { return occupied_; }
  [[nodiscard]] std::uint32_t max_points_per_cell() const noexcept { return max_points_; }
  [[nodiscard]] std::uint32_t max_probes() const noexcept { return max_probes_; }
  [[nodiscard]] const Lattice& lattice() const noexcept { return lattice_; }
  [[nodiscard]] LeafStatistics statistics() const noexcept;
  [[nodiscard]] std::size_t bytes() const noexcept {
    return slots_.capacity() * sizeof(Slot) + order_.capacity() * sizeof(std::uint32_t);
  }

 private:
  struct Slot {
    std::uint64_t key = kNoKey;
    PlaceRange places;
  };
  static constexpr std::uint64_t kNoKey = ~std::uint64_t{0};
  void insert(std::uint64_t key, PlaceRange places) noexcept;

  Lattice lattice_;
  std::vector<std::uint32_t> order_;
  LargeVector<Slot> slots_;  ///< open addressing, linear probing, at most half full
  int shift_ = 0;
  std::size_t occupied_ = 0;
  std::int64_t last_cell_ = 0;
  std::uint32_t max_points_ = 0;
  std::uint32_t max_probes_ = 0;
};

}  // namespace palpate::partition
