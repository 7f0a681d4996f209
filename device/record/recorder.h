// Writes every tick of a servo to a file while the loop runs, and never makes the loop wait.
//
//   servo thread    took(): encodes the tick into a ring of bytes and goes on. No allocation, lock or system
//                   call; bounded by kMostBytesATick. Where the ring is full the tick is lost and counted.
//   writer thread   takes ticks out, appends them in checksummed chunks of a quarter of a second, each
//                   flushed to the disk. What cannot be written now (disk full) is tried again as long as the
//                   ring has room. What was lost is in the file, before the next tick that was not.
//
// A crash loses what was not in a whole chunk: a chunk and what the writer had not fetched, less than a
// second unless the disk stands still. The layout of the file: docs/recordings.md.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "device/record/recording_file.h"
#include "device/record/recording_header.h"
#include "device/record/tick_source.h"
#include "device/servo/tick_observer.h"
#include "toolkit/core/result.h"

namespace palpate::device {

struct RecorderOptions {
  /// Of the ring: 50 s of one renderer at 1 kHz, 2 s of eight at 8 kHz. Touched once when it is made.
  std::size_t ring_bytes = std::size_t{16} << 20;
  double chunk_s = 0.25;  ///< of servo time in one chunk, and the longest that a tick waits for it
  Flush flush = Flush::kData;
  bool replace = false;  ///< a file that is there
};

/// Counts of the whole recording. ticks = written + lost, once it is finished.
struct RecorderCounts {
  std::uint64_t ticks = 0;    ///< that took() saw
  std::uint64_t written = 0;  ///< in chunks that are in the file
  std::uint64_t lost = 0;     ///< the ring was full, or the file could not be written to the end
  std::uint64_t bytes = 0;    ///< of the file
};

class Recorder final : public TickObserver {
 public:
  /// Writes the header and starts the writer. The source is referred to. Errors of the file: it is there
  /// already, cannot be made, the disk is full or read-only.
  [[nodiscard]] static Result<std::unique_ptr<Recorder>> create(const std::string& path,
                                                                const RecordingHeader& header,
                                                                TickSource& source,
                                                                const RecorderOptions& options = {});
  /// The same into something that is no file on a disk: tests.
  [[nodiscard]] static Result<std::unique_ptr<Recorder>> create(std::unique_ptr<RecordingFile> file,
                                                                const RecordingHeader& header,
                                                                TickSource& source,
                                                                const RecorderOptions& options = {});
  /// finish(), whose failure nobody sees then.
  ~Recorder() override;

  /// A renderer that will be tracked: its index in the table. Any thread but the servo's; before the first
  /// tick that refers to it. Waits for the disk.
  [[nodiscard]] Result<std::uint16_t> add_renderer(const RecordedRenderer& renderer);
  /// A remark with the time, such as a change of the mapping. As add_renderer().
  [[nodiscard]] Status note(const std::string& text);

  /// In the servo thread.
  void took(const Tick& tick) noexcept override;

  /// Where time is not real: waits until the ring is half empty, or the file cannot be written. Never in a
  /// servo of real time.
  void wait_for_room() const;

  /// Writes the rest, says why the session ended, and closes. No tick may come any more. An Error where
  /// anything was lost: how much, and why. Any thread; the second time it answers what it did the first time.
  [[nodiscard]] Status finish(const std::string& reason = "ended");

  /// So far. Any thread.
  [[nodiscard]] RecorderCounts counts() const noexcept;

 private:
  struct State;
  explicit Recorder(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace palpate::device
