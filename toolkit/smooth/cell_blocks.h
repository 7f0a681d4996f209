// Cells by their Morton codes, 4 x 4 x 4 of them a block: of a surface's cells a block has some sixteen, and
// a table of blocks stays in the cache where one of cells does not.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace palpate::render {

/// Fibonacci hashing, 2^64 over the golden section, odd: the upper bits are spread.
[[nodiscard]] constexpr std::uint64_t spread_code(std::uint64_t code) noexcept {
  return code * 0x9e3779b97f4a7c15ull;
}

/// From a cell's Morton code to its number. Immutable once built.
class CellBlocks {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffu;
  /// Codes ascend; a cell's number is its place among them. O(cells).
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
  /// Of every cell. O(cells).
  [[nodiscard]] std::vector<std::uint64_t> codes(std::size_t cells) const;
  [[nodiscard]] std::size_t bytes() const noexcept { return slots_.capacity() * sizeof(Slot); }

 private:
  static constexpr int kBits = 6;
  static constexpr std::uint64_t kCells = std::uint64_t{1} << kBits;
  struct Slot {
    std::uint64_t block = 0;
    std::uint64_t cells = 0;  ///< a bit for each that there is; 0: no block
    std::uint32_t first = 0;  ///< number of the lowest
  };
  /// Bits of a word, in a few steps: processors that count them in one are asked for nowhere else here.
  [[nodiscard]] static std::uint32_t count(std::uint64_t x) noexcept {
    x -= x >> 1 & 0x5555555555555555u;
    x = (x & 0x3333333333333333u) + (x >> 2 & 0x3333333333333333u);
    x = (x + (x >> 4)) & 0x0f0f0f0f0f0f0f0fu;
    return static_cast<std::uint32_t>(x * 0x0101010101010101u >> 56);
  }
  [[nodiscard]] std::size_t slot(std::uint64_t block) const noexcept {
    return static_cast<std::size_t>(spread_code(block) >> shift_) & mask_;
  }
  std::vector<Slot> slots_;
  std::size_t mask_ = 0;
  int shift_ = 0;
};

}  // namespace palpate::render
