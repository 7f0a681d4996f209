// Internal to links: owns one libusb context with one device open and claimed.
#pragma once

#include <poll.h>

#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include <palpate/result.h>
#include "device/links/usb_link.h"

struct libusb_context;
struct libusb_device_handle;
struct libusb_transfer;

namespace palpate::device {

struct UsbTransferFree {
  void operator()(libusb_transfer* transfer) const noexcept;
};
using UsbTransfer = std::unique_ptr<libusb_transfer, UsbTransferFree>;

/// For one thread, except the handle: libusb lets any thread submit to it.
class UsbSession {
 public:
  /// Above the files libusb watches for one device: its event, its timer, the device.
  static constexpr std::size_t kMaxFiles = 8;

  UsbSession() = default;
  UsbSession(const UsbSession&) = delete;
  UsbSession& operator=(const UsbSession&) = delete;
  ~UsbSession();

  [[nodiscard]] Status open(const UsbAddress& address, const UsbInterface& interface,
                            const std::string& name);
  [[nodiscard]] libusb_device_handle* handle() const noexcept { return handle_; }
  /// Fills in the files libusb waits for, constant while the device is open; returns their number.
  [[nodiscard]] std::size_t files(std::span<pollfd> into) const noexcept;
  /// Runs pending libusb work; never waits.
  void handle_events() noexcept;

 private:
  [[nodiscard]] Status open_device(const UsbAddress& address, const std::string& name);

  libusb_context* context_ = nullptr;
  libusb_device_handle* handle_ = nullptr;
  int claimed_ = -1;
  std::array<pollfd, kMaxFiles> files_{};
  std::size_t file_count_ = 0;
};

}  // namespace palpate::device
