// A recording, read tick by tick from front to back. Every byte is checked; memory is some megabytes whatever
// the file claims. The layout: docs/recordings.md.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "device/record/recorded_tick.h"
#include "device/record/recording_header.h"
#include "toolkit/core/result.h"

namespace palpate::device {

/// Fills its argument, or its front where there is no more: 0 only at the end.
using RecordingBytes = std::function<Result<std::size_t>(std::span<std::byte>)>;

struct ReadRecordingOptions {
  /// Reads on behind what is damaged in the middle, and says what is missing. Otherwise that is an Error. A
  /// torn tail is none: a crash leaves one.
  bool skip_damaged = false;
};

/// Bytes that are no chunk.
struct DamagedBytes {
  std::uint64_t at = 0, bytes = 0;
};

/// What is known at the end.
struct RecordingEnd {
  bool closed = false;      ///< the recorder came to its end
  std::string reason;       ///< why the session ended, where it is closed
  std::uint64_t ticks = 0;  ///< that were read
  std::uint64_t lost = 0;   ///< that the recorder lost; the last ones are known only of one that is closed
  std::uint64_t torn_at = 0, torn_bytes = 0;  ///< the tail that was dropped; 0: none
  std::vector<DamagedBytes> damaged;          ///< that was read past
  std::int64_t first_ns = 0, last_ns = 0;     ///< times of the first and the last tick

  /// What a person must know of it, whole sentences; empty where nothing is missing.
  [[nodiscard]] std::vector<std::string> warnings() const;
};

/// Movable, not thread-safe.
class Recording {
 public:
  [[nodiscard]] static Result<Recording> open(const std::string& path,
                                              const ReadRecordingOptions& options = {});
  /// The same of any bytes; `name` stands in messages.
  [[nodiscard]] static Result<Recording> open(RecordingBytes bytes, const std::string& name,
                                              const ReadRecordingOptions& options = {});
  Recording(Recording&&) noexcept;
  Recording& operator=(Recording&&) noexcept;
  ~Recording();

  [[nodiscard]] const RecordingHeader& header() const noexcept;
  /// Those that were met so far: all that the ticks read refer to.
  [[nodiscard]] const std::vector<RecordedRenderer>& renderers() const noexcept;
  /// Likewise.
  [[nodiscard]] const std::vector<std::string>& notes() const noexcept;

  /// The next tick: true; its calls stay until the next call. False at the end. Times never go back. Errors
  /// name the byte.
  [[nodiscard]] Result<bool> next(RecordedTick& tick);
  /// After next() has answered false.
  [[nodiscard]] const RecordingEnd& end() const noexcept;

 private:
  struct State;
  explicit Recording(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Whether a file begins as recordings do; false as well where it cannot be read.
[[nodiscard]] bool is_recording(const std::string& path);

}  // namespace palpate::device
