#include "device/bridge/bridge_server.h"

#include <algorithm>
#include <cmath>

#include <palpate/result.h>

namespace palpate::device {
namespace {

// After this silence another program may take the place of one that ended without a release.
constexpr double kSessionS = 1.0;
constexpr double kNsPerSecond = 1e9;
constexpr double kUsPerNs = 1e-3;

std::array<char, BridgeWelcome::kNameBytes> name_bytes_of(const std::string& name) noexcept {
  std::array<char, BridgeWelcome::kNameBytes> bytes{};
  for (std::size_t i = 0; i < std::min(name.size(), bytes.size()); ++i)
    bytes[i] = name[i] >= ' ' && name[i] <= '~' ? name[i] : '?';
  return bytes;
}

}  // namespace

BridgeServer::BridgeServer(Device& device, DatagramPort& port, const Clock& clock,
                           const BridgeServerOptions& options) noexcept
    : device_(device), port_(port), clock_(clock), options_(options) {}

Status BridgeServer::open() {
  for (const auto& [name, value] : {std::pair{"rate_hz", options_.rate_hz},
                                    {"watchdog_s", options_.watchdog_s},
                                    {"max_age_s", options_.max_age_s}})
    if (!(std::isfinite(value) && value > 0.0))
      return Error{std::string(name) + " is " + std::to_string(value), "give a finite number above 0"};
  PALPATE_TRY(device_.open());
  open_ = true;
  welcome_.limits = device_.limits();
  welcome_.watchdog_s = options_.watchdog_s;
  welcome_.max_age_s = options_.max_age_s;
  welcome_.name_bytes = name_bytes_of(device_.name());
  GovernorOptions governed;
  governed.period_s = 1.0 / options_.rate_hz;
  governed.user_limit_n = options_.user_limit_n > 0.0 ? options_.user_limit_n : welcome_.limits.force_max_n;
  governed.slew_n_per_s = options_.slew_n_per_s;
  governed.late_zero_s = options_.late_zero_s;
  governed.latch_late_s = options_.latch_late_s;
  governed.silence_s = options_.silence_s;
  // The other side's governor already fades at the workspace's edge and with speed.
  governed.edge_share = 0.0;
  governed.fade_from_mm_per_s = 0.0;
  Result<ForceGovernor> made = ForceGovernor::create(welcome_.limits, governed);
  if (!made) {
    close();
    return std::move(made).error();
  }
  governor_ = std::make_unique<ForceGovernor>(std::move(made).value());
  return Done{};
}

void BridgeServer::close() noexcept {
  if (!open_) return;
  open_ = false;
  device_.close();
}

bool BridgeServer::in_session() const noexcept {
  return has_session_ && static_cast<double>(clock_.now_ns() - accepted_ns_) <= kSessionS * kNsPerSecond;
}

void BridgeServer::tick() noexcept {
  if (!open_ || governor_ == nullptr) return;
  if (heart_ != nullptr) heart_->beat();
  ++counters_.ticks;
  receive();
  const DeviceState state = device_.read();
  const Vec3 force_n = wanted();
  device_.send(governor_->govern(clock_.now_s(), state, force_n));
  tell(state);
}

void BridgeServer::receive() noexcept {
  // One byte more than any datagram, so that longer ones are rejected and not cut.
  std::array<std::uint8_t, kMaxDatagramBytes + 1> into;
  for (int i = 0; i < kMaxDatagrams; ++i) {
    Peer from;
    const std::size_t size = port_.receive(into, from);
    if (size == 0) return;
    const std::optional<Datagram> datagram =
        decoded_datagram(std::span<const std::uint8_t>(into).first(size));
    if (datagram)
      take(*datagram, from);
    else
      ++counters_.malformed;
  }
}

void BridgeServer::take(const Datagram& datagram, const Peer& from) noexcept {
  switch (datagram.kind) {
    case DatagramKind::kHello:
      return greet(datagram, from);
    case DatagramKind::kRelease:
      return release(datagram, from);
    case DatagramKind::kCommand:
      if (!has_session_ || datagram.session != session_ || !(from == peer_)) {
        ++counters_.strange;
        return;
      }
      return accept(datagram);
    case DatagramKind::kWelcome:
    case DatagramKind::kBusy:
    case DatagramKind::kState:
    case DatagramKind::kReleased:
      ++counters_.strange;  // only this side may send these
      return;
  }
}

void BridgeServer::greet(const Datagram& hello, const Peer& from) noexcept {
  const bool known = has_session_ && hello.session == session_;
  if (!known && in_session()) {
    Datagram busy;
    busy.kind = DatagramKind::kBusy;
    busy.session = hello.session;
    return answer(busy, from);
  }
  if (!known) {
    // Commands count anew; those of the old session are foreign from now on.
    latch();
    has_session_ = true;
    has_accepted_ = false;
    session_ = hello.session;
    accepted_ = hello.sequence;
    ++counters_.sessions;
  }
  peer_ = from;
  Datagram datagram;
  datagram.kind = DatagramKind::kWelcome;
  datagram.session = session_;
  datagram.answers = hello.sequence;
  datagram.welcome = welcome_;
  answer(datagram, from);
}

void BridgeServer::accept(const Datagram& command) noexcept {
  if (!counted_after(command.sequence, accepted_)) {
    ++counters_.overtaken;
    return;
  }
  const std::int64_t now_ns = clock_.now_ns();
  const std::optional<std::int64_t> age_ns = sent_.age_ns(command.answers, now_ns);
  if (!age_ns || static_cast<double>(*age_ns) > options_.max_age_s * kNsPerSecond) {
    ++counters_.old;
    // An old force is ignored, but a zero latches at any age: a host that hears nothing has nothing newer to
    // answer. It arms nothing and does not restart the watchdog.
    if (command.vector.isZero(0.0)) {
      latch();
      accepted_ = command.sequence;
    }
    return;
  }
  ++counters_.accepted;
  accepted_ = command.sequence;
  accepted_ns_ = now_ns;
  has_accepted_ = true;
  force_n_ = command.vector;
  const bool given_up = heart_ != nullptr && heart_->tripped();
  if (governor_->armed() || !force_n_.isZero(0.0)) return;
  if (given_up) heart_->rearm();
  governor_->arm(clock_.now_s());
}

void BridgeServer::release(const Datagram& datagram, const Peer& from) noexcept {
  ++counters_.releases;
  latch();
  // Immediately, not at the tick's end: the tick may still stall.
  static_cast<void>(device_.cut_force());
  Datagram done;
  done.kind = DatagramKind::kReleased;
  done.session = datagram.session;
  answer(done, from);
}

void BridgeServer::latch() noexcept {
  force_n_.setZero();
  governor_->disarm();
}

Vec3 BridgeServer::wanted() noexcept {
  if (heart_ != nullptr && heart_->tripped()) governor_->latch(Fault::kStalled);
  const auto since_ns = static_cast<double>(clock_.now_ns() - accepted_ns_);
  if (governor_->armed() && (!has_accepted_ || since_ns > options_.watchdog_s * kNsPerSecond)) {
    ++counters_.trips;
    latch();
  }
  return force_n_;
}

void BridgeServer::tell(const DeviceState& state) noexcept {
  if (!has_session_) return;
  Datagram datagram;
  datagram.kind = DatagramKind::kState;
  datagram.session = session_;
  datagram.answers = accepted_;
  datagram.vector = state.position_mm;
  datagram.buttons = state.buttons;
  // Without a packet time a state is never old.
  const std::int64_t old_ns = state.packet_ns > 0 ? clock_.now_ns() - state.packet_ns : 0;
  const double age_us = kUsPerNs * static_cast<double>(std::max<std::int64_t>(0, old_ns));
  constexpr double kMaxUs = 4e9;
  datagram.age_us = static_cast<std::uint32_t>(std::min(age_us, kMaxUs));
  datagram.flags = static_cast<std::uint16_t>(static_cast<unsigned>(state.status) << Datagram::kStatusShift);
  if (state.homed) datagram.flags |= Datagram::kHomed;
  if (governor_->armed()) datagram.flags |= Datagram::kObeys;
  answer(datagram, peer_);
}

void BridgeServer::answer(Datagram datagram, const Peer& to) noexcept {
  // Busy and released may go to others, so they do not count in the session's sequence.
  if (datagram.kind == DatagramKind::kState || datagram.kind == DatagramKind::kWelcome) {
    datagram.sequence = ++sequence_;
    sent_.note(datagram.sequence, clock_.now_ns());
  }
  port_.send(DatagramBytes(datagram).bytes(), to);
}

}  // namespace palpate::device
