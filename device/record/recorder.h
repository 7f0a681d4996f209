// Records every servo tick; the loop never waits.
//
//   servo thread    took() encodes the tick into a ring of bytes. No allocation, lock or system call; bounded
//                   by kMaxBytesATick. A full ring loses the tick and counts it.
//   writer thread   appends ticks in checksummed chunks of a quarter of a second, each flushed to the disk.
//                   Failed writes (disk full) are tried again while the ring has room. Losses are noted in
//                   the file before the next tick.
//
// A crash loses the unfinished chunk and what the writer had not fetched: less than a second, unless the disk
// stalls. File layout: docs/reference/documents.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include <palpate/device/servo.h>
#include <palpate/result.h>
#include "device/record/recording_header.h"
#include "device/record/tick_source.h"

namespace palpate::device {

// The append-only output of a recorder: a disk file, or a stand-in in tests.

/// Place that a chunk must reach before the next is written.
enum class Flush : std::uint8_t {
  kSystem,  ///< in the operating system: survives a crash of the program, not of the machine
  kData,    ///< on the disk (fdatasync): survives both
};

/// Append-only. One thread at a time.
class RecordingFile {
 public:
  RecordingFile() = default;
  RecordingFile(const RecordingFile&) = delete;
  RecordingFile& operator=(const RecordingFile&) = delete;
  virtual ~RecordingFile() = default;

  /// Appends all or nothing: a failed write is undone. The call may wait for the disk. After an Error the
  /// same bytes can be tried again.
  [[nodiscard]] virtual Status append(std::span<const std::byte> bytes) = 0;
  [[nodiscard]] virtual Status flush(Flush how) = 0;
  [[nodiscard]] virtual const std::string& path() const noexcept = 0;
};

/// Creates the file and locks out other writers. An existing file is an Error unless `replace`.
[[nodiscard]] Result<std::unique_ptr<RecordingFile>> make_recording_file(const std::string& path,
                                                                         bool replace = false);

struct RecorderOptions {
  /// Ring size: 50 s of one renderer at 1 kHz, 2 s of eight at 8 kHz. Touched once at creation.
  std::size_t ring_bytes = std::size_t{16} << 20;
  double chunk_s = 0.25;  ///< servo time per chunk, and the longest that a tick waits for it
  Flush flush = Flush::kData;
  bool replace = false;  ///< overwrite an existing file
  bool depth = false;    ///< add_depth() will be called
};

/// Counts of the whole recording. After finish(), ticks = written + lost.
struct RecorderCounts {
  std::uint64_t ticks = 0;
  std::uint64_t written = 0;  ///< in chunks in the file
  std::uint64_t lost = 0;     ///< ring full, or file not written to the end
  std::uint64_t bytes = 0;    ///< of the file
};

class Recorder final : public TickObserver {
 public:
  /// Writes the header and starts the writer. Keeps a reference to the source. An Error if the file exists or
  /// cannot be made, or the disk is full or read-only.
  [[nodiscard]] static Result<std::unique_ptr<Recorder>> create(const std::string& path,
                                                                const RecordingHeader& header,
                                                                TickSource& source,
                                                                const RecorderOptions& options = {});
  /// The same with any RecordingFile, for tests.
  [[nodiscard]] static Result<std::unique_ptr<Recorder>> create(std::unique_ptr<RecordingFile> file,
                                                                const RecordingHeader& header,
                                                                TickSource& source,
                                                                const RecorderOptions& options = {});
  /// Calls finish() and ignores its Status.
  ~Recorder() override;

  /// Adds a renderer to be tracked; returns its table index. Any thread but the servo's, before the first
  /// tick that refers to it. Waits for the disk.
  [[nodiscard]] Result<std::uint16_t> add_renderer(const RecordedRenderer& renderer);
  /// Adds a remark with the time, such as a change of the mapping. Conditions as for add_renderer().
  [[nodiscard]] Status note(const std::string& text);

  /// Adds a depth image or its camera, as encoded by stream::depth_codec. Needs RecorderOptions::depth. Any
  /// thread but the servo's; waits for the system, not for the disk.
  [[nodiscard]] Status add_depth(std::span<const std::byte> bytes);

  /// Servo thread.
  void took(const Tick& tick) noexcept override;

  /// For virtual time only: waits until the ring is half empty or writing fails. A real-time servo must not
  /// call it.
  void wait_for_room() const;

  /// Writes the rest and the reason of the end, and closes. No tick may follow. An Error says how much was
  /// lost and why. Any thread; a second call returns the first result.
  [[nodiscard]] Status finish(const std::string& reason = "ended");

  /// Counts so far. Any thread.
  [[nodiscard]] RecorderCounts counts() const noexcept;

 private:
  struct State;
  explicit Recorder(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace palpate::device
