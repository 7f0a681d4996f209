#include "device/links/usb_session.h"

#include <fmt/format.h>
#include <libusb.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <utility>

#include <palpate/result.h>
#include "device/interface/driver_options.h"

namespace palpate::device {
namespace {

constexpr int kUsbMostSerial = 128;

struct UsbContextFree {
  void operator()(libusb_context* context) const noexcept { libusb_exit(context); }
};
using UsbContext = std::unique_ptr<libusb_context, UsbContextFree>;

UsbContext make_usb_context() {
  libusb_context* context = nullptr;
  if (libusb_init(&context) != LIBUSB_SUCCESS) return nullptr;
  return UsbContext(context);
}

/// List of the connected devices; filters by vendor and product.
class UsbList {
 public:
  UsbList(libusb_context* context, std::uint16_t vendor, std::uint16_t product) {
    const ssize_t count = libusb_get_device_list(context, &all_);
    for (ssize_t i = 0; i < count; ++i) {
      libusb_device_descriptor descriptor{};
      if (libusb_get_device_descriptor(all_[i], &descriptor) == LIBUSB_SUCCESS &&
          descriptor.idVendor == vendor && descriptor.idProduct == product)
        matching_.push_back(all_[i]);
    }
  }
  UsbList(const UsbList&) = delete;
  UsbList& operator=(const UsbList&) = delete;
  ~UsbList() {
    if (all_ != nullptr) libusb_free_device_list(all_, 1);
  }
  [[nodiscard]] const std::vector<libusb_device*>& matching() const { return matching_; }

 private:
  libusb_device** all_ = nullptr;
  std::vector<libusb_device*> matching_;
};

std::string usb_serial_of(libusb_device_handle* handle) {
  libusb_device_descriptor descriptor{};
  std::array<unsigned char, kUsbMostSerial> text{};
  if (libusb_get_device_descriptor(libusb_get_device(handle), &descriptor) != LIBUSB_SUCCESS ||
      descriptor.iSerialNumber == 0)
    return {};
  const int size = libusb_get_string_descriptor_ascii(handle, descriptor.iSerialNumber, text.data(),
                                                      static_cast<int>(text.size()));
  return size > 0 ? std::string(text.begin(), text.begin() + size) : std::string();
}

/// Opens the first device with the given serial. `problem` keeps why one failed.
libusb_device_handle* opened_usb(const UsbList& list, const std::string& serial, int& problem) {
  for (libusb_device* device : list.matching()) {
    libusb_device_handle* handle = nullptr;
    if (const int failed = libusb_open(device, &handle); failed != LIBUSB_SUCCESS) {
      problem = failed;
      continue;
    }
    if (serial.empty() || usb_serial_of(handle) == serial) return handle;
    libusb_close(handle);
  }
  return nullptr;
}

Error usb_not_opened(const UsbAddress& address, const UsbList& list, int problem, const std::string& name) {
  const std::string id = fmt::format("{:04x}:{:04x}", address.vendor, address.product);
  if (list.matching().empty())
    return {"no device " + id + " is connected by USB", "plug it in and switch it on", name, 0};
  if (problem == LIBUSB_ERROR_ACCESS)
    return {"this user may not open the USB device " + id, std::string(kUdevRemedy) + " and plug it in again",
            name, 0};
  if (problem != LIBUSB_SUCCESS)
    return {"the USB device " + id + " cannot be opened: " + libusb_error_name(problem),
            "unplug it and plug it in again", name, 0};
  return {"no device " + id + " has the serial number " + address.serial,
          "leave the serial number out, or give that of a device that is connected", name, 0};
}

}  // namespace

void UsbTransferFree::operator()(libusb_transfer* transfer) const noexcept {
  libusb_free_transfer(transfer);
}

std::vector<UsbFound> usb_devices(std::uint16_t vendor, std::uint16_t product) {
  std::vector<UsbFound> found;
  const UsbContext context = make_usb_context();
  if (!context) return found;
  const UsbList list(context.get(), vendor, product);
  for (libusb_device* device : list.matching()) {
    UsbFound one{libusb_get_bus_number(device), libusb_get_device_address(device), false};
    const std::string node = fmt::format("/dev/bus/usb/{:03}/{:03}", one.bus, one.address);
    one.may_open = ::access(node.c_str(), R_OK | W_OK) == 0;
    found.push_back(one);
  }
  return found;
}

UsbSession::~UsbSession() {
  if (handle_ != nullptr) {
    if (claimed_ >= 0) libusb_release_interface(handle_, claimed_);
    libusb_close(handle_);
  }
  if (context_ != nullptr) libusb_exit(context_);
}

Status UsbSession::open_device(const UsbAddress& address, const std::string& name) {
  UsbContext context = make_usb_context();
  if (!context)
    return Error{"USB cannot be used on this machine",
                 "look whether /dev/bus/usb is there; containers must be given it", name};
  const UsbList list(context.get(), address.vendor, address.product);
  int problem = LIBUSB_SUCCESS;
  handle_ = opened_usb(list, address.serial, problem);
  if (handle_ == nullptr) return usb_not_opened(address, list, problem, name);
  context_ = context.release();
  return Done{};
}

Status UsbSession::open(const UsbAddress& address, const UsbInterface& interface, const std::string& name) {
  PALPATE_TRY(open_device(address, name));
  libusb_set_auto_detach_kernel_driver(handle_, 1);  // where supported
  const int failed = libusb_claim_interface(handle_, interface.number);
  if (failed != LIBUSB_SUCCESS)
    return Error{failed == LIBUSB_ERROR_BUSY
                     ? std::string("another program has the USB device")
                     : std::string("the USB device cannot be claimed: ") + libusb_error_name(failed),
                 "end the other program, or unplug the device and plug it in again", name};
  claimed_ = interface.number;
  const libusb_pollfd** files = libusb_get_pollfds(context_);
  for (std::size_t i = 0; files != nullptr && files[i] != nullptr && file_count_ < kMaxFiles; ++i)
    files_[file_count_++] = {files[i]->fd, files[i]->events, 0};
  libusb_free_pollfds(files);
  return Done{};
}

std::size_t UsbSession::files(std::span<pollfd> into) const noexcept {
  const std::size_t count = std::min(into.size(), file_count_);
  std::copy_n(files_.begin(), count, into.begin());
  return count;
}

void UsbSession::handle_events() noexcept {
  timeval none{0, 0};
  libusb_handle_events_timeout_completed(context_, &none, nullptr);
}

UsbSent usb_send_once(const UsbAddress& address, const UsbInterface& interface,
                      std::span<const std::uint8_t> bytes, unsigned wait_ms) {
  const UsbContext context = make_usb_context();
  if (!context) return UsbSent::kAbsent;
  const UsbList list(context.get(), address.vendor, address.product);
  if (list.matching().empty()) return UsbSent::kAbsent;
  int problem = LIBUSB_SUCCESS;
  libusb_device_handle* handle = opened_usb(list, address.serial, problem);
  if (handle == nullptr) return UsbSent::kRefused;
  libusb_set_auto_detach_kernel_driver(handle, 1);
  bool sent = false;
  if (libusb_claim_interface(handle, interface.number) == LIBUSB_SUCCESS) {
    // libusb does not write to outgoing data, but its types are not const.
    std::array<unsigned char, kLinkPacketBytes> copy{};
    const std::size_t size = std::min(bytes.size(), copy.size());
    std::copy_n(bytes.begin(), size, copy.begin());
    int moved = 0;
    sent = libusb_bulk_transfer(handle, interface.out, copy.data(), static_cast<int>(size), &moved,
                                wait_ms) == LIBUSB_SUCCESS &&
           static_cast<std::size_t>(moved) == bytes.size();
    libusb_release_interface(handle, interface.number);
  }
  libusb_close(handle);
  return sent ? UsbSent::kSent : UsbSent::kRefused;
}

}  // namespace palpate::device
