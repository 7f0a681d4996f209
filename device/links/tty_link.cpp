#include "device/links/tty_link.h"

#include <fcntl.h>
#include <glob.h>
#include <linux/serial.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <thread>
#include <utility>

namespace palpate::device {
namespace {

struct Baud {
  unsigned rate;
  speed_t code;
};
constexpr std::array kBauds = {Baud{9600, B9600},     Baud{19200, B19200},   Baud{38400, B38400},
                               Baud{57600, B57600},   Baud{115200, B115200}, Baud{230400, B230400},
                               Baud{460800, B460800}, Baud{921600, B921600}, Baud{1000000, B1000000}};
constexpr useconds_t kDrainStepUs = 1000;
// Writes per call: the rest of one command and a few new ones; more need threads that submit just then.
constexpr int kMaxWrites = 8;

/// 0: unknown rate.
speed_t baud_code(unsigned rate) noexcept {
  for (const Baud& one : kBauds)
    if (one.rate == rate) return one.code;
  return 0;
}

Result<std::string> the_line(const std::string& pattern) {
  const std::vector<TtyFound> found = tty_lines(pattern);
  if (found.empty())
    return Error{"there is no serial line " + pattern,
                 "connect the board; `palpate list devices` shows what is there", pattern};
  if (found.size() > 1) {
    std::string all;
    for (const TtyFound& one : found) all += (all.empty() ? "" : ", ") + one.path;
    return Error{"several serial lines fit " + pattern + ": " + all, "name one by its path", pattern};
  }
  return found.front().path;
}

bool make_raw(int fd, speed_t baud) noexcept {
  termios line{};
  if (::tcgetattr(fd, &line) != 0) return false;
  ::cfmakeraw(&line);
  line.c_cflag |= static_cast<tcflag_t>(CLOCAL | CREAD);
  line.c_cflag &= ~static_cast<tcflag_t>(CRTSCTS | CSTOPB);
  line.c_cc[VMIN] = 1;  // with O_NONBLOCK: EAGAIN means no data, 0 means hung up
  line.c_cc[VTIME] = 0;
  if (::cfsetispeed(&line, baud) != 0 || ::cfsetospeed(&line, baud) != 0) return false;
  return ::tcsetattr(fd, TCSANOW, &line) == 0;
}

/// Some drivers otherwise hold bytes for up to 16 ms. Those without this flag do not: failure is ignored.
void set_low_latency(int fd) noexcept {
  serial_struct serial{};
  if (::ioctl(fd, TIOCGSERIAL, &serial) != 0) return;
  serial.flags = static_cast<int>(static_cast<unsigned>(serial.flags) | ASYNC_LOW_LATENCY);
  ::ioctl(fd, TIOCSSERIAL, &serial);
}

}  // namespace

std::vector<TtyFound> tty_lines(const std::string& pattern) {
  std::vector<TtyFound> all;
  glob_t found{};
  if (::glob(pattern.c_str(), 0, nullptr, &found) == 0)
    for (std::size_t i = 0; i < found.gl_pathc; ++i)
      all.push_back({found.gl_pathv[i], ::access(found.gl_pathv[i], R_OK | W_OK) == 0});
  ::globfree(&found);
  return all;
}

TtyLink::TtyLink(TtyLinkOptions options) : options_(std::move(options)) {}

Status TtyLink::open() {
  close();
  const speed_t baud = baud_code(options_.baud);
  if (baud == 0)
    return Error{std::to_string(options_.baud) + " baud is no rate of a serial line",
                 "give 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600 or 1000000"};
  Result<std::string> path = the_line(options_.path);
  if (!path) return std::move(path).error();
  const int fd = ::open(path->c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) {
    const int why = errno;
    const std::string remedy = why == EACCES  ? std::string(kUdevRemedy) + ", or join the group dialout"
                               : why == EBUSY ? "another program has it: end that one"
                                              : "unplug it and plug it in again";
    return Error{std::string("the serial line cannot be opened: ") + std::strerror(why), remedy, *path};
  }
  ::ioctl(fd, TIOCEXCL);  // exclusive; the next call detects files that are no serial line
  if (!make_raw(fd, baud)) {
    ::close(fd);
    return Error{"this is no serial line", "name the board's, as `palpate list devices` shows it", *path};
  }
  set_low_latency(fd);
  ::tcflush(fd, TCIOFLUSH);
  path_ = *std::move(path);
  newest_.take(left_);  // from before this open
  left_.size = left_from_ = 0;
  fd_ = fd;
  gone_ = false;
  received_ = 0;
  written_ = 0;
  open_.store(true, std::memory_order_release);
  return Done{};
}

void TtyLink::close() noexcept {
  if (!open_.exchange(false)) return;
  // Waits briefly for the current writer, which never blocks. Then sends what others left.
  while (writing_.exchange(true, std::memory_order_acquire)) std::this_thread::yield();
  for (int ms = 0; ms < kDrainMs && !gone_; ++ms) {
    write_while_it_can();
    int queued = 0;
    const bool left = left_from_ < left_.size || !newest_.empty();
    if (!left && (::ioctl(fd_, TIOCOUTQ, &queued) != 0 || queued == 0)) break;
    ::usleep(kDrainStepUs);
  }
  ::ioctl(fd_, TIOCNXCL);
  ::close(std::exchange(fd_, -1));
  writing_.store(false, std::memory_order_release);
}

// The holder of writing_ writes. Others leave their command, which the holder finds after release. Commands
// beyond the bound go with the next poll.
void TtyLink::write_newest() noexcept {
  for (int turn = 0; turn < kMaxWrites; ++turn) {
    if (writing_.exchange(true, std::memory_order_seq_cst)) return;
    const bool usable = fd_ >= 0;
    if (usable) write_while_it_can();
    const bool full = left_from_ < left_.size;
    writing_.store(false, std::memory_order_seq_cst);
    if (full || !usable || newest_.empty() || gone_.load(std::memory_order_relaxed)) return;
  }
}

void TtyLink::write_while_it_can() noexcept {
  for (int turn = 0; turn < kMaxWrites; ++turn) {
    if (left_from_ == left_.size) {
      left_from_ = 0;
      if (!newest_.take(left_)) {
        left_.size = 0;
        return;
      }
    }
    const ssize_t wrote = ::write(fd_, left_.bytes.data() + left_from_, left_.size - left_from_);
    if (wrote > 0) {
      left_from_ += static_cast<std::size_t>(wrote);
      if (left_from_ == left_.size) written_.fetch_add(1, std::memory_order_relaxed);
      continue;
    }
    if (wrote < 0 && errno != EAGAIN && errno != EINTR) gone_.store(true, std::memory_order_relaxed);
    return;
  }
}

bool TtyLink::submit(std::span<const std::uint8_t> bytes) noexcept {
  if (!open_.load(std::memory_order_acquire) || gone_.load(std::memory_order_relaxed)) return false;
  if (!newest_.put(bytes)) return false;
  write_newest();
  return !gone_.load(std::memory_order_relaxed);
}

Polled TtyLink::poll(std::span<std::uint8_t> into) noexcept {
  if (!open_.load(std::memory_order_acquire) || gone_.load(std::memory_order_relaxed)) return {0, true};
  write_newest();
  const ssize_t got = ::read(fd_, into.data(), into.size());
  if (got > 0) {
    received_.fetch_add(1, std::memory_order_relaxed);
    return {static_cast<std::size_t>(got), false};
  }
  if (got < 0 && (errno == EAGAIN || errno == EINTR)) return {0, false};
  gone_.store(true, std::memory_order_relaxed);
  return {0, true};
}

LinkCounters TtyLink::counters() const noexcept {
  return {received_.load(std::memory_order_relaxed), written_.load(std::memory_order_relaxed),
          newest_.replaced()};
}

}  // namespace palpate::device
