#include "device/bridge/bridge_device.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <palpate/result.h>
#include "device/interface/driver_options.h"
#include "device/links/udp_link.h"

namespace palpate::device {
namespace {

// Three in a row mean a broken connection.
constexpr int kMaxMalformed = 3;
constexpr int kReleaseTries = 20;  // one millisecond apart: as long as the far end's own watchdog

Datagram release_datagram(std::uint64_t session) noexcept {
  Datagram datagram;
  datagram.kind = DatagramKind::kRelease;
  datagram.session = session;
  return datagram;
}

constexpr double kSPerMs = 1e-3;

Result<UdpAddress> bridge_address(const std::string& name) {
  static const std::string kPrefix = "bridge:";
  if (!name.starts_with(kPrefix) || name.size() == kPrefix.size())
    return Error{"'" + name + "' names no far end", "write bridge:HOST:PORT"};
  std::string where = name.substr(kPrefix.size());
  const bool bare = where.find(':') == std::string::npos || where.back() == ']';
  if (bare) where += ":" + std::to_string(kBridgePort);
  return UdpAddress::of(where);
}

Result<MadeDevice> make_bridge(const DeviceRequest& request, const Clock& clock) {
  PALPATE_ASSIGN(const UdpAddress address, bridge_address(request.name));
  if (!request.description.empty())
    return Error{"the bridge has no description file", "give it to the far end",
                 request.description.string()};
  BridgeOptions options;
  options.name = request.name;
  options.session = new_session();
  double most_age_ms = options.max_age_s / kSPerMs;
  PALPATE_TRY(
      take_options(request, "the bridge", {number_option("most-age-ms", most_age_ms, {1.0, 1000.0})}));
  options.max_age_s = kSPerMs * most_age_ms;
  MadeDevice made;
  auto device = std::make_unique<BridgeDevice>(std::make_unique<UdpLink>(address), clock, options);
  made.facts = [held = device.get()] {
    const BridgeCounters& counted = held->counters();
    DeviceFacts facts = {{"far_device", std::string(held->welcome().name())}};
    add_counts(facts, {{"states", counted.states},
                       {"states_malformed", counted.malformed},
                       {"states_overtaken", counted.overtaken},
                       {"states_old", counted.old},
                       {"states_disobeying", counted.disobeying},
                       {"states_lost", counted.lost}});
    constexpr std::int64_t kNsPerUs = 1000;
    facts.emplace_back("round_trip_newest_us", std::to_string(counted.round_trip_ns / kNsPerUs));
    return facts;
  };
  made.device = std::move(device);
  made.zero = [where = address.text()] { return release_far_end(where); };
  made.homing_prompt = [](std::uint8_t) {
    return std::string("Home the device at the other machine, as `palpate live serve` tells there");
  };
  made.unproven = {
      "the bridge was run on one machine and on a pretended network, never between two machines"};
  return made;
}

}  // namespace

std::uint64_t new_session() {
  std::random_device machine;
  const std::uint64_t high = machine(), low = machine();
  return (high << 32U) | low;
}

BridgeDevice::BridgeDevice(std::unique_ptr<Link> link, const Clock& clock, BridgeOptions options)
    : link_(std::move(link)),
      clock_(clock),
      options_(std::move(options)),
      most_age_ns_(std::llround(1e9 * options_.max_age_s)),
      release_(release_datagram(options_.session)) {}

Status BridgeDevice::open() {
  close();
  PALPATE_TRY(link_->open());
  state_ = {};
  counters_ = {};
  has_newest_ = welcomed_ = busy_ = gone_ = released_ = false;
  malformed_in_a_row_ = 0;
  far_flags_ = 0;
  open_ = true;
  Status ready = wait_for_welcome();
  if (ready) ready = wait_for_obedience();
  if (!ready) close();
  return ready;
}

Status BridgeDevice::wait_for_welcome() {
  Datagram hello;
  hello.session = options_.session;
  for (int i = 0; i < options_.open_tries && !welcomed_ && !busy_; ++i) {
    hello.sequence = ++sequence_;
    sent_.note(hello.sequence, clock_.now_ns());
    link_->submit(DatagramBytes(hello).bytes());
    options_.wait();
    static_cast<void>(read());
  }
  if (busy_)
    return Error{"the far end serves another program", "end that one, or wait a second after its end",
                 name()};
  if (!welcomed_)
    return Error{
        gone_ ? "nobody listens there" : "nobody answers there",
        "start `palpate live serve --device NAME` on that machine and let its port through the firewall",
        name()};
  return Done{};
}

// One byte more than any datagram, so that longer ones are rejected and not cut.
Status BridgeDevice::wait_for_obedience() {
  for (int i = 0; i < options_.open_tries; ++i) {
    command(Vec3::Zero());
    options_.wait();
    if (read().status == ReadStatus::kFresh) return Done{};
  }
  if ((far_flags_ & Datagram::kStatusMask) != 0)
    return Error{"the far end is there, its device is not", "look at the far end: cable, power, homing",
                 name()};
  return Error{"the far end does not take commands: the network is slower than " +
                   std::to_string(std::lround(1e3 * std::min(options_.max_age_s, welcome_.max_age_s))) +
                   " ms there and back, or its device has a fault",
               "use a cable, and look at the far end", name()};
}

void BridgeDevice::close() noexcept {
  if (!open_) return;
  released_ = false;
  for (int i = 0; i < kReleaseTries && !released_ && !gone_; ++i) {
    link_->submit(release_.bytes());
    if (i > 0) options_.wait();
    static_cast<void>(read());
  }
  open_ = false;
  link_->close();
}

DeviceState BridgeDevice::read() noexcept {
  state_.status = open_ ? ReadStatus::kNothingNew : ReadStatus::kLost;
  // Also for a far end that holds zero: this may be its reason.
  std::array<std::uint8_t, kMaxDatagramBytes + 1> into;
  for (int i = 0; open_ && i < kMaxPolls; ++i) {
    const Polled polled = link_->poll(into);
    gone_ = gone_ || polled.gone;
    if (polled.size == 0) break;
    const auto bytes = std::span<const std::uint8_t>(into).first(polled.size);
    const std::optional<Datagram> datagram = decoded_datagram(bytes);
    if (!datagram || datagram->session != options_.session) {
      ++counters_.malformed;
      malformed_in_a_row_ = std::min(malformed_in_a_row_ + 1, kMaxMalformed);
      continue;
    }
    malformed_in_a_row_ = 0;
    take(*datagram, bytes);
  }
  if (state_.status == ReadStatus::kNothingNew && malformed_in_a_row_ >= kMaxMalformed)
    state_.status = ReadStatus::kGarbled;
  if (gone_) state_.status = ReadStatus::kLost;
  return state_;
}

bool BridgeDevice::is_newer(const Datagram& datagram) noexcept {
  if (has_newest_ && !counted_after(datagram.sequence, newest_)) {
    ++counters_.overtaken;
    return false;
  }
  if (has_newest_) counters_.lost += datagram.sequence - newest_ - 1;
  has_newest_ = true;
  newest_ = datagram.sequence;
  return true;
}

void BridgeDevice::take(const Datagram& datagram, std::span<const std::uint8_t> bytes) noexcept {
  if (datagram.kind == DatagramKind::kReleased) released_ = true;
  if (datagram.kind == DatagramKind::kBusy) busy_ = true;
  if (datagram.kind == DatagramKind::kWelcome && !welcomed_) {
    welcomed_ = is_newer(datagram);
    welcome_ = datagram.welcome;
  }
  if (datagram.kind != DatagramKind::kState || !welcomed_ || !is_newer(datagram)) return;
  far_flags_ = datagram.flags;
  const std::int64_t now_ns = clock_.now_ns();
  const std::optional<std::int64_t> age_ns = sent_.age_ns(datagram.answers, now_ns);
  if (!age_ns || *age_ns > most_age_ns_) {
    ++counters_.old;
    return;
  }
  counters_.round_trip_ns = *age_ns;
  if (datagram.status() == ReadStatus::kLost || datagram.status() == ReadStatus::kGarbled) {
    state_.status = datagram.status();
    return;
  }
  // Also of a far end that holds zero: that may be why it does.
  state_.homed = (datagram.flags & Datagram::kHomed) != 0;
  if ((datagram.flags & Datagram::kObeys) == 0) {
    ++counters_.disobeying;
    return;
  }
  if (datagram.status() != ReadStatus::kFresh) return;
  ++counters_.states;
  state_.position_mm = datagram.vector;
  state_.buttons = datagram.buttons;
  state_.packet_ns = now_ns;
  state_.raw.keep(bytes);
  state_.status = ReadStatus::kFresh;
}

void BridgeDevice::command(const Vec3& force_n) noexcept {
  Datagram datagram;
  datagram.kind = DatagramKind::kCommand;
  datagram.session = options_.session;
  datagram.sequence = ++sequence_;
  datagram.answers = newest_;
  datagram.vector = force_n;
  sent_.note(datagram.sequence, clock_.now_ns());
  link_->submit(DatagramBytes(datagram).bytes());
}

void BridgeDevice::send(GovernedForce force) noexcept {
  if (open_) command(force.newtons());
}

bool release_far_end(const std::string& host_and_port) {
  const Result<UdpAddress> address = UdpAddress::of(host_and_port);
  if (!address) return false;
  UdpLink link(*address);
  if (!link.open()) return false;
  const DatagramBytes bytes(release_datagram(0));
  constexpr int kTries = 50, kEvery = 10;  // one millisecond apart; repeats the request every ten
  for (int i = 0; i < kTries; ++i) {
    if (i % kEvery == 0) link.submit(bytes.bytes());
    sleep_ms();
    std::array<std::uint8_t, kMaxDatagramBytes + 1> into;
    const Polled polled = link.poll(into);
    const auto answer = decoded_datagram(std::span<const std::uint8_t>(into).first(polled.size));
    if (answer && answer->kind == DatagramKind::kReleased) return true;
  }
  return false;
}

void register_bridge_driver(Drivers& drivers) {
  drivers.add(
      {"bridge", "network",
       [] {
         return std::vector<DeviceEntry>{
             {"bridge:HOST:PORT",
              "a device at another machine, over UDP",
              DeviceStatus::kMissing,
              {"a far end: run `palpate live serve --device NAME --listen ADDRESS:PORT` on that machine"}}};
       },
       make_bridge});
}

}  // namespace palpate::device
