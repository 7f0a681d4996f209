// Reads a recording tick by tick. Every byte is checked; memory stays at some megabytes whatever the file
// claims. Layout: docs/reference/documents.md.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/result.h>
#include "device/record/recording_header.h"
#include "toolkit/core/bytes.h"

namespace palpate::device {

/// Fills its argument, or the front of it at the end of the data; 0 only at the end.
using RecordingBytes = std::function<Result<std::size_t>(std::span<std::byte>)>;

struct ReadRecordingOptions {
  /// Continues after damage in the middle and reports what is missing; otherwise damage is an Error. A torn
  /// tail, as from a crash, is none.
  bool skip_damaged = false;
};

/// Bytes that belong to no chunk.
struct DamagedBytes {
  std::uint64_t at = 0, bytes = 0;
};

struct RecordingEnd {
  bool closed = false;  ///< the recorder finished
  std::string reason;   ///< reason of the end, if closed
  std::uint64_t ticks = 0;
  std::uint64_t lost = 0;  ///< lost by the recorder; the last losses are known only if closed
  std::uint64_t torn_at = 0, torn_bytes = 0;  ///< dropped tail; 0: none
  std::vector<DamagedBytes> damaged;          ///< skipped
  std::int64_t first_ns = 0, last_ns = 0;     ///< first and last tick
  std::uint64_t depth_images = 0;             ///< whole ones, their cameras included

  /// Warnings for the user in whole sentences; empty if nothing is missing.
  [[nodiscard]] std::vector<std::string> warnings() const;
};

/// Movable, not thread-safe.
class Recording {
 public:
  [[nodiscard]] static Result<Recording> open(const std::string& path,
                                              const ReadRecordingOptions& options = {});
  /// The same from any bytes; `name` appears in messages.
  [[nodiscard]] static Result<Recording> open(RecordingBytes bytes, const std::string& name,
                                              const ReadRecordingOptions& options = {});
  Recording(Recording&&) noexcept;
  Recording& operator=(Recording&&) noexcept;
  ~Recording();

  [[nodiscard]] const RecordingHeader& header() const noexcept;
  /// Renderers met so far: all that the read ticks refer to.
  [[nodiscard]] const std::vector<RecordedRenderer>& renderers() const noexcept;
  [[nodiscard]] const std::vector<std::string>& notes() const noexcept;

  /// Reads the next tick; false at the end. The tick's calls stay valid until the next call. Times never go
  /// back. Errors name the byte.
  [[nodiscard]] Result<bool> next(RecordedTick& tick);
  /// Reads on to the next depth image or camera, past any ticks; false at the end.
  [[nodiscard]] Result<bool> next_depth(std::vector<std::byte>& encoded);
  /// After next() or next_depth() returned false.
  [[nodiscard]] const RecordingEnd& end() const noexcept;

 private:
  struct State;
  explicit Recording(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Whether the file begins like a recording; false if it cannot be read.
[[nodiscard]] bool is_recording(const std::string& path);

// Internal to recordings: framing of file chunks, which detects damage and lets readers find the next chunk.
// A file is kFileMark, the version, and chunks.

/// The line ends detect a copy made in text mode.
inline constexpr std::string_view kFileMark = "PALREC\r\n";
inline constexpr std::size_t kFileHeadBytes = 16;  ///< mark, version, four zeros

enum class ChunkKind : std::uint32_t { kHeader = 1, kRenderer, kTicks, kNote, kEnd, kDepth };

struct ChunkHead {
  static constexpr std::uint32_t kMark = 0x4B4E4843;  // "CHNK"
  static constexpr std::size_t kBytes = 48;

  ChunkKind kind = ChunkKind::kTicks;
  std::uint64_t number = 0;  ///< from 0, in file order
  std::uint32_t payload_bytes = 0;
  std::uint32_t ticks = 0;         ///< in a chunk of ticks
  std::int64_t t_ns = 0;           ///< of the first tick; otherwise 0
  std::uint64_t payload_hash = 0;  ///< FNV-1a, 64 bits
};

/// Longer than any chunk written: a chunk of ticks is closed at half of it.
inline constexpr std::size_t kMaxPayloadBytes = std::size_t{2} << 20;
inline constexpr std::size_t kFullPayloadBytes = kMaxPayloadBytes / 2;

// A depth image is cut into parts, a chunk each: their number from 0, how many there are, and the bytes.
inline constexpr std::size_t kDepthPartHeadBytes = 2 * sizeof(std::uint16_t);
inline constexpr std::size_t kDepthPartBytes = kFullPayloadBytes;
/// 256 MB: 8192 x 8192 depths of four bytes.
inline constexpr std::size_t kMostDepthParts = 256;

/// FNV-1a. Detects every change within one byte, since each step is one-to-one.
[[nodiscard]] std::uint64_t hash_of(std::span<const std::byte> bytes) noexcept;

/// Encodes the head; its last eight bytes hash those before.
[[nodiscard]] std::array<std::byte, ChunkHead::kBytes> encode(const ChunkHead& head) noexcept;
/// Decodes a head; nothing if these bytes are none.
[[nodiscard]] std::optional<ChunkHead> decode_head(std::span<const std::byte> bytes) noexcept;

/// Internal to recordings: reads a file chunk by chunk and finds the next whole chunk after damage. A tail
/// without one counts as torn.
class ChunkReader {
 public:
  ChunkReader(RecordingBytes bytes, std::string name) : source_(std::move(bytes)), name_(std::move(name)) {}

  struct Chunk {
    ChunkHead head;
    std::span<const std::byte> payload;  ///< valid until the next call
    std::uint64_t at = 0;                ///< file offset of its head
    std::uint64_t skipped = 0;           ///< damaged bytes before it
  };

  [[nodiscard]] Status read_head();
  /// The next whole chunk, or nothing at the end; `torn_bytes()` then counts the bytes after the last one.
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
  std::size_t at_ = 0, filled_ = 0;  ///< in the buffer: read position, filled size
  std::uint64_t offset_ = 0;         ///< file offset of the buffer's first byte
  bool ended_ = false;
  std::uint64_t torn_ = 0;
  int false_heads_ = 0;
};

}  // namespace palpate::device
