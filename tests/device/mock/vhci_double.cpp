// Messages: the kernel's Documentation/usb/usbip_protocol.rst.
#include "tests/device/mock/usbfs_double.h"

#include <fmt/format.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <mutex>
#include <span>
#include <sstream>
#include <utility>

#include <palpate/clock.h>
#include "device/links/usb_link.h"
#include "tests/device/helpers.h"

namespace palpate::device {
namespace {

const std::string kVhci = "/sys/devices/platform/vhci_hcd.0/";
constexpr std::uint16_t kVhciVendor = 0x0403, kVhciProduct = 0xCB48;
// Messages' kinds, and places in their head of 48 bytes; all numbers big-endian.
constexpr std::uint32_t kSubmit = 1, kUnlink = 2, kSubmitted = 3, kUnlinked = 4;
constexpr std::size_t kHeadBytes = 48, kSequenceAt = 4, kDirectionAt = 12, kEndpointAt = 16;
constexpr std::size_t kLengthAt = 24, kSetupAt = 40;                       // of a submission
constexpr std::size_t kStatusAt = 20, kActualAt = 24, kToUnlinkAt = 20;    // of an answer; of an unlinking
constexpr int kFullSpeed = 2, kBusAndDevice = 0x0001'0002, kFreePort = 4;  // as the kernel numbers them
constexpr timespec kVhciLook{0, 200'000};

using VhciBytes = std::vector<std::uint8_t>;
using VhciHead = std::array<std::uint8_t, kHeadBytes>;

const VhciBytes kDeviceDescriptor = {0x12, 0x01, 0x00, 0x02, 0x00, 0x00, 0x00, 0x08, 0x03,
                                     0x04, 0x48, 0xCB, 0x00, 0x04, 0x00, 0x00, 0x00, 0x01};
const VhciBytes kConfiguration = {0x09, 0x02, 0x20, 0x00, 0x01, 0x01, 0x00, 0xA0, 0x2D, 0x09, 0x04,
                                  0x00, 0x00, 0x02, 0xFF, 0xFF, 0xFF, 0x00, 0x07, 0x05, 0x81, 0x02,
                                  0x40, 0x00, 0x00, 0x07, 0x05, 0x02, 0x02, 0x40, 0x00, 0x00};

std::uint32_t vhci_number(const VhciHead& head, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value = value << 8U | std::uint32_t{head[at + i]};
  return value;
}
void put_number(VhciHead& head, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) head[at + i] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}

bool vhci_read(int socket, std::span<std::uint8_t> into) {
  for (std::size_t done = 0; done < into.size();) {
    const ssize_t got = ::read(socket, into.data() + done, into.size() - done);
    if (got == 0 || (got < 0 && errno != EINTR)) return false;
    if (got > 0) done += static_cast<std::size_t>(got);
  }
  return true;
}
bool vhci_write(int socket, std::span<const std::uint8_t> bytes) {
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t wrote = ::send(socket, bytes.data() + done, bytes.size() - done, MSG_NOSIGNAL);
    if (wrote < 0 && errno != EINTR) return false;
    if (wrote > 0) done += static_cast<std::size_t>(wrote);
  }
  return true;
}

/// A free port of a full-speed controller; below 0: there is none.
int free_vhci_port() {
  std::ifstream status(kVhci + "status");
  std::string line;
  std::getline(status, line);  // the head
  while (std::getline(status, line)) {
    std::istringstream words(line);
    std::string hub;
    int port = -1, state = 0;
    if (words >> hub >> port >> state && hub == "hs" && state == kFreePort) return port;
  }
  return -1;
}

[[noreturn]] void vhci_fails(const char* what) {
  std::fprintf(stderr, "vhci: %s\n", what);
  std::abort();
}

}  // namespace

struct VhciDouble::Port {
  explicit Port(FalconBoard& connected) : board(connected) {}

  void serve();
  bool take_one();
  bool submitted(const VhciHead& head);
  bool unlinked(const VhciHead& head);
  bool deliver();
  bool answer(std::uint32_t sequence, int status, std::size_t moved, std::span<const std::uint8_t> bytes);
  /// What a control request gives; below 0: an error of the kernel's.
  int control(std::span<const std::uint8_t> setup, VhciBytes& bytes);

  FalconBoard& board;
  std::mutex mutex;
  int socket = -1;
  std::deque<std::uint32_t> waiting;  // sequences of IN transfers
  std::atomic<bool> ending{false};
  std::atomic<int> priority{0};
  std::thread thread;
};

void VhciDouble::Port::serve() {
  int has = 0;
  while (!ending) {
    if (const int wanted = priority; wanted != has) {
      sched_param asked{};
      asked.sched_priority = has = wanted;
      ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &asked);
    }
    pollfd ready{socket, POLLIN, 0};
    const int news = ::ppoll(&ready, 1, &kVhciLook, nullptr);
    if (news > 0 && !take_one()) return;
    const std::lock_guard lock(mutex);
    if (!deliver()) return;
  }
}

bool VhciDouble::Port::take_one() {
  VhciHead head{};
  if (!vhci_read(socket, head)) return false;
  const std::uint32_t kind = vhci_number(head, 0);
  if (kind == kSubmit) return submitted(head);
  return kind == kUnlink && unlinked(head);
}

bool VhciDouble::Port::submitted(const VhciHead& head) {
  const std::uint32_t sequence = vhci_number(head, kSequenceAt), endpoint = vhci_number(head, kEndpointAt);
  const bool in = vhci_number(head, kDirectionAt) != 0;
  const std::size_t length = vhci_number(head, kLengthAt);
  VhciBytes bytes(in ? 0 : length);
  if (!vhci_read(socket, bytes)) return false;
  const std::lock_guard lock(mutex);
  if (endpoint == 0) {
    const int status = control(std::span(head).subspan(kSetupAt), bytes);
    if (in && bytes.size() > length) bytes.resize(length);
    return answer(sequence, std::min(status, 0), bytes.size(),
                  in ? std::span(bytes) : std::span<std::uint8_t>());
  }
  if (in) {
    waiting.push_back(sequence);
    return true;
  }
  board.out(bytes, monotonic_ns());
  return answer(sequence, 0, bytes.size(), {});
}

bool VhciDouble::Port::unlinked(const VhciHead& head) {
  const std::lock_guard lock(mutex);
  const auto found = std::find(waiting.begin(), waiting.end(), vhci_number(head, kToUnlinkAt));
  VhciHead done{};
  put_number(done, 0, kUnlinked);
  put_number(done, kSequenceAt, vhci_number(head, kSequenceAt));
  if (found != waiting.end()) {
    put_number(done, kStatusAt, static_cast<std::uint32_t>(-ECONNRESET));
    waiting.erase(found);
  }
  return vhci_write(socket, done);
}

bool VhciDouble::Port::deliver() {
  while (!waiting.empty()) {
    const auto packet = board.in(monotonic_ns());
    if (!packet) return true;
    const std::uint32_t sequence = waiting.front();
    waiting.pop_front();
    if (!answer(sequence, 0, packet->size(), *packet)) return false;
  }
  return true;
}

bool VhciDouble::Port::answer(std::uint32_t sequence, int status, std::size_t moved,
                              std::span<const std::uint8_t> bytes) {
  VhciHead head{};
  put_number(head, 0, kSubmitted);
  put_number(head, kSequenceAt, sequence);
  put_number(head, kStatusAt, static_cast<std::uint32_t>(status));
  put_number(head, kActualAt, static_cast<std::uint32_t>(status == 0 ? moved : 0));
  if (!vhci_write(socket, head)) return false;
  return status != 0 || vhci_write(socket, bytes);
}

int VhciDouble::Port::control(std::span<const std::uint8_t> setup, VhciBytes& bytes) {
  constexpr std::uint8_t kVendorOut = 0x40, kStandardIn = 0x80;
  constexpr std::uint8_t kGetStatus = 0, kGetDescriptor = 6, kDevice = 1, kConfigurationKind = 2;
  const auto pair = [&](std::size_t at) {
    return static_cast<std::uint16_t>(setup[at] | (setup[at + 1] << 8));
  };
  if (setup[0] == kVendorOut) {
    board.control({setup[0], setup[1], pair(2), pair(4)}, monotonic_ns());
    return 0;
  }
  if ((setup[0] & kStandardIn) == 0) return 0;  // addresses, configurations, interfaces: as it likes
  if (setup[1] == kGetStatus) {
    bytes = {0, 0};
    return 0;
  }
  const std::uint8_t kind = setup[3];
  if (setup[1] != kGetDescriptor || (kind != kDevice && kind != kConfigurationKind)) return -EPIPE;
  bytes = kind == kDevice ? kDeviceDescriptor : kConfiguration;
  return 0;
}

std::string VhciDouble::missing() {
  if (::access((kVhci + "attach").c_str(), W_OK) == 0) return {};
  return "this needs the kernel's module vhci-hcd (`modprobe vhci-hcd`) and root; tests/nightly/run brings "
         "both";
}

VhciDouble::VhciDouble(FalconBoard& board) : port_(std::make_unique<Port>(board)) {
  plug();
}

VhciDouble::~VhciDouble() {
  if (port_->thread.joinable()) unplug();
}

void VhciDouble::with(const std::function<void(FalconBoard&)>& use) {
  const std::lock_guard lock(port_->mutex);
  use(port_->board);
}

void VhciDouble::plug() {
  const int number = free_vhci_port();
  std::array<int, 2> ends{};
  if (number < 0 || ::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0)
    vhci_fails("no port is free");
  port_->socket = ends[0];
  port_->ending = false;
  port_->waiting.clear();
  port_->thread = std::thread([port = port_.get()] { port->serve(); });
  std::ofstream attach(kVhci + "attach");
  attach << fmt::format("{} {} {} {}", number, ends[1], kBusAndDevice, kFullSpeed) << std::flush;
  if (!attach) vhci_fails("the kernel takes no device");
  ::close(ends[1]);  // the kernel has it
  if (!comes([] { return !usb_devices(kVhciVendor, kVhciProduct).empty(); }))
    vhci_fails("the device does not appear");
}

void VhciDouble::unplug() {
  port_->ending = true;
  ::shutdown(port_->socket, SHUT_RDWR);
  port_->thread.join();
  ::close(std::exchange(port_->socket, -1));
  if (!comes([] { return usb_devices(kVhciVendor, kVhciProduct).empty(); }))
    vhci_fails("the device does not go away");
}

void VhciDouble::run_at(int priority) {
  port_->priority = priority;
}

}  // namespace palpate::device
