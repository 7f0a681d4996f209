#include "tests/device/mock/usbfs_double.h"

#include <fcntl.h>
#include <linux/usbdevice_fs.h>
#include <pthread.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <time.h>
#include <umockdev.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <map>
#include <mutex>
#include <set>
#include <span>
#include <string_view>
#include <thread>
#include <utility>

#include <palpate/clock.h>

namespace palpate::device {
namespace {

constexpr const char* kNode = "/dev/bus/usb/001/004";
constexpr const char* kSysfs = "/sys/devices/pretended/usb1/1-4";
// Device and configuration descriptors: 0403:cb48, full speed, one interface, bulk in 0x81 and out 0x02.
constexpr const char* kDescription =
    "P: /devices/pretended/usb1/1-4\n"
    "N: bus/usb/001/004\n"
    "E: DEVNAME=/dev/bus/usb/001/004\n"
    "E: DEVTYPE=usb_device\n"
    "E: SUBSYSTEM=usb\n"
    "E: BUSNUM=001\n"
    "E: DEVNUM=004\n"
    "E: PRODUCT=403/cb48/400\n"
    "A: busnum=1\\n\n"
    "A: devnum=4\\n\n"
    "A: speed=12\\n\n"
    "A: bConfigurationValue=1\\n\n"
    "H: descriptors="
    "12010002000000080304"
    "48CB0004000000"
    "01"
    "09022000010100A02D"
    "0904000002FFFFFF00"
    "07058102400000"
    "07050202400000"
    "\n";

using Client = UMockdevIoctlClient;
using Data = UMockdevIoctlData;

struct Unref {
  void operator()(Data* data) const { g_object_unref(data); }
};
using Held = std::unique_ptr<Data, Unref>;

Held resolved(Data* data, std::size_t at, std::size_t size) {
  return Held(umockdev_ioctl_data_resolve(data, at, size, nullptr));
}

/// A transfer under way; its memory is the client's, seen through umockdev.
struct Urb {
  Held data, buffer;
  bool done = false;
  [[nodiscard]] usbdevfs_urb& fields() const { return *reinterpret_cast<usbdevfs_urb*>(data->data); }
  void finish(int status, int length) {
    fields().status = status;
    fields().actual_length = length;
    done = true;
  }
};

/// This thread's, once, where it is asked for.
void take_priority(int wanted) {
  thread_local int has = 0;
  if (has == wanted) return;
  has = wanted;
  sched_param priority{};
  priority.sched_priority = wanted;
  ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &priority);
}

void answer(Client* client, long result, int error = 0) {
  umockdev_ioctl_client_complete(client, result, error);
}

}  // namespace

struct UsbfsDouble::Bed {
  explicit Bed(FalconBoard& connected) : board(connected), bed(umockdev_testbed_new()) {
    ticker = std::thread([this] { tick(); });
  }
  ~Bed();

  gboolean handle(Client* client);
  void serve(Client* client);
  void show_whether_ready();
  void tick();
  void submit(Client* client, Data* argument);
  void reap(Client* client, Data* argument);
  void discard(Client* client, Data* argument);
  void claim(Client* client);
  void begin(Urb& urb);
  void know(Client* client);
  void vanished(Client* client);
  static void gone(gpointer self, GObject* client);
  void add();
  void remove();

  FalconBoard& board;
  UMockdevTestbed* bed;
  UMockdevIoctlBase* handler = nullptr;
  mutable std::mutex mutex;
  std::set<Client*> known;
  std::map<Client*, std::deque<Urb>> urbs;
  Client* owner = nullptr;  // has claimed the interface
  bool plugged = false, holds_out = false;
  int terminal = -1;  // the node's near end, as clients have it
  bool shows_ready = true;
  std::atomic<bool> ending{false};
  std::thread ticker;
  std::atomic<int> priority{0};
};

gboolean UsbfsDouble::Bed::handle(Client* client) {
  take_priority(priority);
  const std::lock_guard lock(mutex);
  know(client);
  serve(client);
  show_whether_ready();
  return TRUE;
}

void UsbfsDouble::Bed::serve(Client* client) {
  Data* argument = umockdev_ioctl_client_get_arg(client);
  switch (umockdev_ioctl_client_get_request(client)) {
    case USBDEVFS_GET_CAPABILITIES: {
      const Held caps = resolved(argument, 0, sizeof(std::uint32_t));
      if (!caps) return answer(client, -1, EFAULT);
      *reinterpret_cast<std::uint32_t*>(caps->data) =
          USBDEVFS_CAP_ZERO_PACKET | USBDEVFS_CAP_NO_PACKET_SIZE_LIM | USBDEVFS_CAP_REAP_AFTER_DISCONNECT;
      return answer(client, 0);
    }
    case USBDEVFS_CLAIMINTERFACE:
    case USBDEVFS_DISCONNECT_CLAIM:
      return claim(client);
    case USBDEVFS_RELEASEINTERFACE:
      if (owner == client) owner = nullptr;
      return answer(client, 0);
    case USBDEVFS_GETDRIVER:
    case USBDEVFS_IOCTL:
      return answer(client, -1, ENODATA);  // no kernel driver
    case USBDEVFS_SUBMITURB:
      return submit(client, argument);
    case USBDEVFS_REAPURB:
    case USBDEVFS_REAPURBNDELAY:
      return reap(client, argument);
    case USBDEVFS_DISCARDURB:
      return discard(client, argument);
    case USBDEVFS_SETINTERFACE:
    case USBDEVFS_CLEAR_HALT:
      return answer(client, 0);
    default:
      return answer(client, -1, ENOTTY);
  }
}

/// A node that is always ready to be polled keeps a processor busy. A stopped terminal takes no output, and
/// its poll says so: it runs while there is something to reap.
void UsbfsDouble::Bed::show_whether_ready() {
  bool ready = !plugged;
  for (const auto& [client, under_way] : urbs)
    for (const Urb& urb : under_way)
      ready = ready || urb.done || ((urb.fields().endpoint & 0x80U) != 0 && board.due(monotonic_ns()));
  if (ready == shows_ready || terminal < 0) return;
  shows_ready = ready;
  ::tcflow(terminal, ready ? TCOON : TCOOFF);
}

/// The chip's timer: what is due without anybody's asking.
void UsbfsDouble::Bed::tick() {
  constexpr timespec kTick{0, 200'000};
  while (!ending) {
    take_priority(priority);
    {
      const std::lock_guard lock(mutex);
      show_whether_ready();
    }
    ::nanosleep(&kTick, nullptr);
  }
}

void UsbfsDouble::Bed::claim(Client* client) {
  if (!plugged) return answer(client, -1, ENODEV);
  if (owner != nullptr && owner != client) return answer(client, -1, EBUSY);
  owner = client;
  answer(client, 0);
}

/// What needs no waiting happens at once.
void UsbfsDouble::Bed::begin(Urb& urb) {
  const usbdevfs_urb& fields = urb.fields();
  const std::span<const std::uint8_t> bytes(urb.buffer->data, static_cast<std::size_t>(fields.buffer_length));
  if (fields.type == USBDEVFS_URB_TYPE_CONTROL) {
    const auto pair = [&](std::size_t at) {
      return static_cast<std::uint16_t>(bytes[at] | (bytes[at + 1] << 8));
    };
    if (bytes[0] != 0x40) return urb.finish(-EPIPE, 0);  // no strings, no statuses
    board.control({bytes[0], bytes[1], pair(2), pair(4)}, monotonic_ns());
    return urb.finish(0, 0);
  }
  if ((fields.endpoint & 0x80U) != 0 || holds_out) return;
  board.out(bytes, monotonic_ns());
  urb.finish(0, fields.buffer_length);
}

void UsbfsDouble::Bed::submit(Client* client, Data* argument) {
  if (!plugged) return answer(client, -1, ENODEV);
  if (client != owner) return answer(client, -1, EINVAL);
  Urb urb;
  urb.data = resolved(argument, 0, sizeof(usbdevfs_urb));
  if (!urb.data) return answer(client, -1, EFAULT);  // the process died
  urb.buffer = resolved(urb.data.get(), offsetof(usbdevfs_urb, buffer),
                        static_cast<std::size_t>(urb.fields().buffer_length));
  if (!urb.buffer) return answer(client, -1, EFAULT);
  begin(urb);
  urbs[client].push_back(std::move(urb));
  answer(client, 0);
}

void UsbfsDouble::Bed::reap(Client* client, Data* argument) {
  std::deque<Urb>& under_way = urbs[client];
  for (Urb& urb : under_way) {
    if (urb.done) continue;
    if (!plugged) {
      urb.finish(-ESHUTDOWN, 0);
      continue;
    }
    if ((urb.fields().endpoint & 0x80U) == 0) continue;
    const auto packet = board.in(monotonic_ns());
    if (!packet) break;
    std::copy(packet->begin(), packet->end(), urb.buffer->data);
    urb.finish(0, static_cast<int>(packet->size()));
  }
  const auto ready =
      std::find_if(under_way.begin(), under_way.end(), [](const Urb& urb) { return urb.done; });
  if (ready == under_way.end()) return answer(client, -1, plugged ? EAGAIN : ENODEV);
  // The pointer's own memory first, or the client is handed an address that is not its own.
  const Held pointer = resolved(argument, 0, sizeof(void*));
  if (!pointer) return answer(client, -1, EFAULT);
  const Urb urb = std::move(*ready);
  under_way.erase(ready);
  umockdev_ioctl_data_set_ptr(pointer.get(), 0, urb.data.get());
  answer(client, 0);
}

void UsbfsDouble::Bed::discard(Client* client, Data* argument) {
  const gulong address = *reinterpret_cast<gulong*>(argument->data);
  for (Urb& urb : urbs[client]) {
    if (urb.done || (urb.data->client_addr != address && urb.data->client_addr != argument->client_addr))
      continue;
    urb.finish(-ENOENT, 0);
    return answer(client, 0);
  }
  answer(client, -1, EINVAL);
}

/// umockdev says nowhere that a process has died while it was being served; but then it drops its client.
void UsbfsDouble::Bed::know(Client* client) {
  if (known.insert(client).second) g_object_weak_ref(G_OBJECT(client), gone, this);
}

UsbfsDouble::Bed::~Bed() {
  ending = true;
  ticker.join();
  g_object_unref(bed);  // and with it its thread
  for (Client* client : known) g_object_weak_unref(G_OBJECT(client), gone, this);
}

void UsbfsDouble::Bed::gone(gpointer self, GObject* client) {
  static_cast<Bed*>(self)->vanished(reinterpret_cast<Client*>(client));
}

void UsbfsDouble::Bed::vanished(Client* client) {
  const std::lock_guard lock(mutex);
  known.erase(client);
  urbs.erase(client);
  if (owner == client) owner = nullptr;  // as the kernel does with what a process leaves
}

void UsbfsDouble::Bed::add() {
  GError* failed = nullptr;
  if (umockdev_testbed_add_from_string(bed, kDescription, &failed) == FALSE) {
    std::fprintf(stderr, "umockdev: %s\n", failed->message);
    std::abort();
  }
  handler = umockdev_ioctl_base_new();
  g_signal_connect(handler, "handle-ioctl",
                   G_CALLBACK(+[](UMockdevIoctlBase*, Client* client, gpointer self) -> gboolean {
                     return static_cast<Bed*>(self)->handle(client);
                   }),
                   this);
  {
    const std::lock_guard lock(mutex);
    plugged = true;
    owner = nullptr;
  }
  if (umockdev_testbed_attach_ioctl(bed, kNode, handler, &failed) == FALSE) {
    std::fprintf(stderr, "umockdev: %s\n", failed->message);
    std::abort();
  }
  {
    const std::lock_guard lock(mutex);
    terminal = ::ioctl(umockdev_testbed_get_dev_fd(bed, kNode), TIOCGPTPEER, O_RDWR | O_NOCTTY | O_CLOEXEC);
    shows_ready = true;
  }
  umockdev_testbed_uevent(bed, kSysfs, "add");
}

void UsbfsDouble::Bed::remove() {
  {
    const std::lock_guard lock(mutex);
    plugged = false;
    show_whether_ready();
    ::close(std::exchange(terminal, -1));
  }
  // The far end of the node's terminal goes: its file says error and hang-up, as usbfs does. The number stays
  // taken, for umockdev closes it once more.
  const int null = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  ::dup2(null, umockdev_testbed_get_dev_fd(bed, kNode));
  ::close(null);
  umockdev_testbed_uevent(bed, kSysfs, "remove");
  umockdev_testbed_detach_ioctl(bed, kNode, nullptr);
  umockdev_testbed_remove_device(bed, kSysfs);
  g_object_unref(handler);
  handler = nullptr;
}

std::string UsbfsDouble::missing() {
  const char* preload = std::getenv("LD_PRELOAD");
  if (preload != nullptr && std::string_view(preload).find("umockdev") != std::string_view::npos) return {};
  return "run this under umockdev-wrapper (package umockdev): LD_PRELOAD does not hold its library";
}

UsbfsDouble::UsbfsDouble(FalconBoard& board) : bed_(std::make_unique<Bed>(board)) {
  bed_->add();
}

UsbfsDouble::~UsbfsDouble() {
  if (bed_->plugged) bed_->remove();
}

void UsbfsDouble::with(const std::function<void(FalconBoard&)>& use) {
  const std::lock_guard lock(bed_->mutex);
  use(bed_->board);
}

void UsbfsDouble::unplug() {
  bed_->remove();
}

void UsbfsDouble::plug() {
  bed_->add();
}

void UsbfsDouble::hold_out(bool hold) {
  const std::lock_guard lock(bed_->mutex);
  bed_->holds_out = hold;
  if (hold) return;
  for (auto& [client, under_way] : bed_->urbs)
    for (Urb& urb : under_way)
      if (!urb.done && (urb.fields().endpoint & 0x80U) == 0) bed_->begin(urb);
  bed_->show_whether_ready();
}

int UsbfsDouble::out_under_way() const {
  const std::lock_guard lock(bed_->mutex);
  int count = 0;
  for (const auto& [client, under_way] : bed_->urbs)
    for (const Urb& urb : under_way)
      count +=
          !urb.done && (urb.fields().endpoint & 0x80U) == 0 && urb.fields().type != USBDEVFS_URB_TYPE_CONTROL
              ? 1
              : 0;
  return count;
}

void UsbfsDouble::forbid() {
  gchar* root = umockdev_testbed_get_root_dir(bed_->bed);
  const std::string folder = root;
  g_free(root);
  constexpr mode_t kAllMayListen = 0777;  // sockets on which uevents come are made there
  ::chmod(folder.c_str(), kAllMayListen);
  ::chmod((folder + "/ioctl" + kNode).c_str(), kAllMayListen);
  ::chmod((folder + kNode).c_str(), 0);
}

void UsbfsDouble::run_at(int priority) {
  bed_->priority = priority;
}

}  // namespace palpate::device
