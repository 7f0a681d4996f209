// A USB device through libusb-1.0: packets over two bulk or interrupt endpoints.
//
// Submitting a libusb transfer allocates and locks, so no frame may do it. The link's thread keeps two
// 64-byte IN transfers queued, sends the newest command from submit(), and puts received packets into a ring.
// Frames touch only the command slot, the ring and an eventfd.
//
// The kernel holds one command at a time, since nothing can overtake inside it; a newer command replaces the
// waiting one. A zero command does not wait for the previous one's completion, so at most one packet precedes
// it, however slow the device. A controller that reports completion only at the frame's end (UHCI, OHCI)
// takes every second command at 1 kHz, always the newest. To have every command taken, wait for its answer
// before the next. Nothing is sent twice. A stopping program waits at most 0.1 s for submitted commands
// (progress.h).
#pragma once

#include <boost/lockfree/spsc_queue.hpp>

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <palpate/device/link.h>
#include <palpate/progress.h>
#include "device/links/newest_command.h"

namespace palpate::device {

/// Longest packet: a full-speed bulk packet.
inline constexpr std::size_t kLinkPacketBytes = 64;

struct LinkPacket {
  std::array<std::uint8_t, kLinkPacketBytes> bytes{};
  std::size_t size = 0;
};

struct UsbAddress {
  std::uint16_t vendor = 0, product = 0;
  std::string serial;  ///< empty: the first found
};

struct UsbInterface {
  int number = 0;
  std::uint8_t in = 0x81, out = 0x02;  ///< endpoint addresses
};

struct UsbFound {
  int bus = 0, address = 0;
  bool may_open = false;  ///< this user may open it
};
/// Lists connected devices without opening them; empty if the machine has no USB. Some milliseconds.
[[nodiscard]] std::vector<UsbFound> usb_devices(std::uint16_t vendor, std::uint16_t product);

/// For a guard process: opens and claims the device, sends these bytes once, closes. Waits at most `wait_ms`.
/// Not for a process with the device open.
enum class UsbSent : std::uint8_t { kSent, kAbsent, kRefused };
[[nodiscard]] UsbSent usb_send_once(const UsbAddress& address, const UsbInterface& interface,
                                    std::span<const std::uint8_t> bytes, unsigned wait_ms);

struct UsbLinkCounters {
  std::uint64_t received = 0;   ///< packets
  std::uint64_t overrun = 0;    ///< packets lost because nobody polled
  std::uint64_t sent = 0;       ///< commands taken by the device
  std::uint64_t overtaken = 0;  ///< waiting commands replaced by a newer one
  std::uint64_t refused = 0;    ///< commands too long, or from too many threads at once
  std::uint64_t in_errors = 0;  ///< failed transfers of a connected device
  std::uint64_t out_errors = 0;
  /// From submission to the kernel until completion.
  double out_mean_us = 0.0, out_most_us = 0.0;
};

class UsbLink final : public ControlLink {
 public:
  static constexpr std::size_t kInTransfers = 2, kRing = 64;
  /// Of the link's thread: above the servo's 80, which waits for it, below the watchdog's 85.
  static constexpr int kPriority = 83;

  /// Whether a command's bytes command zero force.
  using IsZeroCommand = bool (*)(std::span<const std::uint8_t>) noexcept;

  /// `name` is for Errors: "falcon". `is_zero_command` null: no command counts as zero. `priority` 0: normal
  /// scheduling, for simulated devices that keep a processor busy.
  UsbLink(UsbAddress address, const UsbInterface& interface, std::string name, IsZeroCommand is_zero_command,
          int priority = kPriority);
  ~UsbLink() override;

  /// Finds, opens and claims the device, detaches a kernel driver, starts the thread. An Error if none is
  /// connected, this user may not open it, or another program has it.
  [[nodiscard]] Status open() override;
  /// Sends the last submitted command, at most 0.2 s, then releases the device.
  void close() noexcept override;
  /// At most 64 bytes. Any thread; false after close().
  bool submit(std::span<const std::uint8_t> bytes) noexcept override;
  /// Gives one IN packet a call.
  [[nodiscard]] Polled poll(std::span<std::uint8_t> into) noexcept override;
  [[nodiscard]] Status control(const ControlRequest& request) override;

  /// Any thread; each number is consistent by itself only.
  [[nodiscard]] UsbLinkCounters counters() const noexcept;

 private:
  struct Io;
  void wait_until_out() const noexcept;

  UsbAddress address_;
  UsbInterface interface_;
  std::string name_;
  IsZeroCommand lets_go_;
  int priority_;
  // These live as long as the link, so submit() may be called at any time.
  int wake_ = -1;
  std::atomic<bool> open_{false}, gone_{false};
  NewestCommand command_;
  boost::lockfree::spsc_queue<LinkPacket, boost::lockfree::capacity<kRing>> packets_;
  LinkPacket polled_;      ///< the packet that poll gives now
  std::size_t taken_ = 0;  ///< bytes of it already given
  struct Counts {
    std::atomic<std::uint64_t> received{0}, overrun{0}, sent{0}, refused{0}, in_errors{0}, out_errors{0};
    // accepted: commands taken by submit(). done: how many of them no longer wait. superseded_in_flight:
    // commands the thread had taken and dropped for a newer one.
    std::atomic<std::uint64_t> accepted{0}, done{0}, superseded_in_flight{0};
    std::atomic<std::int64_t> out_ns{0}, out_most_ns{0};  // over sent commands; written by the link's thread
  } counts_;
  std::unique_ptr<Io> io_;
  // Made with the link, not by open(): close() may run in a thread that must not wait for a running stop. A
  // servo's stop action is newer, so it runs first and submits its zero.
  StopCallback stop_callback_;
};

}  // namespace palpate::device
