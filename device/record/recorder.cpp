#include "device/record/recorder.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/lockfree/spsc_queue.hpp>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <optional>
#include <thread>

#include <palpate/clock.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include "device/record/recording.h"
#include "device/record/recording_header.h"
#include "toolkit/core/files.h"

namespace palpate::device {
namespace {

class DiskFile final : public RecordingFile {
 public:
  DiskFile(std::string path, LockedFile file) : path_(std::move(path)), file_(std::move(file)) {}

  Status append(std::span<const std::byte> bytes) override {
    std::span<const std::byte> rest = bytes;
    while (!rest.empty()) {
      const ssize_t n =
          ::pwrite(file_.fd(), rest.data(), rest.size(), static_cast<off_t>(end_) + done(bytes, rest));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return failed("write", n == 0 ? EIO : errno);
      rest = rest.subspan(static_cast<std::size_t>(n));
    }
    end_ += bytes.size();
    return Done{};
  }

  Status flush(Flush how) override {
    if (how == Flush::kSystem) return Done{};
    // EINVAL: not a disk, so nothing needs synchronising.
    if (::fdatasync(file_.fd()) != 0 && errno != EINVAL && errno != EROFS) return failed("flush", errno);
    return Done{};
  }

  const std::string& path() const noexcept override { return path_; }

 private:
  static off_t done(std::span<const std::byte> all, std::span<const std::byte> rest) {
    return static_cast<off_t>(all.size() - rest.size());
  }
  Status failed(const char* doing, int why) {
    // Removes a partial chunk, so that the next starts at the right offset.
    if (::ftruncate(file_.fd(), static_cast<off_t>(end_)) != 0) {
      // On failure the next try overwrites it, or readers see a torn tail.
    }
    return Error{fmt::format("cannot {} the recording: {}", doing, std::strerror(why)),
                 why == ENOSPC  ? "free some space on the disk"
                 : why == EFBIG ? "raise the limit of file sizes (ulimit -f), or record for a shorter time"
                                : "check the disk",
                 path_};
  }

  std::string path_;
  LockedFile file_;
  std::uint64_t end_ = 0;
};

// Polling period of the writer: 40 wake-ups a second; a crash loses a tenth of a chunk more.
constexpr std::chrono::milliseconds kLook{25};
// Retry period after a failed write: a full disk stays full for a while.
constexpr std::int64_t kRetryNs = 100'000'000;
constexpr double kNsPerS = 1e9;
constexpr std::size_t kSizeBytes = sizeof(std::uint32_t);  // before each tick in the ring
// Records taken between two looks at the clock.
constexpr int kRecordsAtOnce = 64;

}  // namespace

Result<std::unique_ptr<RecordingFile>> make_recording_file(const std::string& path, bool replace) {
  struct stat found {};
  if (::stat(path.c_str(), &found) == 0) {
    if (!S_ISREG(found.st_mode))
      return Error{"cannot record into this: it is no plain file", "give another name", path};
    if (!replace)
      return Error{"a file of this name is there already, and recordings are not replaced unasked",
                   "give another name, or --force to replace it", path};
  }
  Result<LockedFile> locked = LockedFile::open(path);
  if (!locked) return Error{"cannot make the file: " + locked.error().what, locked.error().remedy, path};
  if (!locked->held())
    return Error{"another program is writing this file", "wait for it to end, or give another name", path};
  if (::ftruncate(locked->fd(), 0) != 0)
    return Error{fmt::format("cannot empty the file: {}", std::strerror(errno)), "give another name", path};
  return std::unique_ptr<RecordingFile>(std::make_unique<DiskFile>(path, *std::move(locked)));
}

struct Recorder::State {
  State(std::unique_ptr<RecordingFile> to, TickSource& from, const RecorderOptions& asked)
      : file(std::move(to)),
        source(from),
        options(asked),
        chunk_ns(static_cast<std::int64_t>(asked.chunk_s * kNsPerS)),
        ring_bytes(std::max(asked.ring_bytes, 2 * (kSizeBytes + kMaxBytesATick))),
        ring(ring_bytes) {
    chunk.resize(kMaxPayloadBytes);
    // Touches every byte, so that no page fault follows.
    const std::vector<std::byte> zeros(ring_bytes);
    ring.push(zeros.data(), zeros.size());
    ring.reset();
  }

  // Guarded by the mutex; never used by the servo thread.
  std::mutex file_mutex;
  std::unique_ptr<RecordingFile> file;
  std::uint64_t next_number = 0;
  std::uint16_t renderers = 0;
  [[nodiscard]] Status append(ChunkKind kind, std::uint32_t ticks, std::int64_t t_ns,
                              std::span<const std::byte> payload, Flush flush);

  // Used by the servo thread.
  TickSource& source;
  RecorderOptions options;
  RecordedTick tick;
  std::array<std::byte, kSizeBytes + kMaxBytesATick> scratch{};
  std::int64_t first_t_ns = 0, last_t_ns = 0;
  bool has_tick = false;
  std::uint64_t lost_pending = 0;

  // Used by the writer thread.
  std::int64_t chunk_ns;
  std::vector<std::byte> chunk;  ///< ticks not yet in the file: the first chunk_bytes
  std::size_t chunk_bytes = 0;
  std::uint32_t chunk_ticks = 0;
  std::int64_t chunk_t_ns = 0, chunk_begun_ns = 0, tried_ns = 0;
  std::array<std::byte, kMaxBytesATick> popped{};
  std::size_t popped_bytes = 0;  ///< taken from the ring, not yet in the chunk
  std::optional<Error> failure;  ///< of the last try
  /// The seconds that so many of the last ticks span.
  [[nodiscard]] double seconds_of(std::uint64_t of_ticks) const noexcept {
    const auto taken = static_cast<double>(ticks.load(std::memory_order_relaxed));
    return taken > 1.0 ? static_cast<double>(last_t_ns - first_t_ns) / kNsPerS *
                             static_cast<double>(of_ticks) / (taken - 1.0)
                       : 0.0;
  }
  void write_all();
  void drain();
  [[nodiscard]] std::size_t pop_tick() noexcept;
  [[nodiscard]] bool take();
  void write_chunk(bool now);

  // Shared between threads.
  // Of each tick its size and its bytes, pushed together: who sees the size sees the rest.
  std::size_t ring_bytes;
  boost::lockfree::spsc_queue<std::byte> ring;
  std::atomic<bool> closed{false}, stop{false}, failing{false};
  std::atomic<std::uint64_t> ticks{0}, lost{0}, written{0}, bytes{0};
  std::mutex wake_mutex;
  std::condition_variable wake;
  std::thread writer;

  std::mutex finish_mutex;
  std::optional<Status> finished;
  StopCallback stop_callback;
};

Status Recorder::State::append(ChunkKind kind, std::uint32_t tick_count, std::int64_t t_ns,
                               std::span<const std::byte> payload, Flush flush) {
  ChunkHead head{kind,       next_number, static_cast<std::uint32_t>(payload.size()),
                 tick_count, t_ns,        hash_of(payload)};
  const auto front = encode(head);
  // A single write, so that a crash of the program leaves all or nothing.
  std::vector<std::byte> whole;
  whole.reserve(kFileHeadBytes + front.size() + payload.size());
  if (kind == ChunkKind::kHeader) {
    whole.resize(kFileHeadBytes);
    ByteWriter out(whole);
    out.raw(std::as_bytes(std::span(kFileMark)));
    out.u32(options.depth ? kRecordingVersionWithDepth : kRecordingVersion);
    out.u32(0);
  }
  whole.insert(whole.end(), front.begin(), front.end());
  whole.insert(whole.end(), payload.begin(), payload.end());
  PALPATE_TRY(file->append(whole));
  // The bytes are in the file even if a flush fails now: they must not be written twice.
  ++next_number;
  bytes.store(bytes.load(std::memory_order_relaxed) + whole.size(), std::memory_order_relaxed);
  return file->flush(flush);
}

/// Pops the oldest tick; returns its size; 0: none.
std::size_t Recorder::State::pop_tick() noexcept {
  std::array<std::byte, kSizeBytes> size{};
  if (ring.pop(size.data(), size.size()) == 0) return 0;
  return ring.pop(popped.data(), ByteReader(std::span<const std::byte>(size)).u32());
}

/// Moves the next tick from ring to chunk. False: none, or the chunk must be written first.
bool Recorder::State::take() {
  if (popped_bytes == 0) popped_bytes = pop_tick();
  if (popped_bytes == 0) return false;
  // Offset of the time in every tick.
  constexpr std::size_t kTimeAt = 4;
  const std::int64_t t_ns = ByteReader(std::span(popped).subspan(kTimeAt)).i64();
  const bool full =
      chunk_ticks > 0 && (t_ns - chunk_t_ns >= chunk_ns || chunk_bytes + popped_bytes > kFullPayloadBytes);
  if (full) return false;
  if (chunk_ticks == 0) {
    chunk_t_ns = t_ns;
    chunk_begun_ns = monotonic_ns();
  }
  std::copy_n(popped.begin(), popped_bytes, chunk.begin() + static_cast<std::ptrdiff_t>(chunk_bytes));
  chunk_bytes += popped_bytes;
  ++chunk_ticks;
  popped_bytes = 0;
  return true;
}

void Recorder::State::write_chunk(bool now) {
  if (chunk_ticks == 0) return;
  const std::int64_t now_ns = monotonic_ns();
  if (failure && !now && now_ns - tried_ns < kRetryNs) return;
  tried_ns = now_ns;
  const std::lock_guard lock(file_mutex);
  const std::uint64_t number = next_number;
  const Status done =
      append(ChunkKind::kTicks, chunk_ticks, chunk_t_ns, std::span(chunk).first(chunk_bytes), options.flush);
  failure = done ? std::nullopt : std::optional<Error>(done.error());
  if (next_number > number) {
    written.store(written.load(std::memory_order_relaxed) + chunk_ticks, std::memory_order_relaxed);
    chunk_ticks = 0;
    chunk_bytes = 0;
  }
  failing.store(failure.has_value(), std::memory_order_relaxed);
}

/// Drains the ring and writes the chunk when due.
void Recorder::State::drain() {
  for (;;) {
    int taken = 0;
    while (taken < kRecordsAtOnce && take()) ++taken;
    if (taken == kRecordsAtOnce) continue;
    if (popped_bytes == 0) break;
    write_chunk(false);
    if (chunk_ticks > 0) return;  // write failed: the ring keeps the rest
  }
  if (chunk_ticks > 0 && monotonic_ns() - chunk_begun_ns >= chunk_ns) write_chunk(false);
}

void Recorder::State::write_all() {
  while (!stop.load(std::memory_order_acquire)) {
    drain();
    std::unique_lock lock(wake_mutex);
    wake.wait_for(lock, kLook, [&] { return stop.load(std::memory_order_acquire); });
  }
  do {
    drain();
    write_chunk(true);
  } while (chunk_ticks == 0 && (popped_bytes > 0 || ring.read_available() > 0));
  // The last try failed: the rest is lost.
  std::uint64_t left = chunk_ticks;
  if (popped_bytes > 0) ++left;
  while (pop_tick() > 0) ++left;
  lost.fetch_add(left, std::memory_order_relaxed);
}

Recorder::Recorder(std::unique_ptr<State> state) : state_(std::move(state)) {}

Recorder::~Recorder() {
  static_cast<void>(finish());
}

Result<std::unique_ptr<Recorder>> Recorder::create(const std::string& path, const RecordingHeader& header,
                                                   TickSource& source, const RecorderOptions& options) {
  PALPATE_ASSIGN(std::unique_ptr<RecordingFile> file, make_recording_file(path, options.replace));
  Result<std::unique_ptr<Recorder>> recorder = create(std::move(file), header, source, options);
  if (!recorder) std::remove(path.c_str());
  return recorder;
}

Result<std::unique_ptr<Recorder>> Recorder::create(std::unique_ptr<RecordingFile> file,
                                                   const RecordingHeader& header, TickSource& source,
                                                   const RecorderOptions& options) {
  const std::vector<std::byte> head = encode(header);
  if (head.size() > kMaxPayloadBytes)
    return Error{fmt::format("what the recording says of its session takes {} bytes, and at most {} fit",
                             head.size(), kMaxPayloadBytes),
                 "record a scene whose text is shorter", file->path()};
  std::unique_ptr<Recorder> recorder(new Recorder(std::make_unique<State>(std::move(file), source, options)));
  State& s = *recorder->state_;
  PALPATE_TRY(s.append(ChunkKind::kHeader, 0, 0, head, options.flush));
  s.stop_callback = StopCallback([&s, self = recorder.get()] {
    const Status done = self->finish("stopped");
    return done ? fmt::format("{} holds {} ticks", s.file->path(), self->counts().written)
                : done.error().message();
  });
  s.writer = std::thread([&s] { s.write_all(); });
  return recorder;
}

Result<std::uint16_t> Recorder::add_renderer(const RecordedRenderer& renderer) {
  State& s = *state_;
  const std::lock_guard lock(s.file_mutex);
  const std::uint16_t index = s.renderers;
  const std::vector<std::byte> bytes = encode(index, renderer);
  if (bytes.size() > kMaxPayloadBytes)
    return Error{"the options of this renderer are too long for a recording", "give it shorter ones",
                 renderer.label};
  PALPATE_TRY(s.append(ChunkKind::kRenderer, 0, 0, bytes, s.options.flush));
  ++s.renderers;
  return index;
}

Status Recorder::note(const std::string& text) {
  State& s = *state_;
  const std::lock_guard lock(s.file_mutex);
  return s.append(ChunkKind::kNote, 0, 0, encode_note(text.substr(0, kFullPayloadBytes)), s.options.flush);
}

Status Recorder::add_depth(std::span<const std::byte> bytes) {
  State& s = *state_;
  const std::lock_guard lock(s.file_mutex);
  if (s.closed.load(std::memory_order_relaxed))
    return Error{"the recording has ended", "record anew", s.file->path()};
  const std::size_t parts = (bytes.size() + kDepthPartBytes - 1) / kDepthPartBytes;
  if (parts == 0 || parts > kMostDepthParts)
    return Error{fmt::format("a depth image of {} bytes does not fit a recording", bytes.size()),
                 "record smaller images", s.file->path()};
  std::vector<std::byte> payload;
  for (std::size_t part = 0; part < parts; ++part) {
    const auto piece = bytes.subspan(part * kDepthPartBytes);
    payload.resize(kDepthPartHeadBytes);
    ByteWriter head(payload);
    head.u16(static_cast<std::uint16_t>(part));
    head.u16(static_cast<std::uint16_t>(parts));
    const auto taken = piece.first(std::min(piece.size(), kDepthPartBytes));
    payload.insert(payload.end(), taken.begin(), taken.end());
    PALPATE_TRY(s.append(ChunkKind::kDepth, 0, 0, payload, Flush::kSystem));
  }
  return Done{};
}

void Recorder::took(const Tick& tick) noexcept {
  State& s = *state_;
  RecordedTick& out = s.tick;
  out = RecordedTick{};
  out.t_ns = tick.t_ns;
  out.t_s = tick.t_s;
  out.dt_ns = s.has_tick ? tick.t_ns - s.last_t_ns : 0;
  out.late_ns = tick.due_ns > 0 ? tick.t_ns - tick.due_ns : 0;
  out.exchange_ns = tick.exchange_ns;
  out.rearmed = tick.rearmed;
  out.state = tick.state;
  out.hip_mm = tick.state.position_mm;
  out.sent_n = tick.sent_n;
  out.fault = tick.fault;
  s.source.fill(tick, out);
  out.lost_before = s.lost_pending;
  if (!s.has_tick) s.first_t_ns = tick.t_ns;
  s.last_t_ns = tick.t_ns;
  s.has_tick = true;
  const std::size_t bytes = encode(out, std::span(s.scratch).subspan(kSizeBytes));
  ByteWriter(std::span<std::byte>(s.scratch)).u32(static_cast<std::uint32_t>(bytes));
  if (!s.closed.load(std::memory_order_relaxed) && s.ring.write_available() >= kSizeBytes + bytes) {
    s.ring.push(s.scratch.data(), kSizeBytes + bytes);
    s.lost_pending = 0;
  } else {
    ++s.lost_pending;
    s.lost.fetch_add(1, std::memory_order_relaxed);
  }
  s.ticks.store(s.ticks.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  s.source.recorded();
}

void Recorder::wait_for_room() const {
  const State& s = *state_;
  // The writer fetches megabytes in this time.
  constexpr std::chrono::milliseconds kNap{1};
  while (s.ring.write_available() < s.ring_bytes / 2 && !s.failing.load(std::memory_order_relaxed) &&
         !s.closed.load(std::memory_order_relaxed))
    std::this_thread::sleep_for(kNap);
}

Status Recorder::finish(const std::string& reason) {
  State& s = *state_;
  const std::lock_guard once(s.finish_mutex);
  if (s.finished) return *s.finished;
  s.closed.store(true, std::memory_order_relaxed);
  {
    const std::lock_guard lock(s.wake_mutex);
    s.stop.store(true, std::memory_order_release);
  }
  s.wake.notify_all();
  if (s.writer.joinable()) s.writer.join();
  const RecorderCounts counted = counts();
  const std::lock_guard lock(s.file_mutex);
  Status closed =
      s.append(ChunkKind::kEnd, 0, s.last_t_ns,
               encode(RecordingClose{counted.ticks, counted.written, counted.lost, reason}), Flush::kData);
  if (counted.lost > 0) {
    Error error = !closed ? closed.error() : Error{};
    error.what = fmt::format("{} of {} ticks were lost{}; {:.3g} s are kept", counted.lost, counted.ticks,
                             s.failure ? ": " + s.failure->what : ": the disk was slower than the session",
                             s.seconds_of(counted.written));
    if (error.remedy.empty()) error.remedy = s.failure ? s.failure->remedy : "record to a faster disk";
    error.file = s.file->path();
    closed = error;
  }
  s.finished = closed;
  return closed;
}

RecorderCounts Recorder::counts() const noexcept {
  const State& s = *state_;
  return {s.ticks.load(std::memory_order_relaxed), s.written.load(std::memory_order_relaxed),
          s.lost.load(std::memory_order_relaxed), s.bytes.load(std::memory_order_relaxed)};
}

}  // namespace palpate::device
