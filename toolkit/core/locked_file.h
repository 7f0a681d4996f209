// A file as a lock between processes.
#pragma once

#include <string>
#include <utility>

#include <palpate/result.h>

namespace palpate {

/// An open file locked exclusively for its lifetime, against other processes (released when they end; not
/// inherited by children) and within this one. Movable, not thread-safe.
class LockedFile {
 public:
  LockedFile() noexcept = default;
  LockedFile(LockedFile&& other) noexcept : fd_(other.release()) {}
  LockedFile& operator=(LockedFile&& other) noexcept;
  ~LockedFile();

  /// Opens or creates the file. held() is false if another holds it. The lock is on the file currently of
  /// this name, not one that its last owner renamed or removed. File systems without locks exclude nobody. An
  /// Error if it cannot be opened.
  [[nodiscard]] static Result<LockedFile> open(const std::string& path);

  [[nodiscard]] bool held() const noexcept { return fd_ >= 0; }
  [[nodiscard]] int fd() const noexcept { return fd_; }
  /// Gives up the descriptor; closing it unlocks.
  [[nodiscard]] int release() noexcept { return std::exchange(fd_, -1); }

 private:
  explicit LockedFile(int fd) noexcept : fd_(fd) {}
  int fd_ = -1;
};

}  // namespace palpate
