#include "device/record/chunk_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "toolkit/core/try.h"

namespace palpate::device {
namespace {

// Read at once: a few chunks of the usual size.
constexpr std::size_t kReadBytes = std::size_t{1} << 18;
// Heads whose checksum is right and whose payload is not: each costs the reading of a whole chunk. Damage
// makes a few; a file that is made of them is no recording.
constexpr int kMostFalseHeads = 64;

}  // namespace

/// So many bytes stand in the buffer, or all that the file has.
Status ChunkReader::need(std::size_t bytes) {
  while (filled_ - at_ < bytes && !ended_) {
    if (at_ > 0) {
      std::copy(buffer_.begin() + static_cast<std::ptrdiff_t>(at_),
                buffer_.begin() + static_cast<std::ptrdiff_t>(filled_), buffer_.begin());
      offset_ += at_;
      filled_ -= at_;
      at_ = 0;
    }
    // Grows with what is there, not with what is claimed.
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
                 "give a file that `palpate record` or `palpate live --record` wrote", name_, 0};
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

/// Whether a whole chunk stands here.
Result<bool> ChunkReader::is_chunk(ChunkHead& head) {
  PALPATE_TRY(need(ChunkHead::kBytes));
  const std::optional<ChunkHead> found = decode_head(rest());
  if (!found) return false;
  PALPATE_TRY(need(ChunkHead::kBytes + found->payload_bytes));
  const std::span<const std::byte> here = rest();
  if (here.size() < ChunkHead::kBytes + found->payload_bytes) return false;
  if (hash_of(here.subspan(ChunkHead::kBytes, found->payload_bytes)) != found->payload_hash) {
    if (++false_heads_ > kMostFalseHeads)
      return Error{fmt::format("is damaged in more than {} places, the last at byte {}", kMostFalseHeads,
                               offset_ + at_),
                   "copy the file again from where it was recorded", name_, 0};
    return false;
  }
  head = *found;
  return true;
}

/// To the next place where a head may begin, in what is in the buffer.
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
  // A mark may stand across the buffer's end.
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
