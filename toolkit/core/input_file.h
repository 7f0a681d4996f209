// The only way to open files for reading. Accepts regular files only: folders, pipes, devices and sockets
// have no known end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include <palpate/memory_limit.h>
#include <palpate/result.h>

namespace palpate {

inline constexpr double kBytesPerGb = 1e9;

/// The Error that `what` needs more than `limit_bytes`; names the option that raises the limit.
[[nodiscard]] Error over_memory_limit(std::string_view what, std::uint64_t limit_bytes);

/// A regular file, open for sequential reading. Movable, not thread-safe.
class InputFile {
 public:
  /// Missing, unreadable, folder, pipe, device, socket: each has its own Error. Never blocks; other kinds are
  /// not even opened.
  [[nodiscard]] static Result<InputFile> open(const std::string& path);
  InputFile(InputFile&& other) noexcept;
  InputFile& operator=(InputFile&& other) noexcept;
  ~InputFile();

  /// Fills `out`, or its front at the end of the file: 0 only at the end (or for empty `out`).
  [[nodiscard]] Result<std::size_t> read(std::span<std::byte> out);
  /// Size of the file when opened.
  [[nodiscard]] std::uint64_t size() const noexcept { return size_; }
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  InputFile(std::string path, int fd, std::uint64_t size) : path_(std::move(path)), fd_(fd), size_(size) {}

  std::string path_;
  int fd_ = -1;
  std::uint64_t size_ = 0;
};

/// Reads a small file; more than `most_bytes` is an Error before reading.
[[nodiscard]] Result<std::string> read_file(const std::string& path, std::uint64_t most_bytes);

/// Length of a text's byte order mark: 3 for UTF-8, else 0. UTF-16 and UTF-32 are an Error, because no reader
/// supports them.
[[nodiscard]] Result<std::size_t> byte_order_mark(std::string_view text);

}  // namespace palpate
