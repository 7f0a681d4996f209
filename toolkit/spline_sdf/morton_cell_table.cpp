#include "toolkit/spline_sdf/morton_cell_table.h"

#include <bit>

namespace palpate::render {

void MortonCellTable::build(std::span<const std::uint64_t> codes) {
  if (codes.empty()) return;
  std::size_t blocks = 1;
  for (std::size_t i = 1; i < codes.size(); ++i) blocks += codes[i] >> kBits != codes[i - 1] >> kBits;
  const std::size_t size = std::bit_ceil(blocks * 2);
  slots_.assign(size, Slot{});
  mask_ = size - 1;
  shift_ = 64 - std::countr_zero(size);
  for (std::size_t i = 0; i < codes.size();) {
    const std::uint64_t block = codes[i] >> kBits;
    std::size_t at = slot(block);
    while (slots_[at].cells != 0) at = (at + 1) & mask_;
    Slot& here = slots_[at];
    here.block = block;
    here.first = static_cast<std::uint32_t>(i);
    for (; i < codes.size() && codes[i] >> kBits == block; ++i)
      here.cells |= std::uint64_t{1} << (codes[i] & (kCells - 1));
  }
}

std::vector<std::uint64_t> MortonCellTable::codes(std::size_t cells) const {
  std::vector<std::uint64_t> out(cells, 0);
  for (const Slot& slot : slots_) {
    std::size_t at = slot.first;
    for (std::uint64_t left = slot.cells; left != 0; left &= left - 1)
      out[at++] = slot.block << kBits | static_cast<std::uint64_t>(std::countr_zero(left));
  }
  return out;
}

}  // namespace palpate::render
