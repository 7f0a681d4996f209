// The far side of the simulated link: motors that hold their last command for ever, as those of real devices
// may, in memory that outlives the process that commanded them.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "toolkit/core/result.h"

namespace palpate::device {

/// Lock-free atomics alone: it may stand in shared memory, and whoever writes it may be killed at any
/// instruction. Several may command it at once, the last one counts.
class SimulatedBoard {
 public:
  using Counts = std::array<std::int16_t, 3>;

  /// The bytes of a command, as they came. What is no command is counted and changes nothing.
  void command(std::span<const std::uint8_t> bytes, std::int64_t now_ns) noexcept;
  /// Its cable is pulled, and with it the power of its motors. Commands are not heard any more.
  void unplug(std::int64_t now_ns) noexcept;
  void plug() noexcept { plugged_.store(true, std::memory_order_release); }

  [[nodiscard]] bool plugged() const noexcept { return plugged_.load(std::memory_order_acquire); }
  /// What the motors hold now.
  [[nodiscard]] Counts held() const noexcept;
  [[nodiscard]] bool holds_force() const noexcept { return held_.load(std::memory_order_acquire) != 0; }
  /// When they were last let go, on the clock of who did.
  [[nodiscard]] std::int64_t zeroed_ns() const noexcept { return zeroed_ns_.load(std::memory_order_acquire); }
  [[nodiscard]] std::uint64_t commands() const noexcept { return commands_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }

 private:
  void hold(std::uint64_t packed, std::int64_t now_ns) noexcept;

  std::atomic<std::uint64_t> held_{0};  // three counts in one word: never half of a command
  std::atomic<std::int64_t> zeroed_ns_{0};
  std::atomic<std::uint64_t> commands_{0}, refused_{0};
  std::atomic<bool> plugged_{true};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
};

/// A board in memory that forked processes share.
class SharedBoard {
 public:
  [[nodiscard]] static Result<SharedBoard> create();
  [[nodiscard]] SimulatedBoard& board() const noexcept { return *board_; }

 private:
  struct Unmap {
    void operator()(SimulatedBoard* board) const noexcept;
  };
  explicit SharedBoard(SimulatedBoard* board) noexcept : board_(board) {}
  std::unique_ptr<SimulatedBoard, Unmap> board_;
};

}  // namespace palpate::device
