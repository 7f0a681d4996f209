// What frames and an input-output thread hand each other: rings of short packets, made once, without locks.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>

namespace palpate::device {

/// The longest packet: a full-speed bulk packet, and the largest HID report of the devices here.
inline constexpr std::size_t kLinkPacketBytes = 64;

struct LinkPacket {
  std::array<std::uint8_t, kLinkPacketBytes> bytes{};
  std::size_t size = 0;

  [[nodiscard]] std::span<const std::uint8_t> used() const noexcept { return std::span(bytes).first(size); }
};

/// From one thread to one other. Neither waits, neither allocates.
template <std::size_t kCapacity>
class PacketRing {
 public:
  /// By the writer. False: full, or too long; nothing is kept.
  bool push(std::span<const std::uint8_t> bytes) noexcept {
    const std::size_t at = written_.load(std::memory_order_relaxed);
    if (at - read_.load(std::memory_order_acquire) == kCapacity || bytes.size() > kLinkPacketBytes)
      return false;
    LinkPacket& packet = packets_[at % kCapacity];
    std::copy(bytes.begin(), bytes.end(), packet.bytes.begin());
    packet.size = bytes.size();
    written_.store(at + 1, std::memory_order_release);
    return true;
  }
  /// By the reader: the oldest, which stays until drop(); nullptr: empty.
  [[nodiscard]] const LinkPacket* front() const noexcept {
    const std::size_t at = read_.load(std::memory_order_relaxed);
    return at == written_.load(std::memory_order_acquire) ? nullptr : &packets_[at % kCapacity];
  }
  void drop() noexcept { read_.store(read_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }
  /// While neither thread uses it.
  void clear() noexcept { read_.store(written_.load()); }

 private:
  std::array<LinkPacket, kCapacity> packets_;
  std::atomic<std::size_t> written_{0}, read_{0};
};

/// From any number of threads to one, in the order in which they took their places. A writer tries again only
/// when another one was faster, so that one of them always comes through; a writer that is stopped between
/// taking its place and filling it holds up what comes after it. After D. Vyukov's bounded queue.
template <std::size_t kCapacity>
class CommandQueue {
  static_assert((kCapacity & (kCapacity - 1)) == 0, "places are counted past the end of size_t");

 public:
  CommandQueue() noexcept {
    for (std::size_t i = 0; i < kCapacity; ++i) slots_[i].turn.store(i, std::memory_order_relaxed);
  }

  /// By any thread. False: full, or too long.
  bool push(std::span<const std::uint8_t> bytes) noexcept {
    if (bytes.size() > kLinkPacketBytes) return false;
    std::size_t at = next_.load(std::memory_order_relaxed);
    for (;;) {
      Slot& slot = slots_[at % kCapacity];
      const std::size_t turn = slot.turn.load(std::memory_order_acquire);
      if (turn == at) {
        if (!next_.compare_exchange_weak(at, at + 1, std::memory_order_relaxed)) continue;
        std::copy(bytes.begin(), bytes.end(), slot.packet.bytes.begin());
        slot.packet.size = bytes.size();
        slot.turn.store(at + 1, std::memory_order_release);
        return true;
      }
      if (turn + kCapacity == at + 1) return false;  // its last packet was not taken yet
      at = next_.load(std::memory_order_relaxed);
    }
  }
  /// By the reader. False: empty.
  bool pop(LinkPacket& packet) noexcept {
    Slot& slot = slots_[taken_ % kCapacity];
    if (slot.turn.load(std::memory_order_acquire) != taken_ + 1) return false;
    packet = slot.packet;
    slot.turn.store(taken_ + kCapacity, std::memory_order_release);
    ++taken_;
    return true;
  }

 private:
  struct Slot {
    std::atomic<std::size_t> turn{0};
    LinkPacket packet;
  };
  std::array<Slot, kCapacity> slots_;
  std::atomic<std::size_t> next_{0};
  std::size_t taken_ = 0;  // the reader's
};

}  // namespace palpate::device
