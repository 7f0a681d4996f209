#include "device/record/recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>

#include <palpate/result.h>
#include "device/record/recording_header.h"
#include "toolkit/core/files.h"
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
      kind > static_cast<std::uint32_t>(ChunkKind::kDepth) || head.payload_bytes > kMaxPayloadBytes)
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
                 "give a file that `palpate live record` or `palpate live --record` wrote", name_};
  if (head.size() < kFileHeadBytes)
    return Error{"ends within its first 16 bytes: nothing was recorded", "record again", name_};
  ByteReader from(head.subspan(mark.size()));
  const std::uint32_t version = from.u32();
  if (version < kRecordingVersion || version > kRecordingVersionWithDepth)
    return Error{fmt::format("is of version {} of the format, and this program reads versions {} to {}",
                             version, kRecordingVersion, kRecordingVersionWithDepth),
                 version > kRecordingVersionWithDepth ? "read it with a newer Palpate"
                                                      : "read it with an older Palpate",
                 name_};
  if (from.u32() != 0)
    return Error{"byte 12: four zeros belong here", "copy the file again, as binary", name_};
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
                   "copy the file again from where it was recorded", name_};
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

struct Recording::State {
  State(RecordingBytes bytes, std::string called, const ReadRecordingOptions& asked)
      : name(called), options(asked), chunks(std::move(bytes), std::move(called)) {}

  std::string name;
  ReadRecordingOptions options;
  ChunkReader chunks;
  RecordingHeader header;
  std::vector<RecordedRenderer> renderers;
  std::vector<std::string> notes;
  RecordingEnd end;
  std::uint64_t next_number = 1;

  std::optional<ChunkReader::Chunk> chunk;
  std::optional<ByteReader> ticks;
  std::uint32_t ticks_left = 0;
  CallStorage calls{};

  // The depth image whose parts are read; its bytes only where they are asked for.
  std::vector<std::byte>* depth = nullptr;
  std::size_t depth_parts = 0;  ///< read of it
  bool depth_whole = false;     ///< the last chunk completed one

  [[nodiscard]] Error damaged(std::uint64_t at, const std::string& what) const {
    return {fmt::format("byte {}: {}", at, what), "copy the file again from where it was recorded", name, 0};
  }
  [[nodiscard]] Result<bool> next_chunk();
  [[nodiscard]] Status open_chunk();
  [[nodiscard]] Status check_order();
  [[nodiscard]] bool take_depth(std::span<const std::byte> payload);
};

/// A jump in chunk numbers means a missing chunk.
Status Recording::State::check_order() {
  const ChunkReader::Chunk& c = *chunk;
  if (end.closed) return damaged(c.at, "a chunk stands behind the last one");
  const std::uint64_t expected = std::exchange(next_number, c.head.number + 1);
  if (c.skipped > 0) {
    if (!options.skip_damaged) {
      Error error = damaged(c.at - c.skipped, fmt::format("{} bytes are damaged", c.skipped));
      error.remedy += ", or leave them out with --skip-damaged";
      return error;
    }
    end.damaged.push_back({c.at - c.skipped, c.skipped});
    if (c.head.number > expected) return Done{};
  }
  if (c.head.number != expected)
    return damaged(c.at, fmt::format("chunk {} stands where chunk {} belongs", c.head.number, expected));
  return Done{};
}

/// A part whose predecessor is missing (damage that was skipped) is dropped with its image.
bool Recording::State::take_depth(std::span<const std::byte> payload) {
  ByteReader from(payload);
  const std::size_t part = from.u16(), parts = from.u16();
  if (!from.good() || part >= parts || parts > kMostDepthParts) return false;
  if (part == 0) {
    depth_parts = 0;
    if (depth != nullptr) depth->clear();
  }
  if (part != depth_parts) return true;
  ++depth_parts;
  const std::span<const std::byte> bytes = from.raw(from.left());
  if (depth != nullptr) depth->insert(depth->end(), bytes.begin(), bytes.end());
  depth_whole = depth_parts == parts;
  end.depth_images += depth_whole ? 1u : 0u;
  return true;
}

Status Recording::State::open_chunk() {
  depth_whole = false;
  const ChunkReader::Chunk& c = *chunk;
  bool sound = false;
  switch (c.head.kind) {
    case ChunkKind::kHeader:
      return damaged(c.at, "a second header");
    case ChunkKind::kRenderer: {
      std::uint16_t index = 0;
      RecordedRenderer renderer;
      sound = decode(c.payload, index, renderer);
      // A damaged renderer chunk leaves a gap: ticks that refer to it cannot be decoded.
      if (sound && index != renderers.size())
        return damaged(c.at,
                       fmt::format("renderer {} stands where renderer {} belongs", index, renderers.size()));
      if (sound) renderers.push_back(std::move(renderer));
      break;
    }
    case ChunkKind::kTicks:
      ticks.emplace(c.payload);
      ticks_left = c.head.ticks;
      sound = ticks_left > 0;
      break;
    case ChunkKind::kNote: {
      std::string text;
      sound = decode_note(c.payload, text);
      if (sound) notes.push_back(std::move(text));
      break;
    }
    case ChunkKind::kDepth:
      sound = take_depth(c.payload);
      break;
    case ChunkKind::kEnd: {
      RecordingClose close;
      sound = decode(c.payload, close);
      end.closed = true;
      end.reason = close.reason;
      end.lost = std::max(end.lost, close.lost);
      break;
    }
  }
  if (!sound) return damaged(c.at, "the chunk's content is not what its kind says");
  return Done{};
}

Result<bool> Recording::State::next_chunk() {
  PALPATE_ASSIGN(chunk, chunks.next());
  if (!chunk) {
    end.torn_bytes = chunks.torn_bytes();
    if (end.torn_bytes > 0) end.torn_at = chunks.torn_at() - end.torn_bytes;
    return false;
  }
  PALPATE_TRY(check_order());
  PALPATE_TRY(open_chunk());
  return true;
}

Recording::Recording(std::unique_ptr<State> state) : state_(std::move(state)) {}
Recording::Recording(Recording&&) noexcept = default;
Recording& Recording::operator=(Recording&&) noexcept = default;
Recording::~Recording() = default;

Result<Recording> Recording::open(RecordingBytes bytes, const std::string& name,
                                  const ReadRecordingOptions& options) {
  auto state = std::make_unique<State>(std::move(bytes), name, options);
  PALPATE_TRY(state->chunks.read_head());
  PALPATE_ASSIGN(const std::optional<ChunkReader::Chunk> first, state->chunks.next());
  if (!first) return Error{"ends before its header is whole: nothing was recorded", "record again", name};
  if (first->skipped > 0 || first->head.number != 0 || first->head.kind != ChunkKind::kHeader ||
      !decode(first->payload, state->header))
    return state->damaged(kFileHeadBytes, "the header is damaged, without which nothing is understood");
  return Recording(std::move(state));
}

Result<Recording> Recording::open(const std::string& path, const ReadRecordingOptions& options) {
  PALPATE_ASSIGN(InputFile file, InputFile::open(path));
  auto shared = std::make_shared<InputFile>(std::move(file));
  return open([shared](std::span<std::byte> out) { return shared->read(out); }, path, options);
}

const RecordingHeader& Recording::header() const noexcept {
  return state_->header;
}
const std::vector<RecordedRenderer>& Recording::renderers() const noexcept {
  return state_->renderers;
}
const std::vector<std::string>& Recording::notes() const noexcept {
  return state_->notes;
}
const RecordingEnd& Recording::end() const noexcept {
  return state_->end;
}

Result<bool> Recording::next(RecordedTick& tick) {
  State& s = *state_;
  while (s.ticks_left == 0) {
    if (s.ticks && s.ticks->left() > 0)
      return s.damaged(s.chunk->at, "the chunk is longer than the ticks it names");
    s.ticks.reset();
    PALPATE_ASSIGN(const bool more, s.next_chunk());
    if (!more) return false;
  }
  const std::size_t at = s.ticks->at();
  if (!decode(*s.ticks, {s.renderers.size(), s.header.decisions.size()}, s.calls, tick))
    return s.damaged(s.chunk->at + ChunkHead::kBytes + at, "this is no tick");
  if (s.end.ticks > 0 && tick.t_ns < s.end.last_ns)
    return s.damaged(s.chunk->at + ChunkHead::kBytes + at, "time goes back");
  --s.ticks_left;
  if (s.end.ticks == 0) s.end.first_ns = tick.t_ns;
  s.end.last_ns = tick.t_ns;
  ++s.end.ticks;
  s.end.lost += tick.lost_before;
  return true;
}

Result<bool> Recording::next_depth(std::vector<std::byte>& encoded) {
  State& s = *state_;
  s.ticks.reset();
  s.ticks_left = 0;
  s.depth = &encoded;
  for (;;) {
    Result<bool> more = s.next_chunk();
    if (!more || !*more || s.depth_whole) {
      s.depth = nullptr;
      return more;
    }
    s.ticks.reset();
    s.ticks_left = 0;
  }
}

std::vector<std::string> RecordingEnd::warnings() const {
  std::vector<std::string> all;
  if (!closed)
    all.push_back(
        "The recording was not closed: the session crashed or still runs. Up to its last second is missing.");
  if (torn_bytes > 0)
    all.push_back(fmt::format("Its last {} bytes, from byte {} on, are half a chunk and were dropped.",
                              torn_bytes, torn_at));
  for (const DamagedBytes& one : damaged)
    all.push_back(fmt::format("{} bytes from byte {} on are damaged and were left out.", one.bytes, one.at));
  if (lost > 0)
    all.push_back(
        fmt::format("{} ticks were lost while it was recorded: the disk was too slow or full.", lost));
  return all;
}

bool is_recording(const std::string& path) {
  Result<InputFile> file = InputFile::open(path);
  if (!file) return false;
  std::array<std::byte, kFileMark.size()> begins{};
  const Result<std::size_t> got = file->read(begins);
  return got && *got == begins.size() && std::ranges::equal(begins, std::as_bytes(std::span(kFileMark)));
}

}  // namespace palpate::device
