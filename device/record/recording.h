// Reads a recording tick by tick. Every byte is checked; memory stays at some megabytes whatever the file
// claims. Layout: docs/reference/documents.md.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <palpate/result.h>
#include "device/record/recording_header.h"

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
  /// After next() returned false.
  [[nodiscard]] const RecordingEnd& end() const noexcept;

 private:
  struct State;
  explicit Recording(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Whether the file begins like a recording; false if it cannot be read.
[[nodiscard]] bool is_recording(const std::string& path);

}  // namespace palpate::device
