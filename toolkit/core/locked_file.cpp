#include "toolkit/core/locked_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace palpate {

LockedFile& LockedFile::operator=(LockedFile&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}

LockedFile::~LockedFile() {
  if (fd_ >= 0) ::close(fd_);
}

Result<LockedFile> LockedFile::open(const std::string& path) {
  constexpr int kTries = 16;  // each retry means another owner finished in between, which is rare
  for (int i = 0; i < kTries; ++i) {
    LockedFile file(::open(path.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666));
    if (!file.held()) {
      const int why = errno;
      return Error{std::strerror(why),
                   why == ENOSPC   ? "free some space on the disk"
                   : why == ENOENT ? "create the folder first"
                                   : "check the path and its permissions",
                   path, 0};
    }
    if (::flock(file.fd(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) break;
    struct stat mine {
    }, there{};
    if (::fstat(file.fd(), &mine) == 0 && ::stat(path.c_str(), &there) == 0 && mine.st_ino == there.st_ino &&
        mine.st_dev == there.st_dev)
      return file;
  }
  return LockedFile();
}

}  // namespace palpate
