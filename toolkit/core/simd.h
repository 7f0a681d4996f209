// Eight-float vectors for processors with AVX2.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

/// Marks functions chosen at run time for AVX2. Without fused multiply-add, so bits are the same as without.
#define PALPATE_AVX2 __attribute__((target("avx2,popcnt")))

namespace palpate {

inline constexpr std::size_t kLanes = 8;

/// True if functions marked PALPATE_AVX2 may be called: the processor supports them and PALPATE_LANES is not
/// "narrow" (for comparing both on one machine). Evaluated once per process.
[[nodiscard]] bool has_avx2() noexcept;

/// For each set of eight bits the positions of the ones, a byte each, ascending.
inline constexpr std::array<std::uint64_t, 256> kLanePositions = [] {
  std::array<std::uint64_t, 256> all{};
  for (unsigned mask = 0; mask < 256; ++mask)
    for (std::size_t k = 0, at = 0; k < kLanes; ++k)
      if ((mask >> k & 1u) != 0) all[mask] |= std::uint64_t{k} << (8 * at++);
  return all;
}();

}  // namespace palpate
