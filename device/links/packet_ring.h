// What an input-output thread hands to frames: a ring of short packets, made once, without locks.
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

}  // namespace palpate::device
