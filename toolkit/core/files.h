// Files: reading regular ones only, writing them completely or not at all, locking them between processes,
// and the folder for what can be made again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <palpate/progress.h>
#include <palpate/result.h>

namespace palpate {

/// An open file descriptor, closed with this object; -1: none.
class Descriptor {
 public:
  Descriptor() noexcept = default;
  explicit Descriptor(int fd) noexcept : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(other.release()) {}
  Descriptor& operator=(Descriptor&& other) noexcept;
  ~Descriptor() { close(); }

  void close() noexcept;
  [[nodiscard]] bool is_open() const noexcept { return fd_ >= 0; }
  [[nodiscard]] int get() const noexcept { return fd_; }
  /// Gives up the descriptor without closing it.
  [[nodiscard]] int release() noexcept { return std::exchange(fd_, -1); }

 private:
  int fd_ = -1;
};

/// A regular file, open for sequential reading; the only way to open files for reading. Folders, pipes,
/// devices and sockets are refused: they have no known end. Movable, not thread-safe.
class InputFile {
 public:
  /// Missing, unreadable, folder, pipe, device, socket: each has its own Error. Never blocks; other kinds are
  /// not even opened.
  [[nodiscard]] static Result<InputFile> open(const std::string& path);

  /// Fills `out`, or its front at the end of the file: 0 only at the end (or for empty `out`).
  [[nodiscard]] Result<std::size_t> read(std::span<std::byte> out);
  /// Fills all of `out` from `offset`, or an Error; does not move where read() stands. Thread-safe.
  [[nodiscard]] Status read_at(std::uint64_t offset, std::span<std::byte> out) const;
  /// Size of the file when opened.
  [[nodiscard]] std::uint64_t size() const noexcept { return size_; }
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  InputFile(std::string path, Descriptor file) noexcept : path_(std::move(path)), file_(std::move(file)) {}

  std::string path_;
  Descriptor file_;
  std::uint64_t size_ = 0;
};

/// A file's first eight bytes, which tell many formats apart; empty where it is shorter or cannot be read.
[[nodiscard]] std::vector<std::byte> first_bytes(const std::string& path);

/// Reads a small file; more than `most_bytes` is an Error before reading.
[[nodiscard]] Result<std::string> read_file(const std::string& path, std::uint64_t most_bytes);

/// Length of a text's byte order mark: 3 for UTF-8, else 0. UTF-16 and UTF-32 are an Error, because no reader
/// supports them.
[[nodiscard]] Result<std::size_t> byte_order_mark(std::string_view text);

/// Writes PATH.part. commit() renames it to PATH, replacing any file; destruction without commit(), or a stop
/// of the program, removes it. After an Error nothing more is written and commit() returns that Error.
/// Movable, not thread-safe. A second writer of the path, in any process, is refused.
class AtomicFile {
 public:
  /// The folder must exist.
  [[nodiscard]] static Result<AtomicFile> create(std::string path);
  AtomicFile(AtomicFile&&) noexcept = default;
  AtomicFile& operator=(AtomicFile&& other) noexcept;
  ~AtomicFile();

  Status write(std::string_view text);
  Status write(std::span<const std::byte> data);
  /// Flushes to the disk, closes and renames.
  Status commit();
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  struct Close {
    void operator()(std::FILE* file) const noexcept { std::fclose(file); }
  };
  AtomicFile(std::string path, std::FILE* file, StopCallback stop_callback)
      : path_(std::move(path)), file_(file), stop_callback_(std::move(stop_callback)) {}
  void discard() noexcept;
  Error fail(const char* doing);

  std::string path_;
  std::unique_ptr<std::FILE, Close> file_;  ///< null once committed, discarded or moved from
  StopCallback stop_callback_;
  Error error_{};
};

/// Writes a small file at once.
Status write_file(const std::string& path, std::string_view text);

/// An open file locked exclusively for its lifetime, against other processes (released when they end; not
/// inherited by children) and within this one. Movable, not thread-safe.
class LockedFile {
 public:
  LockedFile() noexcept = default;

  /// Opens or creates the file. held() is false if another holds it. The lock is on the file currently of
  /// this name, not one that its last owner renamed or removed. File systems without locks exclude nobody. An
  /// Error if it cannot be opened.
  [[nodiscard]] static Result<LockedFile> open(const std::string& path);

  [[nodiscard]] bool held() const noexcept { return file_.is_open(); }
  [[nodiscard]] int fd() const noexcept { return file_.get(); }
  /// Gives up the descriptor; closing it unlocks.
  [[nodiscard]] int release() noexcept { return file_.release(); }

 private:
  explicit LockedFile(int fd) noexcept : file_(fd) {}
  Descriptor file_;
};

/// The folder for data that can be made or fetched again: $XDG_CACHE_HOME/palpate, or ~/.cache/palpate; empty
/// if neither variable is set. The folder is not created.
[[nodiscard]] std::filesystem::path cache_folder();

}  // namespace palpate
