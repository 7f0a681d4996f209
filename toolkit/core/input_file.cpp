#include "toolkit/core/input_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include <palpate/result.h>

namespace palpate {
namespace {

Error cannot_open(const std::string& path) {
  const int why = errno;
  if (why == ENOENT || why == ENOTDIR) return Error{"no such file", "check the path", path, 0};
  return Error{fmt::format("cannot open the file: {}", std::strerror(why)),
               why == EMFILE || why == ENFILE ? "close other programs" : "check the path and its permissions",
               path, 0};
}

/// Empty for a regular file's mode.
Status check_regular(const std::string& path, mode_t mode) {
  if (S_ISREG(mode)) return Done{};
  if (S_ISDIR(mode)) return Error{"this is a folder, not a file", "name a file inside it", path, 0};
  const char* const what = S_ISFIFO(mode)                   ? "a pipe"
                           : S_ISCHR(mode) || S_ISBLK(mode) ? "a device"
                           : S_ISSOCK(mode)                 ? "a socket"
                                                            : "something else";
  return Error{fmt::format("this is {}, not a regular file", what),
               "save its content to a file, and give that", path, 0};
}

}  // namespace

Error over_memory_limit(std::string_view what, std::uint64_t limit_bytes) {
  return Error{fmt::format("{} would take more than the {} bytes of memory allowed", what, limit_bytes),
               fmt::format("if the file is meant to be this large, give more than --memory-limit-gb {:.3g}; "
                           "else check it, its header above all",
                           static_cast<double>(limit_bytes) / kBytesPerGb),
               {},
               0};
}

Result<InputFile> InputFile::open(const std::string& path) {
  struct stat status {};
  // Checked before opening: opening alone rewinds a tape or blocks on a pipe.
  if (::stat(path.c_str(), &status) != 0) return cannot_open(path);
  PALPATE_TRY(check_regular(path, status.st_mode));
  // O_NONBLOCK in case the name changed meanwhile; no effect on regular files.
  const int fd = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
  if (fd < 0) return cannot_open(path);
  InputFile file(path, fd, 0);
  if (::fstat(fd, &status) != 0) return cannot_open(path);
  PALPATE_TRY(check_regular(path, status.st_mode));
  file.size_ = static_cast<std::uint64_t>(std::max<off_t>(status.st_size, 0));
  return file;
}

InputFile::InputFile(InputFile&& other) noexcept
    : path_(std::move(other.path_)), fd_(std::exchange(other.fd_, -1)), size_(other.size_) {}

InputFile& InputFile::operator=(InputFile&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(fd_, other.fd_);
  std::swap(size_, other.size_);
  return *this;
}

InputFile::~InputFile() {
  if (fd_ >= 0) ::close(fd_);
}

Result<std::size_t> InputFile::read(std::span<std::byte> out) {
  std::size_t have = 0;
  while (have < out.size()) {
    const ssize_t got = ::read(fd_, out.data() + have, out.size() - have);
    if (got == 0) break;
    if (got < 0 && errno == EINTR) continue;
    if (got < 0)
      return Error{fmt::format("cannot read the file: {}", std::strerror(errno)),
                   "check the disk and the path", path_, 0};
    have += static_cast<std::size_t>(got);
  }
  return have;
}

Result<std::string> read_file(const std::string& path, std::uint64_t most_bytes) {
  Result<InputFile> file = InputFile::open(path);
  if (!file) return std::move(file).error();
  // System files report size 0 and hold more; all that arrives counts.
  std::string text(static_cast<std::size_t>(std::min(most_bytes, file->size()) + 1), '\0');
  std::size_t have = 0;
  while (file->size() <= most_bytes) {
    const Result<std::size_t> got = file->read(std::as_writable_bytes(std::span(text).subspan(have)));
    if (!got) return got.error();
    have += *got;
    if (have < text.size()) {
      text.resize(have);
      return text;
    }
    if (have > most_bytes) break;
    text.resize(static_cast<std::size_t>(std::min<std::uint64_t>(2 * std::uint64_t{have}, most_bytes + 1)));
  }
  return Error{fmt::format("the file holds more than {} bytes", most_bytes), "is this the right file?", path,
               0};
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

}  // namespace palpate
