// A force in one word, so that it goes from the servo's thread to another one whole, without a lock, and any
// thread can replace it by zero.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>

#include "toolkit/core/vec.h"

namespace palpate::device {

/// Steps of 20 uN up to 20.9 N along each axis: finer than any device's motors, stronger than those here. A
/// force beyond that is scaled as a whole: the direction stays. Any threads; wait-free.
class PackedForce {
 public:
  void store(const Vec3& force_n) noexcept { word_.store(packed(force_n), std::memory_order_release); }
  void zero() noexcept { word_.store(0, std::memory_order_release); }
  [[nodiscard]] Vec3 load() const noexcept {
    const std::uint64_t word = word_.load(std::memory_order_acquire);
    return Vec3{part(word, 0), part(word, 1), part(word, 2)};
  }

  static constexpr double kStepN = 20e-6;

 private:
  static constexpr int kBits = 21;  // three of them in 64
  static constexpr std::int64_t kMost = (std::int64_t{1} << (kBits - 1)) - 1;
  static constexpr std::uint64_t kMask = (std::uint64_t{1} << kBits) - 1;

  [[nodiscard]] static std::uint64_t packed(const Vec3& force_n) noexcept {
    Vec3 steps = force_n / kStepN;
    if (!is_finite(steps)) return 0;  // the governor sees to it that this never happens
    const double largest = steps.cwiseAbs().maxCoeff(), most = static_cast<double>(kMost);
    if (largest > most) steps *= most / largest;
    std::uint64_t word = 0;
    for (int axis = 0; axis < 3; ++axis)
      word |= (static_cast<std::uint64_t>(std::llround(std::clamp(steps[axis], -most, most))) & kMask)
              << (kBits * axis);
    return word;
  }
  [[nodiscard]] static double part(std::uint64_t word, int axis) noexcept {
    const auto bits = static_cast<std::int64_t>((word >> (kBits * axis)) & kMask);
    return kStepN * static_cast<double>(bits > kMost ? bits - (kMost + 1) * 2 : bits);
  }

  std::atomic<std::uint64_t> word_{0};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
};

}  // namespace palpate::device
