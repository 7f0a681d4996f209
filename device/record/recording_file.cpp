#include "device/record/recording_file.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "toolkit/core/at_stop.h"
#include "toolkit/core/locked_file.h"
#include "toolkit/core/try.h"

namespace palpate::device {
namespace {

class DiskFile final : public RecordingFile {
 public:
  DiskFile(std::string path, LockedFile file) : path_(std::move(path)), file_(std::move(file)) {}

  Status append(std::span<const std::byte> bytes) override {
    std::span<const std::byte> rest = bytes;
    while (!rest.empty()) {
      const ssize_t n =
          ::pwrite(file_.fd(), rest.data(), rest.size(), static_cast<off_t>(end_) + done(bytes, rest));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return failed("write", n == 0 ? EIO : errno);
      rest = rest.subspan(static_cast<std::size_t>(n));
    }
    end_ += bytes.size();
    return Done{};
  }

  Status flush(Flush how) override {
    if (how == Flush::kSystem) return Done{};
    // What cannot be synchronised (EINVAL) is no disk: nothing is missing.
    if (::fdatasync(file_.fd()) != 0 && errno != EINVAL && errno != EROFS) return failed("flush", errno);
    return Done{};
  }

  const std::string& path() const noexcept override { return path_; }

 private:
  static off_t done(std::span<const std::byte> all, std::span<const std::byte> rest) {
    return static_cast<off_t>(all.size() - rest.size());
  }
  Status failed(const char* doing, int why) {
    // Half a chunk is taken back, so that what comes next stands where it belongs.
    if (::ftruncate(file_.fd(), static_cast<off_t>(end_)) != 0) {
      // It is written over by the next try, or a torn tail for who reads.
    }
    return Error{fmt::format("cannot {} the recording: {}", doing, std::strerror(why)),
                 why == ENOSPC  ? "free some space on the disk"
                 : why == EFBIG ? "raise the limit of file sizes (ulimit -f), or record for a shorter time"
                                : "check the disk",
                 path_, 0};
  }

  std::string path_;
  LockedFile file_;
  std::uint64_t end_ = 0;
};

}  // namespace

Result<std::unique_ptr<RecordingFile>> make_recording_file(const std::string& path, bool replace) {
  struct stat found {};
  if (::stat(path.c_str(), &found) == 0) {
    if (!S_ISREG(found.st_mode))
      return Error{"cannot record into this: it is no plain file", "give another name", path, 0};
    if (!replace)
      return Error{"a file of this name is there already, and recordings are not replaced unasked",
                   "give another name, or --force to replace it", path, 0};
  }
  Result<LockedFile> locked = LockedFile::open(path);
  if (!locked) return Error{"cannot make the file: " + locked.error().what, locked.error().remedy, path, 0};
  if (!locked->held())
    return Error{"another program is writing this file", "wait for it to end, or give another name", path, 0};
  if (::ftruncate(locked->fd(), 0) != 0)
    return Error{fmt::format("cannot empty the file: {}", std::strerror(errno)), "give another name", path,
                 0};
  return std::unique_ptr<RecordingFile>(std::make_unique<DiskFile>(path, *std::move(locked)));
}

}  // namespace palpate::device
