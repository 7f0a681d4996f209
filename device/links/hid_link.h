// Reports of a HID device, through hidapi's hidraw back end: Bluetooth works, nothing is taken from the
// kernel's driver, and a report is one system call.
//
// Reading never waits. Writing does: the kernel's hidraw sends a report and waits until the device has taken
// it, a frame of USB (1 ms) mostly, up to 5 s from one that hangs, and hidapi offers no other way. So a
// thread of its own writes, and submit() only leaves the newest command for it (newest_command.h): the servo
// never waits, and a zero overtakes a force that was not yet sent. It costs the wake of a thread, some 10 to
// 50 us.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "device/interface/link.h"

namespace palpate::device {

/// What a device must be. 0 and empty: anything.
struct HidAddress {
  std::uint16_t vendor = 0, product = 0;
  std::uint16_t usage_page = 0, usage = 0;
  std::string serial{};
  std::string path{};  ///< "/dev/hidraw0"
};

/// One that is there.
struct HidFound {
  std::string path;
  std::uint16_t vendor = 0, product = 0;
  std::uint16_t usage_page = 0, usage = 0;
  std::string serial, maker, product_name;
  bool allowed = false;  ///< this user may read and write it

  /// "1234:0006 at /dev/hidraw0, serial X".
  [[nodiscard]] std::string text() const;
};

/// Those that fit, in the order of their paths, each once. Takes some milliseconds; opens none. Any thread.
[[nodiscard]] std::vector<HidFound> hid_devices(const HidAddress& address = {});

struct HidLinkOptions {
  /// The device numbers its reports: the first byte of what is submitted is the number, as of what is
  /// polled. Otherwise hidapi gets the 0 that it wants before each.
  bool numbered = false;
};

/// What a link did since it was opened, for `palpate devices --report`.
struct LinkCounters {
  std::uint64_t received = 0;  ///< polls that gave bytes
  std::uint64_t written = 0;   ///< commands that the system took whole
  std::uint64_t replaced = 0;  ///< commands that a newer one overtook
};

class HidLink final : public Link {
 public:
  explicit HidLink(HidAddress address, const HidLinkOptions& options = {});
  ~HidLink() override;

  /// An Error where nothing fits, where several do (ids are not always one device's own: it says how to name
  /// one), and where this user may not open it.
  [[nodiscard]] Status open() override;
  /// What was submitted last is written first: waits for it as long as the kernel does, up to 5 s.
  void close() noexcept override;
  /// Lock-free. True: the writer will send it, unless a newer one comes first.
  bool submit(std::span<const std::uint8_t> bytes) noexcept override;
  /// One report a call; what of it does not fit is lost, so give 65 bytes. Two system calls. Allocates only
  /// where the device is gone, in hidapi, once.
  [[nodiscard]] Polled poll(std::span<std::uint8_t> into) noexcept override;

  [[nodiscard]] LinkCounters counters() const noexcept;
  /// Where it was found; empty before open.
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  struct State;
  HidAddress address_;
  HidLinkOptions options_;
  std::string path_;
  std::unique_ptr<State> state_;
};

}  // namespace palpate::device
