// HID reports through hidapi's hidraw back end: supports Bluetooth, leaves the kernel's driver attached, one
// system call a report.
//
// Reading never waits. A write blocks in hidraw until the device has taken the report, usually one USB frame
// (1 ms), up to 5 s if the device hangs. A separate thread writes, and submit() only stores the newest
// command for it (newest_command.h). The servo never waits, and a zero overtakes a force not yet sent. Cost:
// one thread wake, 10 to 50 us.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <palpate/device/link.h>
#include "device/interface/driver_options.h"

namespace palpate::device {

/// 0 and empty match anything.
struct HidAddress {
  std::uint16_t vendor = 0, product = 0;
  std::uint16_t usage_page = 0, usage = 0;
  std::string serial{};
  std::string path{};  ///< "/dev/hidraw0"
};

struct HidFound {
  std::string path;
  std::uint16_t vendor = 0, product = 0;
  std::uint16_t usage_page = 0, usage = 0;
  std::string serial, maker, product_name;
  bool allowed = false;  ///< this user may read and write it

  /// As "1234:0006 at /dev/hidraw0, serial X".
  [[nodiscard]] std::string text() const;
};

/// Lists matching devices once each, sorted by path. Takes some milliseconds; opens none. Any thread.
[[nodiscard]] std::vector<HidFound> hid_devices(const HidAddress& address = {});

struct HidLinkOptions {
  /// Whether the first byte of each submitted and polled report is its number. Otherwise the link adds the
  /// leading 0 that hidapi requires.
  bool numbered = false;
};

/// Counts since open(), for `palpate list devices --report`.
struct LinkCounters {
  std::uint64_t received = 0;  ///< polls that gave bytes
  std::uint64_t written = 0;   ///< commands taken whole by the kernel
  std::uint64_t replaced = 0;  ///< commands overtaken by a newer one
};

inline void add_link_counts(DeviceFacts& facts, const LinkCounters& counted) {
  add_counts(facts, {{"link_received", counted.received},
                     {"link_commands", counted.written},
                     {"link_commands_overtaken", counted.replaced}});
}

class HidLink final : public Link {
 public:
  explicit HidLink(HidAddress address, const HidLinkOptions& options = {});
  ~HidLink() override;

  /// An Error if no device matches, several match (products may share ids; the message says how to name one),
  /// or this user may not open it.
  [[nodiscard]] Status open() override;
  /// Writes the last submitted command first; waits as long as the kernel does, up to 5 s.
  void close() noexcept override;
  /// Lock-free. True: the writer will send it unless a newer one comes first.
  bool submit(std::span<const std::uint8_t> bytes) noexcept override;
  /// Gives one report a call, cut to into.size(): pass 65 bytes. Two system calls. Allocates once, in hidapi,
  /// when the device is gone.
  [[nodiscard]] Polled poll(std::span<std::uint8_t> into) noexcept override;

  [[nodiscard]] LinkCounters counters() const noexcept;
  /// Empty before open().
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  struct State;
  HidAddress address_;
  HidLinkOptions options_;
  std::string path_;
  std::unique_ptr<State> state_;
};

}  // namespace palpate::device
