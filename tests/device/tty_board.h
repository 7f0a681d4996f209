// A board behind a pseudo-terminal: a thread that answers what it reads.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace palpate::device {

class TtyBoard {
 public:
  using Bytes = std::vector<std::uint8_t>;
  /// Called in the board's thread with what has just come.
  using Answer = std::function<Bytes(std::span<const std::uint8_t>)>;

  explicit TtyBoard(Answer answer = {}) : answer_(std::move(answer)) {
    master_ = ::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK);
    ::grantpt(master_);
    ::unlockpt(master_);
    path_ = ::ptsname(master_);
    // Held open, or the line is hung up between two programs.
    held_ = ::open(path_.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);
    termios line{};
    ::tcgetattr(held_, &line);
    ::cfmakeraw(&line);
    ::tcsetattr(held_, TCSANOW, &line);
    thread_ = std::thread([this] { run(); });
  }
  TtyBoard(const TtyBoard&) = delete;
  TtyBoard& operator=(const TtyBoard&) = delete;
  ~TtyBoard() { unplug(); }

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] Bytes received() const {
    const std::lock_guard lock(mutex_);
    return received_;
  }
  void say(const std::string& text) { write_all(Bytes(text.begin(), text.end())); }
  /// Reads nothing from now on: the line fills.
  void stop_reading(bool stopped) { stopped_ = stopped; }
  void unplug() {
    if (master_ < 0) return;
    ending_ = true;
    if (thread_.joinable()) thread_.join();
    ::close(std::exchange(held_, -1));
    ::close(std::exchange(master_, -1));
  }

 private:
  void run() {
    constexpr int kLookMs = 5;
    while (!ending_) {
      pollfd ready{master_, static_cast<short>(stopped_ ? 0 : POLLIN), 0};
      if (::poll(&ready, 1, kLookMs) <= 0 || (ready.revents & POLLIN) == 0) {
        if (stopped_) ::usleep(1000);
        continue;
      }
      std::uint8_t bytes[256];
      const ssize_t got = ::read(master_, bytes, sizeof(bytes));
      if (got <= 0) continue;
      const std::span<const std::uint8_t> came(bytes, static_cast<std::size_t>(got));
      {
        const std::lock_guard lock(mutex_);
        received_.insert(received_.end(), came.begin(), came.end());
      }
      if (answer_) write_all(answer_(came));
    }
  }
  void write_all(const Bytes& bytes) {
    for (std::size_t done = 0; done < bytes.size();) {
      const ssize_t wrote = ::write(master_, bytes.data() + done, bytes.size() - done);
      if (wrote > 0)
        done += static_cast<std::size_t>(wrote);
      else
        ::usleep(100);
      if (ending_) return;
    }
  }

  Answer answer_;
  std::string path_;
  int master_ = -1, held_ = -1;
  mutable std::mutex mutex_;
  Bytes received_;
  std::atomic<bool> stopped_{false}, ending_{false};
  std::thread thread_;
};

}  // namespace palpate::device
