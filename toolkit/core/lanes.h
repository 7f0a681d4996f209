// Eight floats at a time, where the processor has AVX2.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

/// For functions that are chosen at run time where the processor has AVX2. No fused multiply-add: bits are
/// the same with and without.
#define PALPATE_AVX2 __attribute__((target("avx2,popcnt")))

namespace palpate {

inline constexpr std::size_t kLanes = 8;

/// Whether functions marked PALPATE_AVX2 may be called: the processor has what they need, and the environment
/// does not say PALPATE_LANES=narrow (so that one machine can show that answers are the same without). Asked
/// once in a process.
[[nodiscard]] bool wide_lanes() noexcept;

/// For each set of eight answers the positions of the yeses, a byte each, first ones first.
inline constexpr std::array<std::uint64_t, 256> kLanePositions = [] {
  std::array<std::uint64_t, 256> all{};
  for (unsigned mask = 0; mask < 256; ++mask)
    for (std::size_t k = 0, at = 0; k < kLanes; ++k)
      if ((mask >> k & 1u) != 0) all[mask] |= std::uint64_t{k} << (8 * at++);
  return all;
}();

}  // namespace palpate
