// A device on USB, through libusb-1.0: packets in and out by two bulk or interrupt endpoints.
//
// libusb allocates and locks in every submission of a transfer, so no frame may call it. A thread of the
// link's own does: it keeps two 64-byte IN transfers queued, sends the newest command that submit() has left,
// and puts what comes into a ring. Frames touch that command's place, the ring and an eventfd, nothing else.
//
// One command is with the kernel at a time, for nothing can be put before what the kernel has; meanwhile a
// newer one overtakes the one that waits. But one that lets the motors go does not wait for news of the one
// before it: it is handed over at once. So a zero has one packet before it at most, however slow the device
// is. A controller that tells of a packet at the end of its frame alone (UHCI, OHCI) takes every second
// command of 1 kHz; the newest, each time. Who needs every command taken waits for its answer before the
// next. Nothing is sent twice. A program that is being stopped waits until what was submitted before is out
// (at_stop.h), 0.1 s at most.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "device/links/control_link.h"
#include "device/links/newest_command.h"
#include "device/links/packet_ring.h"
#include "toolkit/core/at_stop.h"

namespace palpate::device {

/// Which device is meant.
struct UsbAddress {
  std::uint16_t vendor = 0, product = 0;
  std::string serial;  ///< empty: the first that is found
};

struct UsbInterface {
  int number = 0;
  std::uint8_t in = 0x81, out = 0x02;  ///< endpoints
};

/// A device that is connected.
struct UsbFound {
  int bus = 0, address = 0;
  bool may_open = false;  ///< this user may
};
/// What is connected, without opening it; empty too where the machine has no USB. Some milliseconds.
[[nodiscard]] std::vector<UsbFound> usb_devices(std::uint16_t vendor, std::uint16_t product);

/// The udev rule that lets whoever sits at the machine open a device, for people to copy.
[[nodiscard]] std::string usb_udev_rule(std::uint16_t vendor, std::uint16_t product);

/// For a guard process: opens the device anew, claims it, sends these bytes once, lets go. May wait as long
/// as `wait_ms`. Not for a process that has the device open.
enum class UsbSent : std::uint8_t { kSent, kAbsent, kRefused };
[[nodiscard]] UsbSent usb_send_once(const UsbAddress& address, const UsbInterface& interface,
                                    std::span<const std::uint8_t> bytes, unsigned wait_ms);

struct UsbLinkCounters {
  std::uint64_t received = 0;   ///< packets
  std::uint64_t overrun = 0;    ///< packets that came while nobody took them, and are gone
  std::uint64_t sent = 0;       ///< commands that the device took
  std::uint64_t overtaken = 0;  ///< commands that waited until a newer one came
  std::uint64_t refused = 0;    ///< commands that were too long, or of too many threads at once
  std::uint64_t in_errors = 0;  ///< transfers that failed, the device being there
  std::uint64_t out_errors = 0;
  /// From a command's way into the kernel to the news that the device took it.
  double out_mean_us = 0.0, out_most_us = 0.0;
};

class UsbLink final : public ControlLink {
 public:
  static constexpr std::size_t kInTransfers = 2, kRing = 64;
  /// Of the link's thread: above the servo's 80, which waits for it, below the watchdog's 85.
  static constexpr int kPriority = 83;

  /// Of a command's bytes: it commands zero force.
  using LetsGo = bool (*)(std::span<const std::uint8_t>) noexcept;

  /// `name` is for Errors: "falcon". `lets_go` null: nothing is known of the commands. `priority` 0: that of
  /// other threads, for devices that are only pretended and keep a processor busy.
  UsbLink(UsbAddress address, const UsbInterface& interface, std::string name, LetsGo lets_go,
          int priority = kPriority);
  ~UsbLink() override;

  /// Finds, opens and claims the device, detaching a kernel driver, and starts its thread. An Error where
  /// none is connected, where this user may not open it (with the udev rule), where another program has it.
  [[nodiscard]] Status open() override;
  /// Lets what was submitted last go out, for 0.2 s at most, then lets go of the device.
  void close() noexcept override;
  /// At most 64 bytes. Any thread; after close() false.
  bool submit(std::span<const std::uint8_t> bytes) noexcept override;
  /// One IN packet a call.
  [[nodiscard]] Polled poll(std::span<std::uint8_t> into) noexcept override;
  [[nodiscard]] Status control(const ControlRequest& request) override;

  /// Any thread; each number for itself.
  [[nodiscard]] UsbLinkCounters counters() const noexcept;

 private:
  struct Io;
  void wait_until_out() const noexcept;

  UsbAddress address_;
  UsbInterface interface_;
  std::string name_;
  LetsGo lets_go_;
  int priority_;
  // Alive as long as this, so that submit() may be called at any time.
  int wake_ = -1;
  std::atomic<bool> open_{false}, gone_{false};
  NewestCommand command_;
  PacketRing<kRing> packets_;
  std::size_t taken_ = 0;  ///< bytes of the ring's first packet that poll has given
  struct Counts {
    std::atomic<std::uint64_t> received{0}, overrun{0}, sent{0}, refused{0}, in_errors{0}, out_errors{0};
    // Commands that submit() took, and how many of them, from the first on, wait no more. Those that the
    // link's thread had taken when a newer one came.
    std::atomic<std::uint64_t> accepted{0}, done{0}, put_aside{0};
    std::atomic<std::int64_t> out_ns{0}, out_most_ns{0};  // of those that were sent; the link's thread writes
  } counts_;
  std::unique_ptr<Io> io_;
  // Made with the link and not with each open(): close() may be called by a thread that must not wait for a
  // stop that is under way. A servo's action, being newer, comes first and submits its zero.
  AtStop at_stop_;
};

}  // namespace palpate::device
