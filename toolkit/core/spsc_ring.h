// A bounded lock-free queue from one thread to another. Unlike a TripleBuffer it loses nothing: a full ring
// refuses.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <type_traits>

namespace palpate {

/// Exactly one thread pushes and one pops. Both are wait-free and allocate nothing. `kSize`: a power of two.
template <class T, std::size_t kSize>
class SpscRing {
  static_assert(std::is_trivially_copyable_v<T> && kSize > 0 && (kSize & (kSize - 1)) == 0);

 public:
  /// False if the ring is full.
  [[nodiscard]] bool push(const T& value) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    // Acquire: the reader is done with the place that is written next.
    if (tail - head_.load(std::memory_order_acquire) == kSize) return false;
    ring_[tail & (kSize - 1)] = value;
    // Release: the reader sees the value, and all that was written before it was pushed.
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }
  /// The pushing thread: whether push() would refuse.
  [[nodiscard]] bool full() const noexcept {
    return tail_.load(std::memory_order_relaxed) - head_.load(std::memory_order_acquire) == kSize;
  }
  /// False if the ring is empty.
  [[nodiscard]] bool pop(T& value) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) return false;
    value = ring_[head & (kSize - 1)];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

 private:
  // Two 64-byte cache lines: processors fetch pairs, and the threads must not share one.
  static constexpr std::size_t kApart = 128;
  std::array<T, kSize> ring_{};
  alignas(kApart) std::atomic<std::size_t> head_{0};
  alignas(kApart) std::atomic<std::size_t> tail_{0};
};

}  // namespace palpate
