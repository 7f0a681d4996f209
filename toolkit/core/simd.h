// Vector types, and AVX2's mark and choice at run time.
//
// Intrinsics stay in the kernels (search/knn_kernels.cpp, local_delaunay/*_avx2.cpp,
// local_delaunay/block_knn.cpp) and in the headers of local_delaunay that a frame reads. Elementwise
// arithmetic on the types below rounds alike on every target.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

/// Marks functions chosen at run time for AVX2. Without fused multiply-add, so bits are the same as without.
#define PALPATE_AVX2 __attribute__((target("avx2,popcnt")))

namespace palpate {

// Elementwise vectors, 16 or 32 bytes. Without AVX a vector of 32 bytes is two of 16, less aligned, and may
// not be passed by value: the calling convention differs between targets.
using Float4 = float __attribute__((vector_size(16)));
using Float8 = float __attribute__((vector_size(32)));
using Double2 = double __attribute__((vector_size(16)));
using Double4 = double __attribute__((vector_size(32)));
using Int16x8 = std::int16_t __attribute__((vector_size(16)));
using Int32x4 = std::int32_t __attribute__((vector_size(16)));
using Int32x8 = std::int32_t __attribute__((vector_size(32)));
using Int64x4 = std::int64_t __attribute__((vector_size(32)));

/// Floats in one vector of AVX2.
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
