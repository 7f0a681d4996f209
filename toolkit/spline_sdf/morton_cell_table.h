// A hash table of cells by Morton code in blocks of 4 x 4 x 4. A surface block has about sixteen cells, so
// the table of blocks fits in the cache.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace palpate::render {

/// Fibonacci hashing, 2^64 over the golden section, odd: spreads the upper bits.
[[nodiscard]] constexpr std::uint64_t fibonacci_hash(std::uint64_t code) noexcept {
  return code * 0x9e3779b97f4a7c15ull;
}

/// Maps a cell's Morton code to its number. Immutable once built.
class MortonCellTable {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffu;
  /// `codes` ascend; a cell's number is its index among them. O(cells).
  void build(std::span<const std::uint64_t> codes);
  [[nodiscard]] std::uint32_t find(std::uint64_t code) const noexcept {
    if (slots_.empty()) return kNone;
    const std::uint64_t block = code >> kBits;
    for (std::size_t i = slot(block);; i = (i + 1) & mask_) {
      const Slot& here = slots_[i];
      if (here.block != block && here.cells != 0) continue;
      const std::uint64_t bit = std::uint64_t{1} << (code & (kCells - 1));
      return (here.cells & bit) != 0 ? here.first + count(here.cells & (bit - 1)) : kNone;
    }
  }
  /// The codes of all cells. O(cells).
  [[nodiscard]] std::vector<std::uint64_t> codes(std::size_t cells) const;
  [[nodiscard]] std::size_t bytes() const noexcept { return slots_.capacity() * sizeof(Slot); }

 private:
  static constexpr int kBits = 6;
  static constexpr std::uint64_t kCells = std::uint64_t{1} << kBits;
  struct Slot {
    std::uint64_t block = 0;
    std::uint64_t cells = 0;  ///< a bit per cell; 0: no block
    std::uint32_t first = 0;  ///< number of the lowest
  };
  /// Portable population count: no other code here requires POPCNT.
  [[nodiscard]] static std::uint32_t count(std::uint64_t x) noexcept {
    x -= x >> 1 & 0x5555555555555555u;
    x = (x & 0x3333333333333333u) + (x >> 2 & 0x3333333333333333u);
    x = (x + (x >> 4)) & 0x0f0f0f0f0f0f0f0fu;
    return static_cast<std::uint32_t>(x * 0x0101010101010101u >> 56);
  }
  [[nodiscard]] std::size_t slot(std::uint64_t block) const noexcept {
    return static_cast<std::size_t>(fibonacci_hash(block) >> shift_) & mask_;
  }
  std::vector<Slot> slots_;
  std::size_t mask_ = 0;
  int shift_ = 0;
};

}  // namespace palpate::render
