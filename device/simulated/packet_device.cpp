// The device of docs/tutorials/your-device.md: counts in, counts out, over any link that carries its packets.
#include "device/simulated/packet_device.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <palpate/result.h>

namespace palpate::device {
namespace {

// More in a frame than a link can have gathered in one: what is left waits for the next frame.
constexpr int kMaxPolls = 8;
constexpr std::size_t kPollBytes = 64;
// One damaged packet happens. Three in a row, and nothing that comes can be believed.
constexpr std::uint32_t kMaxMalformed = 3;

/// The command for a force. All three are scaled together where one would not fit: the direction stays. A
/// cast that wraps would turn a large force around.
Packet command_for(const Vec3& force_n, double n_per_count) noexcept {
  constexpr double kMost = std::numeric_limits<std::int16_t>::max();
  Vec3 counts = force_n / n_per_count;
  const double largest = counts.cwiseAbs().maxCoeff();
  if (largest > kMost) counts *= kMost / largest;
  Packet command;
  command.kind = PacketKind::kCommand;
  if (!is_finite(counts)) return command;  // the governor sees to it that this never happens: zero
  for (int axis = 0; axis < 3; ++axis)
    command.counts[static_cast<std::size_t>(axis)] = static_cast<std::int16_t>(std::lround(counts[axis]));
  return command;
}

}  // namespace

PacketDevice::PacketDevice(Link& link, const Clock& clock, const PacketDeviceOptions& options)
    : link_(link), clock_(clock), options_(options), zero_(zero_command()) {}

PacketBytes PacketDevice::zero_command() noexcept {
  return encoded(command_for(Vec3::Zero(), 1.0));
}

// Ready with zero force commanded: what a program before this one left in the motors ends here.
Status PacketDevice::open() {
  close();
  PALPATE_TRY(link_.open());
  if (!link_.submit(zero_)) {
    link_.close();
    return Error{"the device takes no command", "check its cable and power", name()};
  }
  reader_.clear();
  state_ = {};
  state_.homed = false;  // until a packet says so
  has_packet_ = false;
  open_ = true;
  return Done{};
}

void PacketDevice::close() noexcept {
  if (!open_) return;
  open_ = false;
  link_.submit(zero_);
  link_.close();
}

// Every frame: takes all that has come and keeps the newest.
DeviceState PacketDevice::read() noexcept {
  state_.status = open_ ? ReadStatus::kNothingNew : ReadStatus::kLost;
  std::array<std::uint8_t, kPollBytes> bytes;
  for (int i = 0; open_ && i < kMaxPolls; ++i) {
    const Polled polled = link_.poll(bytes);
    for (const std::uint8_t byte : std::span(bytes).first(polled.size))
      if (const std::optional<Packet> packet = reader_.take(byte)) take(*packet);
    if (polled.gone) state_.status = ReadStatus::kLost;
    if (polled.size < bytes.size() || polled.gone) break;
  }
  if (state_.status == ReadStatus::kNothingNew && reader_.malformed_in_a_row() >= kMaxMalformed)
    state_.status = ReadStatus::kGarbled;
  return state_;
}

void PacketDevice::take(const Packet& packet) noexcept {
  if (packet.kind != PacketKind::kState) return;
  // A packet seen before, or one that was overtaken, says nothing new. The difference wraps as the counter.
  const auto ahead = static_cast<std::int16_t>(packet.sequence - received_);
  if (has_packet_ && ahead <= 0) return;
  has_packet_ = true;
  received_ = packet.sequence;
  for (int axis = 0; axis < 3; ++axis)
    state_.position_mm[axis] = options_.mm_per_count * packet.counts[static_cast<std::size_t>(axis)];
  state_.buttons = packet.flags & unsigned{Packet::kButtons};
  state_.homed = (packet.flags & unsigned{Packet::kHomed}) != 0;
  state_.packet_ns = clock_.now_ns();
  std::copy(reader_.bytes().begin(), reader_.bytes().end(), state_.raw.bytes.begin());
  state_.raw.size = static_cast<std::uint8_t>(kPacketBytes);
  state_.status = ReadStatus::kFresh;
}

// Every frame, zero included: motors may hold the last command for ever.
void PacketDevice::send(GovernedForce force) noexcept {
  if (!open_) return;
  Packet command = command_for(force.newtons(), options_.n_per_count);
  command.sequence = ++sent_;
  link_.submit(encoded(command));
}

// Another thread's: touches nothing but the link and what open() found made.
bool PacketDevice::cut_force() noexcept {
  return link_.submit(zero_);
}

}  // namespace palpate::device
