#include "device/record/recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include <palpate/result.h>
#include "device/record/chunk.h"
#include "device/record/recording_codec.h"
#include "toolkit/core/input_file.h"

namespace palpate::device {

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

  [[nodiscard]] Error damaged(std::uint64_t at, const std::string& what) const {
    return {fmt::format("byte {}: {}", at, what), "copy the file again from where it was recorded", name, 0};
  }
  [[nodiscard]] Result<bool> next_chunk();
  [[nodiscard]] Status open_chunk();
  [[nodiscard]] Status check_order();
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

Status Recording::State::open_chunk() {
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
  if (!first) return Error{"ends before its header is whole: nothing was recorded", "record again", name, 0};
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
