#include "toolkit/core/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>

#include <palpate/result.h>

namespace palpate {
namespace {

Error cannot_open(const std::string& path) {
  const int why = errno;
  if (why == ENOENT || why == ENOTDIR) return Error{"no such file", "check the path", path};
  return Error{fmt::format("cannot open the file: {}", std::strerror(why)),
               why == EMFILE || why == ENFILE ? "close other programs" : "check the path and its permissions",
               path};
}

/// Empty for a regular file's mode.
Status check_regular(const std::string& path, mode_t mode) {
  if (S_ISREG(mode)) return Done{};
  if (S_ISDIR(mode)) return Error{"this is a folder, not a file", "name a file inside it", path};
  const char* const what = S_ISFIFO(mode)                   ? "a pipe"
                           : S_ISCHR(mode) || S_ISBLK(mode) ? "a device"
                           : S_ISSOCK(mode)                 ? "a socket"
                                                            : "something else";
  return Error{fmt::format("this is {}, not a regular file", what),
               "save its content to a file, and give that", path};
}

const char* remedy_for(int why) {
  return why == ENOSPC   ? "free some space on the disk"
         : why == ENOENT ? "create the folder first"
                         : "check the path and its permissions";
}

std::string part_of(const std::string& path) {
  return path + ".part";
}

Error cannot(const std::string& path, const char* doing) {
  const int why = errno;
  return Error{fmt::format("cannot {} the file: {}", doing, std::strerror(why)), remedy_for(why), path};
}

}  // namespace

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  if (this == &other) return *this;
  close();
  fd_ = other.release();
  return *this;
}

void Descriptor::close() noexcept {
  if (fd_ >= 0) ::close(std::exchange(fd_, -1));
}

Result<InputFile> InputFile::open(const std::string& path) {
  struct stat status {};
  // Checked before opening: opening alone rewinds a tape or blocks on a pipe.
  if (::stat(path.c_str(), &status) != 0) return cannot_open(path);
  PALPATE_TRY(check_regular(path, status.st_mode));
  // O_NONBLOCK in case the name changed meanwhile; no effect on regular files.
  Descriptor opened(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC));
  if (!opened.is_open() || ::fstat(opened.get(), &status) != 0) return cannot_open(path);
  PALPATE_TRY(check_regular(path, status.st_mode));
  InputFile file(path, std::move(opened));
  file.size_ = static_cast<std::uint64_t>(std::max<off_t>(status.st_size, 0));
  return file;
}

Result<std::size_t> InputFile::read(std::span<std::byte> out) {
  std::size_t have = 0;
  while (have < out.size()) {
    const ssize_t got = ::read(file_.get(), out.data() + have, out.size() - have);
    if (got == 0) break;
    if (got < 0 && errno == EINTR) continue;
    if (got < 0)
      return Error{fmt::format("cannot read the file: {}", std::strerror(errno)),
                   "check the disk and the path", path_};
    have += static_cast<std::size_t>(got);
  }
  return have;
}

Status InputFile::read_at(std::uint64_t offset, std::span<std::byte> out) const {
  std::size_t have = 0;
  while (have < out.size()) {
    const ssize_t got =
        ::pread(file_.get(), out.data() + have, out.size() - have, static_cast<off_t>(offset + have));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0)
      return Error{fmt::format("cannot read the file: {}", std::strerror(errno)),
                   "check the disk and the path", path_};
    if (got == 0)
      return Error{
          fmt::format("the file ends at byte {}, {} more are needed", offset + have, out.size() - have),
          "the file is cut short: copy it again", path_};
    have += static_cast<std::size_t>(got);
  }
  return Done{};
}

std::vector<std::byte> first_bytes(const std::string& path) {
  std::vector<std::byte> first(8);
  const Result<InputFile> file = InputFile::open(path);
  if (!file || file->size() < first.size() || !file->read_at(0, first)) first.clear();
  return first;
}

Result<std::string> read_file(const std::string& path, std::uint64_t most_bytes) {
  PALPATE_ASSIGN(InputFile file, InputFile::open(path));
  // System files report size 0 and hold more; all that arrives counts.
  std::string text(static_cast<std::size_t>(std::min(most_bytes, file.size()) + 1), '\0');
  std::size_t have = 0;
  while (file.size() <= most_bytes) {
    PALPATE_ASSIGN(const std::size_t got, file.read(std::as_writable_bytes(std::span(text).subspan(have))));
    have += got;
    if (have < text.size()) {
      text.resize(have);
      return text;
    }
    if (have > most_bytes) break;
    text.resize(static_cast<std::size_t>(std::min<std::uint64_t>(2 * std::uint64_t{have}, most_bytes + 1)));
  }
  return Error{fmt::format("the file holds more than {} bytes", most_bytes), "is this the right file?", path};
}

Result<std::size_t> byte_order_mark(std::string_view text) {
  using namespace std::string_view_literals;
  constexpr std::string_view kUtf8 = "\xEF\xBB\xBF";
  if (text.starts_with(kUtf8)) return kUtf8.size();
  // Little-endian UTF-32 begins like UTF-16.
  for (const auto& [mark, name] :
       {std::pair("\xFF\xFE\0\0"sv, "UTF-32"), std::pair("\0\0\xFE\xFF"sv, "UTF-32"),
        std::pair("\xFF\xFE"sv, "UTF-16"), std::pair("\xFE\xFF"sv, "UTF-16")})
    if (text.starts_with(mark))
      return Error{fmt::format("the text is {}", name), "save it as UTF-8 or ASCII", {}, 1};
  return std::size_t{0};
}

Result<AtomicFile> AtomicFile::create(std::string path) {
  const auto hold = block_stop();
  Result<LockedFile> locked = LockedFile::open(part_of(path));
  if (!locked) return Error{"cannot create the file: " + locked.error().what, locked.error().remedy, path};
  if (!locked->held())
    return Error{"another program is writing this file", "wait for it to end, or give another name", path};
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
  if (!file_) return error_.what.empty() ? Error{"the file is complete already", {}, path_} : error_;
  if (!data.empty() && std::fwrite(data.data(), 1, data.size(), file_.get()) != data.size())
    return fail("write");
  return Done{};
}

Status AtomicFile::commit() {
  if (!file_) return error_.what.empty() ? Error{"the file is complete already", {}, path_} : error_;
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
  PALPATE_ASSIGN(AtomicFile file, AtomicFile::create(path));
  PALPATE_TRY(file.write(text));
  return file.commit();
}

Result<LockedFile> LockedFile::open(const std::string& path) {
  constexpr int kTries = 16;  // each retry means another owner finished in between, which is rare
  for (int i = 0; i < kTries; ++i) {
    LockedFile file(::open(path.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666));
    if (!file.held()) {
      const int why = errno;
      return Error{std::strerror(why), remedy_for(why), path};
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

std::filesystem::path cache_folder() {
  if (const char* cache = std::getenv("XDG_CACHE_HOME"); cache != nullptr && *cache == '/')
    return std::filesystem::path(cache) / "palpate";
  if (const char* home = std::getenv("HOME"); home != nullptr && *home != '\0')
    return std::filesystem::path(home) / ".cache" / "palpate";
  return {};
}

}  // namespace palpate
