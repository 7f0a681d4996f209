// Internal to recordings: a file chunk by chunk. Finds the next whole chunk behind damaged bytes, and tells a
// torn tail from damage in the middle: nothing whole comes after a tail.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "device/record/chunk.h"
#include "device/record/recording.h"

namespace palpate::device {

class ChunkReader {
 public:
  ChunkReader(RecordingBytes bytes, std::string name) : source_(std::move(bytes)), name_(std::move(name)) {}

  struct Chunk {
    ChunkHead head;
    std::span<const std::byte> payload;  ///< until the next call
    std::uint64_t at = 0;                ///< of its head, in the file
    std::uint64_t skipped = 0;           ///< damaged bytes before it
  };

  /// Mark and version.
  [[nodiscard]] Status read_head();
  /// The next whole chunk, or nothing at the end; `torn_bytes()` is then what stands behind the last one.
  [[nodiscard]] Result<std::optional<Chunk>> next();
  [[nodiscard]] std::uint64_t torn_at() const noexcept { return offset_ + at_; }
  [[nodiscard]] std::uint64_t torn_bytes() const noexcept { return torn_; }

 private:
  [[nodiscard]] Status need(std::size_t bytes);
  [[nodiscard]] std::span<const std::byte> rest() const {
    return std::span(buffer_).subspan(at_, filled_ - at_);
  }
  [[nodiscard]] Result<bool> is_chunk(ChunkHead& head);
  void skip_to_mark();

  RecordingBytes source_;
  std::string name_;
  std::vector<std::byte> buffer_;
  std::size_t at_ = 0, filled_ = 0;  ///< of the buffer: read to, and filled to
  std::uint64_t offset_ = 0;         ///< of the buffer's first byte in the file
  bool ended_ = false;
  std::uint64_t torn_ = 0;
  int false_heads_ = 0;
};

}  // namespace palpate::device
