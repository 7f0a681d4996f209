#include "device/bridge/bridge_device.h"

#include <time.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "toolkit/core/try.h"

namespace palpate::device {
namespace {

constexpr timespec kBridgeWait{0, 1'000'000};
// Three in a row, and nothing that comes can be believed.
constexpr int kMostMalformed = 3;
constexpr int kReleaseTries = 20;  // a millisecond apart: as long as the far end's own watchdog takes

Datagram release_datagram(std::uint64_t session) noexcept {
  Datagram datagram;
  datagram.kind = DatagramKind::kRelease;
  datagram.session = session;
  return datagram;
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
      most_age_ns_(std::llround(1e9 * options_.most_age_s)),
      release_(release_datagram(options_.session)) {}

void BridgeDevice::wait() const {
  if (options_.wait)
    options_.wait();
  else
    ::nanosleep(&kBridgeWait, nullptr);
}

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
    wait();
    static_cast<void>(read());
  }
  if (busy_)
    return Error{"the far end serves another program", "end that one, or wait a second after its end", name(),
                 0};
  if (!welcomed_)
    return Error{gone_ ? "nobody listens there" : "nobody answers there",
                 "start `palpate bridge --device NAME` on that machine and let its port through the firewall",
                 name(), 0};
  return Done{};
}

// What a program before this one left in the motors ends here: the far end has said that it obeys this one.
Status BridgeDevice::wait_for_obedience() {
  for (int i = 0; i < options_.open_tries; ++i) {
    command(Vec3::Zero());
    wait();
    if (read().status == ReadStatus::kFresh) return Done{};
  }
  if ((far_flags_ & Datagram::kStatusMask) != 0)
    return Error{"the far end is there, its device is not", "look at the far end: cable, power, homing",
                 name(), 0};
  return Error{"the far end does not take commands: the network is slower than " +
                   std::to_string(std::lround(1e3 * std::min(options_.most_age_s, welcome_.most_age_s))) +
                   " ms there and back, or its device has a fault",
               "use a cable, and look at the far end", name(), 0};
}

void BridgeDevice::close() noexcept {
  if (!open_) return;
  released_ = false;
  for (int i = 0; i < kReleaseTries && !released_ && !gone_; ++i) {
    link_->submit(release_.bytes());
    if (i > 0) wait();
    static_cast<void>(read());
  }
  open_ = false;
  link_->close();
}

DeviceState BridgeDevice::read() noexcept {
  state_.status = open_ ? ReadStatus::kNothingNew : ReadStatus::kLost;
  // One more byte than any datagram has: a longer one is not taken for its beginning.
  std::array<std::uint8_t, kMostDatagramBytes + 1> into;
  for (int i = 0; open_ && i < kMostPolls; ++i) {
    const Polled polled = link_->poll(into);
    gone_ = gone_ || polled.gone;
    if (polled.size == 0) break;
    const auto bytes = std::span<const std::uint8_t>(into).first(polled.size);
    const std::optional<Datagram> datagram = decoded_datagram(bytes);
    if (!datagram || datagram->session != options_.session) {
      ++counters_.malformed;
      malformed_in_a_row_ = std::min(malformed_in_a_row_ + 1, kMostMalformed);
      continue;
    }
    malformed_in_a_row_ = 0;
    take(*datagram, bytes);
  }
  if (state_.status == ReadStatus::kNothingNew && malformed_in_a_row_ >= kMostMalformed)
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
  std::copy(bytes.begin(), bytes.end(), state_.raw.bytes.begin());
  state_.raw.size = static_cast<std::uint8_t>(bytes.size());
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

}  // namespace palpate::device
