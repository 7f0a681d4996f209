#include "device/simulated/packets.h"

#include <algorithm>
#include <limits>

namespace palpate::device {
namespace {

constexpr std::uint8_t kStart = 0xA5;
constexpr std::size_t kCrcAt = kPacketBytes - 2;

void put16(PacketBytes& bytes, std::size_t at, std::uint16_t value) noexcept {
  bytes[at] = static_cast<std::uint8_t>(value & 0xFFU);
  bytes[at + 1] = static_cast<std::uint8_t>(value >> 8U);
}

std::uint16_t get16(std::span<const std::uint8_t> bytes, std::size_t at) noexcept {
  return static_cast<std::uint16_t>(bytes[at] | (bytes[at + 1] << 8U));
}

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
  bytes[0] = kStart;
  bytes[1] = static_cast<std::uint8_t>(packet.kind);
  put16(bytes, 2, packet.sequence);
  for (std::size_t axis = 0; axis < packet.counts.size(); ++axis)
    put16(bytes, 4 + 2 * axis, static_cast<std::uint16_t>(packet.counts[axis]));
  bytes[10] = packet.flags;
  put16(bytes, kCrcAt, crc_of(std::span(bytes).first(kCrcAt)));
  return bytes;
}

std::optional<Packet> decoded(std::span<const std::uint8_t, kPacketBytes> bytes) noexcept {
  if (bytes[0] != kStart || !is_kind(bytes[1]) || bytes[11] != 0) return std::nullopt;
  if ((bytes[10] & ~unsigned{Packet::kButtons | Packet::kHomed}) != 0) return std::nullopt;
  if (crc_of(bytes.first(kCrcAt)) != get16(bytes, kCrcAt)) return std::nullopt;
  Packet packet;
  packet.kind = static_cast<PacketKind>(bytes[1]);
  packet.sequence = get16(bytes, 2);
  for (std::size_t axis = 0; axis < packet.counts.size(); ++axis)
    packet.counts[axis] = static_cast<std::int16_t>(get16(bytes, 4 + 2 * axis));
  packet.flags = bytes[10];
  return packet;
}

std::optional<Packet> PacketReader::take(std::uint8_t byte) noexcept {
  if (size_ == 0 && byte != kStart) {
    ++dropped_;
    return std::nullopt;
  }
  held_[size_++] = byte;
  if (size_ < kPacketBytes) return std::nullopt;
  const std::optional<Packet> packet = decoded(held_);
  if (packet) {
    last_ = held_;
    size_ = 0;
    malformed_in_a_row_ = 0;
  } else {
    if (malformed_in_a_row_ < std::numeric_limits<std::uint32_t>::max()) ++malformed_in_a_row_;
    drop_to_next_start();
  }
  return packet;
}

void PacketReader::drop_to_next_start() noexcept {
  const auto end = held_.begin() + static_cast<std::ptrdiff_t>(size_);
  const auto next = std::find(held_.begin() + 1, end, kStart);
  dropped_ += static_cast<std::uint64_t>(next - held_.begin());
  size_ = static_cast<std::size_t>(std::copy(next, end, held_.begin()) - held_.begin());
}

}  // namespace palpate::device
