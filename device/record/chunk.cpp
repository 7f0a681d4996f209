#include "device/record/chunk.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include <palpate/result.h>
#include "toolkit/core/hash.h"

namespace palpate::device {
namespace {

constexpr std::size_t kHashedBytes = ChunkHead::kBytes - sizeof(std::uint64_t);

// Read size: a few usual chunks.
constexpr std::size_t kReadBytes = std::size_t{1} << 18;
// Limit of heads with a right checksum and a wrong payload, each of which costs reading a chunk. Damage makes
// only a few.
constexpr int kMaxFalseHeads = 64;

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
      kind > static_cast<std::uint32_t>(ChunkKind::kEnd) || head.payload_bytes > kMaxPayloadBytes)
    return std::nullopt;
  return head;
}

/// Fills the buffer to so many bytes, or to the end of the file.
Status ChunkReader::need(std::size_t bytes) {
  while (filled_ - at_ < bytes && !ended_) {
    if (at_ > 0) {
      std::copy(buffer_.begin() + static_cast<std::ptrdiff_t>(at_),
                buffer_.begin() + static_cast<std::ptrdiff_t>(filled_), buffer_.begin());
      offset_ += at_;
      filled_ -= at_;
      at_ = 0;
    }
    // Grows with the data present, not with the length claimed.
    if (buffer_.size() < filled_ + kReadBytes) buffer_.resize(filled_ + kReadBytes);
    PALPATE_ASSIGN(const std::size_t got, source_(std::span(buffer_).subspan(filled_)));
    if (got == 0) ended_ = true;
    filled_ += got;
  }
  return Done{};
}

Status ChunkReader::read_head() {
  PALPATE_TRY(need(kFileHeadBytes));
  const std::span<const std::byte> head = rest();
  const auto mark = std::as_bytes(std::span(kFileMark));
  if (head.size() < mark.size() || !std::equal(mark.begin(), mark.end(), head.begin()))
    return Error{"is no recording: it does not begin with the mark of one",
                 "give a file that `palpate live record` or `palpate live --record` wrote", name_, 0};
  if (head.size() < kFileHeadBytes)
    return Error{"ends within its first 16 bytes: nothing was recorded", "record again", name_, 0};
  ByteReader from(head.subspan(mark.size()));
  const std::uint32_t version = from.u32();
  if (version != kRecordingVersion)
    return Error{
        fmt::format("is of version {} of the format, and this program reads version {}", version,
                    kRecordingVersion),
        version > kRecordingVersion ? "read it with a newer Palpate" : "read it with an older Palpate", name_,
        0};
  if (from.u32() != 0)
    return Error{"byte 12: four zeros belong here", "copy the file again, as binary", name_, 0};
  at_ += kFileHeadBytes;
  return Done{};
}

Result<bool> ChunkReader::is_chunk(ChunkHead& head) {
  PALPATE_TRY(need(ChunkHead::kBytes));
  const std::optional<ChunkHead> found = decode_head(rest());
  if (!found) return false;
  PALPATE_TRY(need(ChunkHead::kBytes + found->payload_bytes));
  const std::span<const std::byte> here = rest();
  if (here.size() < ChunkHead::kBytes + found->payload_bytes) return false;
  if (hash_of(here.subspan(ChunkHead::kBytes, found->payload_bytes)) != found->payload_hash) {
    if (++false_heads_ > kMaxFalseHeads)
      return Error{fmt::format("is damaged in more than {} places, the last at byte {}", kMaxFalseHeads,
                               offset_ + at_),
                   "copy the file again from where it was recorded", name_, 0};
    return false;
  }
  head = *found;
  return true;
}

/// Skips to the next possible head in the buffer.
void ChunkReader::skip_to_mark() {
  std::array<std::byte, sizeof(ChunkHead::kMark)> mark{};
  ByteWriter(mark).u32(ChunkHead::kMark);
  const auto from = buffer_.begin() + static_cast<std::ptrdiff_t>(at_) + 1;
  const auto to = buffer_.begin() + static_cast<std::ptrdiff_t>(filled_);
  const auto found = std::search(from, to, mark.begin(), mark.end());
  if (found != to) {
    at_ = static_cast<std::size_t>(found - buffer_.begin());
    return;
  }
  // A mark may cross the buffer's end.
  at_ = std::max(at_ + 1, filled_ - std::min(filled_, mark.size() - 1));
}

Result<std::optional<ChunkReader::Chunk>> ChunkReader::next() {
  const std::uint64_t begun = offset_ + at_;
  PALPATE_TRY(need(1));
  Chunk chunk;
  while (!rest().empty()) {
    PALPATE_ASSIGN(const bool whole, is_chunk(chunk.head));
    if (whole) {
      chunk.at = offset_ + at_;
      chunk.skipped = chunk.at - begun;
      chunk.payload = rest().subspan(ChunkHead::kBytes, chunk.head.payload_bytes);
      at_ += ChunkHead::kBytes + chunk.head.payload_bytes;
      return std::optional<Chunk>(chunk);
    }
    skip_to_mark();
    PALPATE_TRY(need(1));
  }
  torn_ = offset_ + at_ - begun;
  return std::optional<Chunk>();
}

}  // namespace palpate::device
