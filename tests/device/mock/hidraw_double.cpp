#include "tests/device/mock/hidraw_double.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/hidraw.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <umockdev.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <mutex>
#include <utility>

namespace palpate::device {
namespace {

/// Of its reports, in and out.
constexpr std::uint8_t kHidrawBytes = 64;

// A kernel holds so many reports for each reader, and drops what comes then.
constexpr std::size_t kHeldReports = 64;

UMockdevTestbed* testbed() {
  static UMockdevTestbed* const bed = umockdev_testbed_new();
  return bed;
}

std::string hex(const std::vector<std::uint8_t>& bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) text += fmt::format("{:02X}", byte);
  return text;
}

[[noreturn]] void give_up(const GError* failed) {
  std::fprintf(stderr, "umockdev: %s\n", failed->message);
  std::abort();
}

}  // namespace

struct HidrawDouble::Bed {
  Bed(HidrawIdentity who, Answer what) : identity(std::move(who)), answer(std::move(what)) {}

  gboolean control(UMockdevIoctlClient* client);
  gboolean read(UMockdevIoctlClient* client);
  gboolean write(UMockdevIoctlClient* client);
  void queue(const Bytes& bytes);
  void show_whether_ready();
  void add();
  void remove();

  [[nodiscard]] std::string node() const { return fmt::format("/dev/hidraw{}", index); }
  [[nodiscard]] std::string port() const { return fmt::format("/devices/pretended/usb1/1-{}", index + 1); }
  [[nodiscard]] std::string hid_name() const {
    return fmt::format("0003:{:04X}:{:04X}.{:04X}", identity.vendor, identity.product, index + 1);
  }
  [[nodiscard]] std::string hid() const {
    return fmt::format("{}/1-{}:1.0/{}", port(), index + 1, hid_name());
  }
  [[nodiscard]] std::string raw() const { return fmt::format("{}/hidraw/hidraw{}", hid(), index); }

  HidrawIdentity identity;
  Answer answer;
  int index = 0;  // a new one each time: umockdev leaves the node of a terminal behind, and trips over it
  UMockdevIoctlBase* handler = nullptr;
  mutable std::mutex mutex;
  std::deque<Bytes> reports;
  std::vector<Bytes> written;
  bool plugged = false, silent = false, shows_ready = false;
  int terminal = -1;  // the node's near end, as clients have it
};

gboolean HidrawDouble::Bed::control(UMockdevIoctlClient* client) {
  const std::lock_guard lock(mutex);
  UMockdevIoctlData* argument = umockdev_ioctl_client_get_arg(client);
  const auto fill = [&](const void* from, std::size_t size) {
    UMockdevIoctlData* data = umockdev_ioctl_data_resolve(argument, 0, size, nullptr);
    if (data == nullptr) return umockdev_ioctl_client_complete(client, -1, EFAULT);
    std::copy_n(static_cast<const std::uint8_t*>(from), size, data->data);
    umockdev_ioctl_client_complete(client, 0, 0);
    g_object_unref(data);
  };
  const Bytes descriptor = hid_descriptor(identity, kHidrawBytes);
  const gulong request = umockdev_ioctl_client_get_request(client);
  if (!plugged) {
    umockdev_ioctl_client_complete(client, -1, ENODEV);
  } else if (request == HIDIOCGRDESCSIZE) {
    const int size = static_cast<int>(descriptor.size());
    fill(&size, sizeof(size));
  } else if (request == HIDIOCGRDESC) {
    hidraw_report_descriptor all{};
    all.size = static_cast<__u32>(descriptor.size());
    std::copy(descriptor.begin(), descriptor.end(), all.value);
    fill(&all, sizeof(all));
  } else if (request == HIDIOCGRAWINFO) {
    const hidraw_devinfo info{3, static_cast<__s16>(identity.vendor), static_cast<__s16>(identity.product)};
    fill(&info, sizeof(info));
  } else {
    umockdev_ioctl_client_complete(client, -1, EINVAL);
  }
  return TRUE;
}

gboolean HidrawDouble::Bed::read(UMockdevIoctlClient* client) {
  const std::lock_guard lock(mutex);
  UMockdevIoctlData* into = umockdev_ioctl_client_get_arg(client);
  if (!plugged || reports.empty()) {
    umockdev_ioctl_client_complete(client, -1, plugged ? EAGAIN : ENODEV);
    return TRUE;
  }
  Bytes& report = reports.front();
  const std::size_t size = std::min(report.size(), static_cast<std::size_t>(into->data_len));
  umockdev_ioctl_data_update(into, 0, report.data(), static_cast<int>(size));
  umockdev_ioctl_client_complete(client, static_cast<glong>(size), 0);
  reports.pop_front();
  show_whether_ready();
  return TRUE;
}

gboolean HidrawDouble::Bed::write(UMockdevIoctlClient* client) {
  const std::lock_guard lock(mutex);
  const UMockdevIoctlData* from = umockdev_ioctl_client_get_arg(client);
  if (!plugged) {
    umockdev_ioctl_client_complete(client, -1, ENODEV);
    return TRUE;
  }
  const std::span<const std::uint8_t> bytes(from->data, static_cast<std::size_t>(from->data_len));
  written.emplace_back(bytes.begin(), bytes.end());
  if (answer && !silent)
    if (const std::optional<Bytes> reply = answer(bytes)) queue(*reply);
  umockdev_ioctl_client_complete(client, from->data_len, 0);
  return TRUE;
}

void HidrawDouble::Bed::queue(const Bytes& bytes) {
  if (reports.size() < kHeldReports) reports.push_back(bytes);
  show_whether_ready();
}

/// A terminal stands behind the node: one byte in it, while there is a report, makes poll() tell the truth.
void HidrawDouble::Bed::show_whether_ready() {
  const bool ready = !reports.empty();
  if (ready == shows_ready || terminal < 0) return;
  shows_ready = ready;
  const char token = 'x';
  if (!ready)
    ::tcflush(terminal, TCIFLUSH);
  else if (::write(umockdev_testbed_get_dev_fd(testbed(), node().c_str()), &token, 1) != 1)
    std::abort();
}

void HidrawDouble::Bed::add() {
  static int next = 0;
  index = next++;
  const std::string description = fmt::format(
      "P: {0}\nE: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\nA: idVendor={2:04x}\\n\nA: idProduct={3:04x}\\n\n"
      "A: manufacturer=Palpate\\n\nA: product={4}\\n\nA: serial={5}\\n\nA: bcdDevice=0100\\n\n\n"
      "P: {0}/1-{8}:1.0\nE: DEVTYPE=usb_interface\nE: SUBSYSTEM=usb\nA: bInterfaceNumber=00\\n\n\n"
      "P: {1}\nE: SUBSYSTEM=hid\nE: HID_ID=0003:{2:08X}:{3:08X}\nE: HID_NAME=Palpate {4}\nE: HID_UNIQ={5}\n"
      "H: report_descriptor={6}\n\n"
      "P: {7}\nN: hidraw{9}\nE: DEVNAME=/dev/hidraw{9}\nE: SUBSYSTEM=hidraw\nL: "
      "device=../../../{10}\n",
      port(), hid(), identity.vendor, identity.product, identity.product_name, identity.serial,
      hex(hid_descriptor(identity, kHidrawBytes)), raw(), index + 1, index, hid_name());
  GError* failed = nullptr;
  if (umockdev_testbed_add_from_string(testbed(), description.c_str(), &failed) == FALSE) give_up(failed);
  handler = umockdev_ioctl_base_new();
  using Handle = gboolean (*)(UMockdevIoctlBase*, UMockdevIoctlClient*, gpointer);
  const Handle on_control = [](UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer self) {
    return static_cast<Bed*>(self)->control(client);
  };
  const Handle on_read = [](UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer self) {
    return static_cast<Bed*>(self)->read(client);
  };
  const Handle on_write = [](UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer self) {
    return static_cast<Bed*>(self)->write(client);
  };
  g_signal_connect(handler, "handle-ioctl", G_CALLBACK(on_control), this);
  g_signal_connect(handler, "handle-read", G_CALLBACK(on_read), this);
  g_signal_connect(handler, "handle-write", G_CALLBACK(on_write), this);
  {
    const std::lock_guard lock(mutex);
    plugged = true;
    shows_ready = false;
    reports.clear();
    terminal = ::ioctl(umockdev_testbed_get_dev_fd(testbed(), node().c_str()), TIOCGPTPEER,
                       O_RDWR | O_NOCTTY | O_CLOEXEC);
  }
  if (umockdev_testbed_attach_ioctl(testbed(), node().c_str(), handler, &failed) == FALSE) give_up(failed);
  umockdev_testbed_uevent(testbed(), ("/sys" + raw()).c_str(), "add");
}

void HidrawDouble::Bed::remove() {
  {
    const std::lock_guard lock(mutex);
    if (!plugged) return;
    plugged = false;
    reports.clear();
    ::close(std::exchange(terminal, -1));
  }
  // The far end of the node's terminal goes: its file says error and hang-up, as hidraw does. The number
  // stays taken, for umockdev closes it once more.
  const int null = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  ::dup2(null, umockdev_testbed_get_dev_fd(testbed(), node().c_str()));
  ::close(null);
  umockdev_testbed_uevent(testbed(), ("/sys" + raw()).c_str(), "remove");
  umockdev_testbed_detach_ioctl(testbed(), node().c_str(), nullptr);
  g_object_unref(std::exchange(handler, nullptr));
  for (const std::string& path : {raw(), hid(), fmt::format("{}/1-{}:1.0", port(), index + 1), port()})
    umockdev_testbed_remove_device(testbed(), ("/sys" + path).c_str());
}

HidrawDouble::HidrawDouble(HidrawIdentity identity, Answer answer)
    : bed_(std::make_unique<Bed>(std::move(identity), std::move(answer))) {
  bed_->add();
}
HidrawDouble::~HidrawDouble() {
  bed_->remove();
}
void HidrawDouble::unplug() {
  bed_->remove();
}
void HidrawDouble::plug() {
  bed_->add();
}
void HidrawDouble::report(const Bytes& bytes) {
  const std::lock_guard lock(bed_->mutex);
  bed_->queue(bytes);
}
void HidrawDouble::silence(bool silent) {
  const std::lock_guard lock(bed_->mutex);
  bed_->silent = silent;
}
std::vector<HidrawDouble::Bytes> HidrawDouble::written() const {
  const std::lock_guard lock(bed_->mutex);
  return bed_->written;
}
std::string HidrawDouble::node() const {
  return bed_->node();
}
bool HidrawDouble::possible() {
  const char* preload = std::getenv("LD_PRELOAD");
  return preload != nullptr && std::string(preload).find("umockdev") != std::string::npos;
}

}  // namespace palpate::device
