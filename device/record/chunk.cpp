#include "device/record/chunk.h"

#include "toolkit/core/hash.h"

namespace palpate::device {
namespace {

constexpr std::size_t kHashedBytes = ChunkHead::kBytes - sizeof(std::uint64_t);

}  // namespace

std::uint64_t hash_of(std::span<const std::byte> bytes) noexcept {
  Hash64 hash;
  hash.bytes(bytes);
  return hash.value();
}

std::array<std::byte, ChunkHead::kBytes> encode(const ChunkHead& head) noexcept {
  std::array<std::byte, ChunkHead::kBytes> bytes{};
  ByteWriter out(bytes);
  out.u32(ChunkHead::kMark);
  out.u32(static_cast<std::uint32_t>(head.kind));
  out.u64(head.number);
  out.u32(head.payload_bytes);
  out.u32(head.ticks);
  out.i64(head.t_ns);
  out.u64(head.payload_hash);
  out.u64(hash_of(std::span(bytes).first(kHashedBytes)));
  return bytes;
}

std::optional<ChunkHead> decode_head(std::span<const std::byte> bytes) noexcept {
  if (bytes.size() < ChunkHead::kBytes) return std::nullopt;
  ByteReader from(bytes.first(ChunkHead::kBytes));
  if (from.u32() != ChunkHead::kMark) return std::nullopt;
  ChunkHead head;
  const std::uint32_t kind = from.u32();
  head.kind = static_cast<ChunkKind>(kind);
  head.number = from.u64();
  head.payload_bytes = from.u32();
  head.ticks = from.u32();
  head.t_ns = from.i64();
  head.payload_hash = from.u64();
  if (from.u64() != hash_of(bytes.first(kHashedBytes))) return std::nullopt;
  if (kind < static_cast<std::uint32_t>(ChunkKind::kHeader) ||
      kind > static_cast<std::uint32_t>(ChunkKind::kEnd) || head.payload_bytes > kMostPayloadBytes)
    return std::nullopt;
  return head;
}

}  // namespace palpate::device
