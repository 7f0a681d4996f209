// Hands values from one thread to another without a lock: three slots, of which the writer owns one, the
// reader one, and the third, the newest finished value, changes hands by one atomic exchange.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace palpate {

/// Newest value wins; what the reader did not fetch in time is overwritten. Exactly one thread may write and
/// one may read. Both calls are wait-free (one exchange; a bounded number of steps where the processor has an
/// exchange instruction), allocate nothing and never wait for the other side. The reader never sees a value
/// half written, nor one older than the last it saw. T's own memory (a vector's) is allocated when the
/// hand-over is made and is used again as long as a value needs no more of it.
template <class T>
class Handover {
 public:
  /// Every slot starts as a copy of `initial`, which the reader sees until something is published.
  explicit Handover(const T& initial = T{}) : slots_{Slot{initial}, Slot{initial}, Slot{initial}} {}
  Handover(const Handover&) = delete;
  Handover& operator=(const Handover&) = delete;
  ~Handover() = default;

  /// Writer: the slot to fill. It holds a value published earlier, or the initial one: fill all of it.
  [[nodiscard]] T& back() noexcept { return slots_[back_].value; }
  /// Writer: makes back() the newest value; back() is then another slot.
  void publish() noexcept {
    // Release: what was written to the slot is seen by who takes it. Acquire: the reader is done with the one
    // we get.
    back_ = middle_.exchange(back_ | kFresh, std::memory_order_acq_rel) & kSlotMask;
  }
  /// Writer: publishes a copy.
  void publish(const T& value) noexcept(std::is_nothrow_copy_assignable_v<T>) {
    back() = value;
    publish();
  }

  /// Reader: takes the newest value. True where it is newer than the last one taken.
  bool acquire() noexcept {
    // Relaxed: only a hint, the exchange below orders the memory.
    if ((middle_.load(std::memory_order_relaxed) & kFresh) == 0) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kSlotMask;
    return true;
  }
  /// Reader: the value last taken; it stays as it is until the next acquire().
  [[nodiscard]] const T& front() const noexcept { return slots_[front_].value; }

 private:
  // Two lines of 64 bytes: processors fetch them in pairs, and the two threads must not share one.
  static constexpr std::size_t kApart = 128;
  static constexpr std::uint8_t kFresh = 4;     // set by the writer, cleared by the reader's exchange
  static constexpr std::uint8_t kSlotMask = 3;  // the slot's index, 0 to 2
  static_assert(std::atomic<std::uint8_t>::is_always_lock_free);

  struct alignas(kApart) Slot {
    T value;
  };

  std::array<Slot, 3> slots_;
  alignas(kApart) std::uint8_t back_ = 0;  // the writer's alone
  alignas(kApart) std::atomic<std::uint8_t> middle_{1};
  alignas(kApart) std::uint8_t front_ = 2;  // the reader's alone
};

}  // namespace palpate
