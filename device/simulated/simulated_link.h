// A simulated link: packets of a scripted hand to and from a simulated board on any clock, with all faults of
// a cable.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/link.h>
#include <palpate/result.h>
#include "device/simulated/hand_script.h"
#include "device/simulated/packets.h"
#include "toolkit/core/random.h"

namespace palpate::device {

// Motor board of the simulated link. It holds the last command for ever, as real devices may, in memory that
// outlives the commanding process.

/// Lock-free atomics only: it may be in shared memory, and a writer may be killed at any instruction. Several
/// may command; the last wins.
class SimulatedBoard {
 public:
  using Counts = std::array<std::int16_t, 3>;

  /// Takes the bytes of a command. Invalid ones are counted and ignored.
  void command(std::span<const std::uint8_t> bytes, std::int64_t now_ns) noexcept;
  /// Pulls the cable, which also carries the motors' power; later commands are ignored.
  void unplug(std::int64_t now_ns) noexcept;
  void plug() noexcept { plugged_.store(true, std::memory_order_release); }

  [[nodiscard]] bool plugged() const noexcept { return plugged_.load(std::memory_order_acquire); }
  [[nodiscard]] Counts held() const noexcept;
  [[nodiscard]] bool holds_force() const noexcept { return held_.load(std::memory_order_acquire) != 0; }
  /// Time of the last release, on the releaser's clock.
  [[nodiscard]] std::int64_t zeroed_ns() const noexcept { return zeroed_ns_.load(std::memory_order_acquire); }
  [[nodiscard]] std::uint64_t commands() const noexcept { return commands_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }

 private:
  void hold(std::uint64_t packed, std::int64_t now_ns) noexcept;

  std::atomic<std::uint64_t> held_{0};  // three counts in one word: no reader sees half a command
  std::atomic<std::int64_t> zeroed_ns_{0};
  std::atomic<std::uint64_t> commands_{0}, refused_{0};
  std::atomic<bool> plugged_{true};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
};

/// A board in memory shared by forked processes.
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

/// A fault from `start_s` (time since open) for `duration_s`.
struct LinkFault {
  enum class Kind : std::uint8_t {
    kSilent,
    kShort,       ///< only the first half of each packet
    kGarbled,     ///< random bits of each packet are flipped
    kLate,        ///< each packet comes `late_s` late
    kLost,        ///< one of `of` packets comes
    kDuplicated,  ///< the last earlier packet is repeated
    kUnplugged,
    kUnhomed,  ///< the device has lost its zero position
    kJump,     ///< the position is offset by `jump_mm`
  };
  Kind kind = Kind::kSilent;
  double start_s = 0.0;
  double duration_s = 0.0;
  double late_s = 0.030;
  std::uint32_t of = 1000;
  Vec3 jump_mm = Vec3{60.0, 0.0, 0.0};
};

struct SimulatedLinkOptions {
  double rate_hz = 1000.0;  ///< packets per second
  double mm_per_count = 0.01;
  std::uint8_t flags = Packet::kHomed;
  std::uint64_t seed = 1;
};

/// Keeps references to board, script and clock. One thread may poll, any may submit. Allocates only in the
/// constructor.
class SimulatedLink final : public Link {
 public:
  SimulatedLink(SimulatedBoard& board, const HandScript& script, const Clock& clock,
                const SimulatedLinkOptions& options = {}, std::vector<LinkFault> faults = {});

  [[nodiscard]] Status open() override;
  void close() noexcept override;
  bool submit(std::span<const std::uint8_t> bytes) noexcept override;
  [[nodiscard]] Polled poll(std::span<std::uint8_t> into) noexcept override;

 private:
  [[nodiscard]] const LinkFault* fault_at(double t_s) const noexcept;
  [[nodiscard]] Packet packet_of(std::int64_t index, const LinkFault* fault) const noexcept;
  [[nodiscard]] std::size_t apply_fault(PacketBytes& bytes, const LinkFault* fault) noexcept;

  SimulatedBoard& board_;
  const HandScript& script_;
  const Clock& clock_;
  SimulatedLinkOptions options_;
  std::vector<LinkFault> faults_;
  Random random_;
  std::atomic<bool> open_{false};
  double opened_s_ = 0.0;
  std::int64_t newest_ = -1;
  PacketBytes last_{};
};

}  // namespace palpate::device
