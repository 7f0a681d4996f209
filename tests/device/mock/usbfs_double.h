// A Falcon's board as a USB device below the real libusb: the kernel's usbfs files, pretended by umockdev.
// Two may claim it one after the other, as program and guard process do.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "tests/device/mock/falcon_board.h"

namespace palpate::device {

class UsbfsDouble {
 public:
  /// Why it cannot be made in this process; empty: it can.
  [[nodiscard]] static std::string missing();

  /// Plugged in. Keeps a reference to the board, which belongs to a thread of its own from then on.
  explicit UsbfsDouble(FalconBoard& board);
  UsbfsDouble(const UsbfsDouble&) = delete;
  UsbfsDouble& operator=(const UsbfsDouble&) = delete;
  ~UsbfsDouble();

  /// The board, while nothing else touches it.
  void with(const std::function<void(FalconBoard&)>& use);
  /// The cable. What was under way is lost.
  void unplug();
  void plug();
  /// Takes no more bytes: what is sent stays under way. Off again: all of it goes through.
  void hold_out(bool hold);
  /// Transfers of commands that are under way.
  [[nodiscard]] int out_under_way() const;
  /// Nobody may open the node from now on, but for root.
  void forbid();
  /// SCHED_FIFO for the threads that pretend, where it is allowed.
  void run_at(int priority);

 private:
  struct Bed;
  std::unique_ptr<Bed> bed_;
};

// A Falcon's board as a USB device of the running kernel: at a port of its virtual host controller
// (vhci-hcd), whose USB/IP messages come over a pair of sockets; no network. Enumeration, usbfs and its
// queues are the kernel's own.

class VhciDouble {
 public:
  /// Why it cannot be made here; empty: it can.
  [[nodiscard]] static std::string missing();

  /// Plugged in, and found. Keeps a reference to the board, which belongs to a thread of its own from then
  /// on.
  explicit VhciDouble(FalconBoard& board);
  VhciDouble(const VhciDouble&) = delete;
  VhciDouble& operator=(const VhciDouble&) = delete;
  ~VhciDouble();

  /// The board, while nothing else touches it.
  void with(const std::function<void(FalconBoard&)>& use);
  /// The cable. Returns when the kernel has seen it.
  void unplug();
  void plug();
  /// SCHED_FIFO for the thread that pretends, where it is allowed.
  void run_at(int priority);

 private:
  struct Port;
  std::unique_ptr<Port> port_;
};

}  // namespace palpate::device
