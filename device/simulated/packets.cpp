#include "device/simulated/packets.h"

#include "toolkit/core/bytes.h"

namespace palpate::device {
namespace {

constexpr std::size_t kCrcAt = kPacketBytes - 2;

std::uint16_t crc_of(std::span<const std::uint8_t> bytes) noexcept {
  constexpr std::uint32_t kPolynomial = 0x1021, kTop = 0x8000, kAll = 0xFFFF;
  std::uint32_t crc = kAll;
  for (const std::uint8_t byte : bytes) {
    crc ^= static_cast<std::uint32_t>(byte) << 8U;
    for (int bit = 0; bit < 8; ++bit) crc = ((crc << 1U) ^ ((crc & kTop) != 0 ? kPolynomial : 0U)) & kAll;
  }
  return static_cast<std::uint16_t>(crc);
}

bool is_kind(std::uint8_t byte) noexcept {
  return byte == static_cast<std::uint8_t>(PacketKind::kState) ||
         byte == static_cast<std::uint8_t>(PacketKind::kCommand);
}

}  // namespace

PacketBytes encoded(const Packet& packet) noexcept {
  PacketBytes bytes{};
  bytes[0] = PacketFormat::kStart;
  bytes[1] = static_cast<std::uint8_t>(packet.kind);
  ByteWriter out{std::span(bytes).subspan(2)};
  out.u16(packet.sequence);
  for (const std::int16_t count : packet.counts) out.u16(static_cast<std::uint16_t>(count));
  bytes[10] = packet.flags;
  ByteWriter(std::span(bytes).subspan(kCrcAt)).u16(crc_of(std::span(bytes).first(kCrcAt)));
  return bytes;
}

std::optional<Packet> decoded(std::span<const std::uint8_t, kPacketBytes> bytes) noexcept {
  if (bytes[0] != PacketFormat::kStart || !is_kind(bytes[1]) || bytes[11] != 0) return std::nullopt;
  if ((bytes[10] & ~unsigned{Packet::kButtons | Packet::kHomed}) != 0) return std::nullopt;
  if (crc_of(bytes.first(kCrcAt)) != ByteReader(bytes.subspan(kCrcAt)).u16()) return std::nullopt;
  Packet packet;
  packet.kind = static_cast<PacketKind>(bytes[1]);
  ByteReader in(bytes.subspan(2));
  packet.sequence = in.u16();
  for (std::int16_t& count : packet.counts) count = static_cast<std::int16_t>(in.u16());
  packet.flags = bytes[10];
  return packet;
}

}  // namespace palpate::device
