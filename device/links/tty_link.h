// A non-blocking raw serial line in low-latency mode: USB CDC ACM boards (Teensy, Arduino), real ports,
// pseudo-terminals in tests.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include <palpate/device/link.h>
#include "device/links/hid_link.h"
#include "device/links/newest_command.h"

namespace palpate::device {

struct TtyFound {
  std::string path;      ///< as named or found: "/dev/serial/by-id/usb-Teensyduino_USB_Serial_1-if00"
  bool allowed = false;  ///< this user may read and write it
};

/// Lists the lines that match `pattern` (`*` and `?` as in a shell), sorted by name.
[[nodiscard]] std::vector<TtyFound> tty_lines(const std::string& pattern = "/dev/serial/by-id/*");

struct TtyLinkOptions {
  std::string path;        ///< may contain `*`; exactly one line must match
  unsigned baud = 115200;  ///< a standard rate; USB boards ignore it
};

class TtyLink final : public Link {
 public:
  explicit TtyLink(TtyLinkOptions options);
  ~TtyLink() override { close(); }

  /// Opens the line raw, exclusive and with low latency if supported; discards earlier input. An Error if
  /// none or several match, the user may not open it, or another program has it.
  [[nodiscard]] Status open() override;
  /// Waits up to kDrainMs until the last command is out: a USB board's driver drops the rest.
  void close() noexcept override;
  /// Writes immediately if possible. A partly written command is finished first; of those that arrive
  /// meanwhile the newest is kept. Commands are whole, and the newest is last. Lock-free: a thread already
  /// writing sends this command too.
  bool submit(std::span<const std::uint8_t> bytes) noexcept override;
  /// One system call; also finishes a partly written command.
  [[nodiscard]] Polled poll(std::span<std::uint8_t> into) noexcept override;

  [[nodiscard]] LinkCounters counters() const noexcept;
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

  static constexpr int kDrainMs = 50;

 private:
  void write_newest() noexcept;
  void write_while_it_can() noexcept;

  TtyLinkOptions options_;
  std::string path_;
  NewestCommand newest_;
  // Guarded by writing_: the file and the rest of a command.
  std::atomic<bool> writing_{false};
  int fd_ = -1;
  CommandBytes left_;
  std::size_t left_from_ = 0;
  std::atomic<bool> open_{false}, gone_{false};
  std::atomic<std::uint64_t> received_{0}, written_{0};
};

}  // namespace palpate::device
