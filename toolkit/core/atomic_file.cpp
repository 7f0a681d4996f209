#include "toolkit/core/atomic_file.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include <palpate/result.h>
#include "toolkit/core/locked_file.h"

namespace palpate {
namespace {

std::string part_of(const std::string& path) {
  return path + ".part";
}

Error cannot(const std::string& path, const char* doing) {
  const int why = errno;
  return Error{fmt::format("cannot {} the file: {}", doing, std::strerror(why)),
               why == ENOSPC   ? "free some space on the disk"
               : why == ENOENT ? "create the folder first"
                               : "check the path and its permissions",
               path, 0};
}

}  // namespace

Result<AtomicFile> AtomicFile::create(std::string path) {
  const auto hold = block_stop();
  Result<LockedFile> locked = LockedFile::open(part_of(path));
  if (!locked) return Error{"cannot create the file: " + locked.error().what, locked.error().remedy, path, 0};
  if (!locked->held())
    return Error{"another program is writing this file", "wait for it to end, or give another name", path, 0};
  // Clears what a killed writer left.
  std::FILE* file = ::ftruncate(locked->fd(), 0) == 0 ? ::fdopen(locked->fd(), "wb") : nullptr;
  if (file == nullptr) return cannot(path, "create");
  (void)locked->release();  // the stream closes it
  StopCallback stop_callback([part = part_of(path)] {
    std::remove(part.c_str());
    return std::string();
  });
  return AtomicFile(std::move(path), file, std::move(stop_callback));
}

AtomicFile& AtomicFile::operator=(AtomicFile&& other) noexcept {
  if (this != &other) {
    discard();
    path_ = std::move(other.path_);
    file_ = std::move(other.file_);
    stop_callback_ = std::move(other.stop_callback_);
    error_ = std::move(other.error_);
  }
  return *this;
}

AtomicFile::~AtomicFile() {
  discard();
}

void AtomicFile::discard() noexcept {
  if (!file_) return;
  // create() made the same path, so it fits. Removed before unlocking.
  std::remove(part_of(path_).c_str());
  file_.reset();
  stop_callback_.drop();
}

Error AtomicFile::fail(const char* doing) {
  error_ = cannot(path_, doing);
  discard();
  return error_;
}

Status AtomicFile::write(std::string_view text) {
  return write(std::as_bytes(std::span(text)));
}

Status AtomicFile::write(std::span<const std::byte> data) {
  if (!file_) return error_.what.empty() ? Error{"the file is complete already", {}, path_, 0} : error_;
  if (!data.empty() && std::fwrite(data.data(), 1, data.size(), file_.get()) != data.size())
    return fail("write");
  return Done{};
}

Status AtomicFile::commit() {
  if (!file_) return error_.what.empty() ? Error{"the file is complete already", {}, path_, 0} : error_;
  if (std::fflush(file_.get()) != 0) return fail("write");
  // Without it a power cut after the rename could leave an empty file. Pipes and the like cannot be
  // synchronised (EINVAL), which is no failure.
  if (fsync(fileno(file_.get())) != 0 && errno != EINVAL && errno != EROFS) return fail("write");
  if (std::rename(part_of(path_).c_str(), path_.c_str()) != 0) return fail("rename");
  stop_callback_.drop();
  if (std::fclose(file_.release()) != 0) {
    error_ = cannot(path_, "close");
    return error_;
  }
  return Done{};
}

Status write_file(const std::string& path, std::string_view text) {
  Result<AtomicFile> file = AtomicFile::create(path);
  if (!file) return std::move(file).error();
  PALPATE_TRY(file->write(text));
  return file->commit();
}

}  // namespace palpate
