#include "tests/device/mock/hidraw_double.h"

#include <fcntl.h>
#include <linux/uhid.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "device/links/hid_link.h"
#include "tests/device/helpers.h"

namespace palpate::device {
namespace {

/// Of its reports, in and out.
constexpr std::uint8_t kUhidBytes = 8;

constexpr const char* kUhid = "/dev/uhid";
constexpr std::uint16_t kBusUsb = 3;
constexpr int kUhidLookMs = 5;

template <class Place>
void copy_name(Place& place, const std::string& name) {
  std::copy_n(name.begin(), std::min(name.size(), sizeof place - 1), place);
}

}  // namespace

struct UhidDouble::Node {
  Node(const HidrawIdentity& who, Answer what) : identity(who), answer(std::move(what)) {}

  void send(const uhid_event& event) const {
    if (::write(file, &event, sizeof event) == static_cast<ssize_t>(sizeof event)) return;
    std::perror(kUhid);
    std::abort();
  }
  void give(const Bytes& bytes) const {
    uhid_event event{};
    event.type = UHID_INPUT2;
    event.u.input2.size = static_cast<__u16>(bytes.size());
    std::copy(bytes.begin(), bytes.end(), event.u.input2.data);
    send(event);
  }
  void listen();
  [[nodiscard]] bool found() const {
    HidAddress address;
    address.vendor = identity.vendor;
    address.product = identity.product;
    return !hid_devices(address).empty();
  }
  void await(bool there) const {
    if (comes([&] { return found() == there; })) return;
    std::fprintf(stderr, "uhid: the device does not %s\n", there ? "appear" : "go away");
    std::abort();
  }

  HidrawIdentity identity;
  Answer answer;
  int file = -1;
  std::atomic<bool> ending{false};
  std::thread thread;
};

void UhidDouble::Node::listen() {
  while (!ending) {
    pollfd ready{file, POLLIN, 0};
    uhid_event event{};
    if (::poll(&ready, 1, kUhidLookMs) <= 0 || ::read(file, &event, sizeof event) <= 0) continue;
    if (event.type != UHID_OUTPUT || !answer) continue;
    const std::span<const std::uint8_t> bytes(event.u.output.data, event.u.output.size);
    if (const std::optional<Bytes> reply = answer(bytes)) give(*reply);
  }
}

std::string UhidDouble::missing() {
  if (::access(kUhid, R_OK | W_OK) == 0) return {};
  return "this needs the kernel's module uhid (`modprobe uhid`) and root; tests/nightly/run brings both";
}

UhidDouble::UhidDouble(const HidrawIdentity& identity, Answer answer)
    : node_(std::make_unique<Node>(identity, std::move(answer))) {
  plug();
}

UhidDouble::~UhidDouble() {
  if (node_->thread.joinable()) unplug();
}

void UhidDouble::report(const Bytes& bytes) {
  node_->give(bytes);
}

void UhidDouble::plug() {
  Node& node = *node_;
  node.file = ::open(kUhid, O_RDWR | O_CLOEXEC);
  uhid_event event{};
  event.type = UHID_CREATE2;
  uhid_create2_req& create = event.u.create2;
  const std::vector<std::uint8_t> descriptor = hid_descriptor(node.identity, kUhidBytes);
  copy_name(create.name, node.identity.product_name);
  copy_name(create.uniq, node.identity.serial);
  create.rd_size = static_cast<__u16>(descriptor.size());
  create.bus = kBusUsb;
  create.vendor = node.identity.vendor;
  create.product = node.identity.product;
  std::copy(descriptor.begin(), descriptor.end(), create.rd_data);
  node.send(event);
  node.ending = false;
  node.thread = std::thread([raw = node_.get()] { raw->listen(); });
  node.await(true);
}

void UhidDouble::unplug() {
  Node& node = *node_;
  uhid_event event{};
  event.type = UHID_DESTROY;
  node.send(event);
  node.ending = true;
  node.thread.join();
  ::close(std::exchange(node.file, -1));
  node.await(false);
}

}  // namespace palpate::device
