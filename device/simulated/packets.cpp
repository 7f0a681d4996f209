#include "device/simulated/packets.h"

#include <boost/crc.hpp>

#include "toolkit/core/bytes.h"

namespace palpate::device {
namespace {

constexpr std::size_t kCrcAt = kPacketBytes - 2;

std::uint16_t crc_of(std::span<const std::uint8_t> bytes) noexcept {
  boost::crc_ccitt_type crc;
  crc.process_bytes(bytes.data(), bytes.size());
  return crc.checksum();
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
