// Internal to links: one context of libusb with one device open and claimed, and all of it given back.
#pragma once

#include <poll.h>

#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "device/links/usb_link.h"
#include "toolkit/core/result.h"

struct libusb_context;
struct libusb_device_handle;
struct libusb_transfer;

namespace palpate::device {

struct UsbTransferFree {
  void operator()(libusb_transfer* transfer) const noexcept;
};
using UsbTransfer = std::unique_ptr<libusb_transfer, UsbTransferFree>;

/// One thread, but for the handle, to which libusb lets any thread submit.
class UsbSession {
 public:
  /// More files than libusb watches for one device: its own event, its timer, the device.
  static constexpr std::size_t kMostFiles = 8;

  UsbSession() = default;
  UsbSession(const UsbSession&) = delete;
  UsbSession& operator=(const UsbSession&) = delete;
  ~UsbSession();

  [[nodiscard]] Status open(const UsbAddress& address, const UsbInterface& interface,
                            const std::string& name);
  [[nodiscard]] libusb_device_handle* handle() const noexcept { return handle_; }
  /// The files that libusb waits for, while the device is open always the same. How many.
  [[nodiscard]] std::size_t files(std::span<pollfd> into) const noexcept;
  /// What is due now; never waits.
  void handle_events() noexcept;

 private:
  [[nodiscard]] Status open_device(const UsbAddress& address, const std::string& name);

  libusb_context* context_ = nullptr;
  libusb_device_handle* handle_ = nullptr;
  int claimed_ = -1;
  std::array<pollfd, kMostFiles> files_{};
  std::size_t file_count_ = 0;
};

}  // namespace palpate::device
