// A file as a lock between processes.
#pragma once

#include <string>
#include <utility>

#include "toolkit/core/result.h"

namespace palpate {

/// A file open for reading and writing that nobody else has locked as long as this lives: no other process
/// (its end unlocks, whatever it is; children do not inherit it) and nobody in this one. Movable, not
/// thread-safe.
class LockedFile {
 public:
  LockedFile() noexcept = default;
  LockedFile(LockedFile&& other) noexcept : fd_(other.release()) {}
  LockedFile& operator=(LockedFile&& other) noexcept;
  ~LockedFile();

  /// Made where it is missing. held() is false where another has it. It is the file that has this name while
  /// the lock is had: one that its last owner has renamed or removed is not taken for it. A file system that
  /// knows no locks gives none: there nobody is kept out. An Error where it cannot be opened.
  [[nodiscard]] static Result<LockedFile> open(const std::string& path);

  [[nodiscard]] bool held() const noexcept { return fd_ >= 0; }
  [[nodiscard]] int fd() const noexcept { return fd_; }
  /// The descriptor, to be closed by the caller, which unlocks it.
  [[nodiscard]] int release() noexcept { return std::exchange(fd_, -1); }

 private:
  explicit LockedFile(int fd) noexcept : fd_(fd) {}
  int fd_ = -1;
};

}  // namespace palpate
