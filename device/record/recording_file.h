// What a recorder appends to: a file on a disk, or what stands for one in a test.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "toolkit/core/result.h"

namespace palpate::device {

/// How far a chunk must be before the next one is written.
enum class Flush : std::uint8_t {
  kSystem,  ///< with the operating system: survives the end of the program, not that of the machine
  kData,    ///< on the disk (fdatasync): survives both
};

/// Append-only. One thread at a time.
class RecordingFile {
 public:
  RecordingFile() = default;
  RecordingFile(const RecordingFile&) = delete;
  RecordingFile& operator=(const RecordingFile&) = delete;
  virtual ~RecordingFile() = default;

  /// All of it or nothing: what was written of a failure is taken back. May wait for the disk. An Error may
  /// pass: the same bytes can be tried again.
  [[nodiscard]] virtual Status append(std::span<const std::byte> bytes) = 0;
  [[nodiscard]] virtual Status flush(Flush how) = 0;
  [[nodiscard]] virtual const std::string& path() const noexcept = 0;
};

/// Makes it; nobody else can write it meanwhile. A file that is there is an Error unless `replace`.
[[nodiscard]] Result<std::unique_ptr<RecordingFile>> make_recording_file(const std::string& path,
                                                                         bool replace = false);

}  // namespace palpate::device
