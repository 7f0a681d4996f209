// The packets of the simulated link: one state to the host, one command to the device, of the same 14 bytes.
//
//   byte    0      1     2-3       4-5   6-7   8-9   10     11   12-13
//           0xA5   kind  sequence  x     y     z     flags  0    CRC-16 of bytes 0 to 11
//
// All numbers little-endian. A state has kind 0x53, positions in counts (signed) and flags: bits 0 to 3
// buttons, bit 4 homed. A command has kind 0x43 and forces in counts. CRC-16 with the polynomial 0x1021,
// begun with 0xFFFF (CCITT): it finds every change of up to three bits, and every burst of up to 16.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace palpate::device {

inline constexpr std::size_t kPacketBytes = 14;
using PacketBytes = std::array<std::uint8_t, kPacketBytes>;

enum class PacketKind : std::uint8_t { kState = 0x53, kCommand = 0x43 };

struct Packet {
  static constexpr std::uint8_t kButtons = 0x0F, kHomed = 0x10;

  PacketKind kind = PacketKind::kState;
  std::uint16_t sequence = 0;
  std::array<std::int16_t, 3> counts{};
  std::uint8_t flags = 0;

  friend bool operator==(const Packet&, const Packet&) = default;
};

[[nodiscard]] PacketBytes encoded(const Packet& packet) noexcept;
/// Nothing where it is no packet. Every packet has one form: what is decoded encodes to the same bytes.
[[nodiscard]] std::optional<Packet> decoded(std::span<const std::uint8_t, kPacketBytes> bytes) noexcept;

/// Finds packets in a stream that may be torn, glued and damaged. One thread; no allocation.
class PacketReader {
 public:
  /// Takes the next byte. A packet where it was the last byte of one. After damage it looks on from the byte
  /// after the false start, so that a packet that begins within the damaged one is found. Bounded:
  /// kPacketBytes^2 steps for a byte at worst.
  [[nodiscard]] std::optional<Packet> take(std::uint8_t byte) noexcept;
  /// Bytes of the packet that take() gave last.
  [[nodiscard]] const PacketBytes& bytes() const noexcept { return last_; }
  /// Starts of packets that turned out to be none, since the last that was one.
  [[nodiscard]] std::uint32_t malformed_in_a_row() const noexcept { return malformed_in_a_row_; }
  /// Bytes that belonged to no packet, ever.
  [[nodiscard]] std::uint64_t dropped() const noexcept { return dropped_; }
  void clear() noexcept { *this = {}; }

 private:
  void drop_to_next_start() noexcept;

  PacketBytes held_{}, last_{};
  std::size_t size_ = 0;
  std::uint32_t malformed_in_a_row_ = 0;
  std::uint64_t dropped_ = 0;
};

}  // namespace palpate::device
