// Packets of the simulated link: states to the host and commands to the device, 14 bytes each.
//
//   byte    0      1     2-3       4-5   6-7   8-9   10     11   12-13
//           0xA5   kind  sequence  x     y     z     flags  0    CRC-16 of bytes 0 to 11
//
// Little-endian. A state has kind 0x53, signed positions in counts, and flags: bits 0 to 3 buttons, bit 4
// homed. A command has kind 0x43 and forces in counts. CRC-16 with polynomial 0x1021, initial value 0xFFFF
// (CCITT), detects changes of up to three bits and bursts of up to 16.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "device/interface/stream_reader.h"

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
/// Nothing if malformed. A decoded packet encodes to the same bytes.
[[nodiscard]] std::optional<Packet> decoded(std::span<const std::uint8_t, kPacketBytes> bytes) noexcept;

struct PacketFormat {
  using Packet = device::Packet;
  static constexpr std::uint8_t kStart = 0xA5;
  static constexpr std::size_t kBytes = kPacketBytes;
  static std::optional<Packet> decode(std::span<const std::uint8_t, kBytes> bytes) noexcept {
    return decoded(bytes);
  }
};
using PacketReader = StreamReader<PacketFormat>;

}  // namespace palpate::device
