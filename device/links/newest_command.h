// The newest command on its way to a device: many threads put, one takes. A force that was not yet sent when
// the next one comes is of no use to anybody.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>

namespace palpate::device {

/// One command's bytes.
struct CommandBytes {
  static constexpr std::size_t kMost = 65;  ///< a HID report of 64 bytes with its id
  std::array<std::uint8_t, kMost> bytes{};
  std::size_t size = 0;
  [[nodiscard]] std::span<const std::uint8_t> span() const noexcept { return {bytes.data(), size}; }
};

/// Lock-free. put() by any threads, take() by one at a time.
class NewestCommand {
 public:
  /// True: it is there to be taken, unless a newer one comes first. False: too long, empty, or kSlots - 2
  /// threads are putting at this very moment. At most kSlots steps.
  bool put(std::span<const std::uint8_t> bytes) noexcept;
  /// The newest one, once. False: there is none since the last.
  bool take(CommandBytes& into) noexcept;
  [[nodiscard]] bool empty() const noexcept { return newest_.load(std::memory_order_seq_cst) < 0; }
  /// Commands that a newer one replaced before they were taken.
  [[nodiscard]] std::uint64_t replaced() const noexcept { return replaced_.load(std::memory_order_relaxed); }

 private:
  // One is the newest, one is being copied by the taker, each further one may be being written: servo,
  // watchdog, the stop of the program, and three to spare.
  static constexpr int kSlots = 8;
  struct Slot {
    std::atomic<bool> held{false};
    CommandBytes command;
  };
  std::array<Slot, kSlots> slots_{};
  std::atomic<int> newest_{-1};
  std::atomic<std::uint64_t> replaced_{0};
};

}  // namespace palpate::device
