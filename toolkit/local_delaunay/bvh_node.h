// Bounding boxes in float: single, and eight per node.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include <palpate/geometry.h>
#include <palpate/vec.h>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace palpate::local_delaunay {

/// Children of a node, tested in parallel lanes.
inline constexpr std::uint32_t kBvhWidth = 8;

/// A float box that contains a double box.
struct FloatBox {
  std::array<float, 3> low, high;

  /// For any box; branch-free.
  static FloatBox around(const geometry::Aabb& box) noexcept {
    FloatBox out;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      out.low[axis] = outward(box.low_mm[static_cast<int>(axis)], -1.0f);
      out.high[axis] = outward(box.high_mm[static_cast<int>(axis)], 1.0f);
    }
    return out;
  }

 private:
  /// Rounds, then moves outward by more than the rounding.
  static float outward(double x, float way) noexcept {
    constexpr double kMost = 1e38;  // a float, far beyond any box of a tree
    constexpr float kStep = 1.2e-7f, kLeast = std::numeric_limits<float>::min();
    const auto rounded = static_cast<float>(std::min(std::max(x, -kMost), kMost));
    return rounded + way * (std::abs(rounded) * kStep + kLeast);
  }
};

/// Eight boxes, coordinate by coordinate. An empty one has low above high.
struct alignas(32) BvhNode {
  std::array<std::array<float, kBvhWidth>, 3> low, high;

  static BvhNode empty() noexcept {
    BvhNode node;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      node.low[axis].fill(std::numeric_limits<float>::infinity());
      node.high[axis].fill(-std::numeric_limits<float>::infinity());
    }
    return node;
  }
  /// Bit k: box k meets `box`.
  [[nodiscard]] unsigned meets(const FloatBox& box) const noexcept {
#if defined(__SSE2__)
    return half_meets(box, 0) | half_meets(box, 4) << 4;
#else
    unsigned mask = 0;
    for (std::uint32_t k = 0; k < kBvhWidth; ++k)
      mask |= static_cast<unsigned>(low[0][k] <= box.high[0] && high[0][k] >= box.low[0] &&
                                    low[1][k] <= box.high[1] && high[1][k] >= box.low[1] &&
                                    low[2][k] <= box.high[2] && high[2][k] >= box.low[2])
              << k;
    return mask;
#endif
  }
  /// The squared distance of each box to `box`, within six roundings. Infinite for an empty one.
  [[nodiscard]] std::array<float, kBvhWidth> distance_sq(const FloatBox& box) const noexcept {
    std::array<float, kBvhWidth> sum{};
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (std::size_t k = 0; k < kBvhWidth; ++k) {
        const float before = low[axis][k] - box.high[axis], behind = box.low[axis] - high[axis][k];
        const float gap = std::max(std::max(before, behind), 0.0f);
        sum[k] += gap * gap;
      }
    return sum;
  }

 private:
#if defined(__SSE2__)
  [[nodiscard]] unsigned half_meets(const FloatBox& box, std::size_t first) const noexcept {
    __m128 all = _mm_castsi128_ps(_mm_set1_epi32(-1));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      all = _mm_and_ps(all, _mm_cmple_ps(_mm_load_ps(&low[axis][first]), _mm_set1_ps(box.high[axis])));
      all = _mm_and_ps(all, _mm_cmpge_ps(_mm_load_ps(&high[axis][first]), _mm_set1_ps(box.low[axis])));
    }
    return static_cast<unsigned>(_mm_movemask_ps(all));
  }
#endif
};

}  // namespace palpate::local_delaunay
