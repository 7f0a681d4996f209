// A lock-free hand-over of values from one thread to another. The writer and the reader own one slot each;
// the third holds the newest finished value and changes hands by one atomic exchange.
//
// First:
//   palpate::TripleBuffer<Vec3> hip{Vec3(Vec3::Zero())};  // one thread writes, one reads, nobody waits
//   hip.publish(Vec3(0.0, 0.0, 1.0));                     // window
//   if (hip.acquire()) target_mm = hip.front();           // servo
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace palpate {

/// The newest value wins; unread older values are overwritten. Exactly one thread writes and one reads. Both
/// calls are wait-free (one exchange, bounded where the processor has an exchange instruction) and allocate
/// nothing. The reader never sees a partial value or an older one than before. T's own memory (a vector's) is
/// allocated at construction and reused while it suffices.
template <class T>
class TripleBuffer {
 public:
  /// Every slot starts as a copy of `initial`, which the reader sees until the first publish.
  explicit TripleBuffer(const T& initial = T{}) : slots_{Slot{initial}, Slot{initial}, Slot{initial}} {}
  TripleBuffer(const TripleBuffer&) = delete;
  TripleBuffer& operator=(const TripleBuffer&) = delete;
  ~TripleBuffer() = default;

  /// Writer: the slot to fill completely. It holds an older value.
  [[nodiscard]] T& back() noexcept { return slots_[back_].value; }
  /// Writer: makes back() the newest value and gets another slot.
  void publish() noexcept {
    // Release: the reader sees what was written to the slot. Acquire: the reader is done with the slot
    // received.
    back_ = middle_.exchange(back_ | kNewValue, std::memory_order_acq_rel) & kSlotMask;
  }
  /// Writer: publishes a copy.
  void publish(const T& value) noexcept(std::is_nothrow_copy_assignable_v<T>) {
    back() = value;
    publish();
  }

  /// Reader: takes the newest value. True if it is newer than the last one.
  bool acquire() noexcept {
    // Relaxed: this is a hint; the exchange below orders memory.
    if ((middle_.load(std::memory_order_relaxed) & kNewValue) == 0) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kSlotMask;
    return true;
  }
  /// Reader: the value last taken; unchanged until the next acquire().
  [[nodiscard]] const T& front() const noexcept { return slots_[front_].value; }

 private:
  // Two 64-byte cache lines: processors fetch pairs, and the threads must not share one.
  static constexpr std::size_t kFalseSharingBytes = 128;
  static constexpr std::uint8_t kNewValue = 4;  // set by the writer, cleared by the reader's exchange
  static constexpr std::uint8_t kSlotMask = 3;  // the slot's index, 0 to 2
  static_assert(std::atomic<std::uint8_t>::is_always_lock_free);

  struct alignas(kFalseSharingBytes) Slot {
    T value;
  };

  std::array<Slot, 3> slots_;
  alignas(kFalseSharingBytes) std::uint8_t back_ = 0;  // writer only
  alignas(kFalseSharingBytes) std::atomic<std::uint8_t> middle_{1};
  alignas(kFalseSharingBytes) std::uint8_t front_ = 2;  // reader only
};

}  // namespace palpate
