// A serial line: USB boards that call themselves one (CDC ACM: Teensy, Arduino), real ports, and the
// pseudo-terminals of tests. Raw, never waiting, as fast as the driver can.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "device/interface/link.h"
#include "device/links/hid_link.h"
#include "device/links/newest_command.h"

namespace palpate::device {

/// One serial line that is there.
struct TtyFound {
  std::string path;      ///< as it was named or found: "/dev/serial/by-id/usb-Teensyduino_USB_Serial_1-if00"
  bool allowed = false;  ///< this user may read and write it
};

/// What `pattern` names, `*` and `?` as in a shell, in the order of names.
[[nodiscard]] std::vector<TtyFound> tty_lines(const std::string& pattern = "/dev/serial/by-id/*");

struct TtyLinkOptions {
  std::string path;        ///< may hold `*`; then exactly one must fit
  unsigned baud = 115200;  ///< one that the system knows; boards on USB ignore it
};

class TtyLink final : public Link {
 public:
  explicit TtyLink(TtyLinkOptions options);
  ~TtyLink() override { close(); }

  /// Raw, exclusive, low latency where the driver knows it; what had come before is dropped. An Error where
  /// nothing or several fit, where the user may not open it or another program has it.
  [[nodiscard]] Status open() override;
  /// Waits up to kDrainMs until what was submitted has left: a USB board's driver drops the rest.
  void close() noexcept override;
  /// Writes at once where it can. A command that the system takes in part is finished before the next one,
  /// and of those that come meanwhile the newest is kept: commands are whole, and the newest is the last.
  /// Lock-free: where another thread is writing, it takes this command along.
  bool submit(std::span<const std::uint8_t> bytes) noexcept override;
  /// One system call; also finishes a command that was taken in part.
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
  // Under writing_: the file, and what is left of a command.
  std::atomic<bool> writing_{false};
  int fd_ = -1;
  CommandBytes left_;
  std::size_t left_from_ = 0;
  std::atomic<bool> open_{false}, gone_{false};
  std::atomic<std::uint64_t> received_{0}, written_{0};
};

}  // namespace palpate::device
