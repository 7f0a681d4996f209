// The one way in which a file is opened to be read. Only regular files are: whatever else a name can lead to
// (a folder, a pipe, a device, a socket) has no end that is known, or none at all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "toolkit/core/result.h"

namespace palpate {

/// Memory that reading one file may take unless told otherwise: some 100 million points without faces.
inline constexpr std::uint64_t kMemoryLimitBytes = std::uint64_t{1} << 32;
inline constexpr double kBytesPerGb = 1e9;

/// That `what` would take more than `limit_bytes`, and which option allows more.
[[nodiscard]] Error over_memory_limit(std::string_view what, std::uint64_t limit_bytes);

/// A regular file, open for reading from front to back. Movable, not thread-safe.
class InputFile {
 public:
  /// Missing, unreadable, a folder, a pipe, a device, a socket: each an Error of its own. Never waits, and
  /// what is no regular file is not even opened.
  [[nodiscard]] static Result<InputFile> open(const std::string& path);
  InputFile(InputFile&& other) noexcept;
  InputFile& operator=(InputFile&& other) noexcept;
  ~InputFile();

  /// Fills `out`, or its front where the file ends: 0 only at the end (or for an empty `out`).
  [[nodiscard]] Result<std::size_t> read(std::span<std::byte> out);
  /// Bytes of the file when it was opened.
  [[nodiscard]] std::uint64_t size() const noexcept { return size_; }
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  InputFile(std::string path, int fd, std::uint64_t size) : path_(std::move(path)), fd_(fd), size_(size) {}

  std::string path_;
  int fd_ = -1;
  std::uint64_t size_ = 0;
};

/// The whole of a small file at once; more than `most_bytes` is an Error before anything is read.
[[nodiscard]] Result<std::string> read_file(const std::string& path, std::uint64_t most_bytes);

/// Length of the byte order mark that a text begins with, which belongs to nobody's first line: 3 for UTF-8,
/// else 0. The marks of UTF-16 and UTF-32 are an Error, for no reader understands what follows them.
[[nodiscard]] Result<std::size_t> byte_order_mark(std::string_view text);

}  // namespace palpate
