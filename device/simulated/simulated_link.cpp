#include "device/simulated/simulated_link.h"

#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>
#include <new>
#include <utility>

#include "device/simulated/packets.h"

namespace palpate::device {
namespace {

constexpr int kFlippedBits = 5;  // more than the checksum guarantees to detect, fewer than hide the packet
// Clock and sample times are rounded: a packet due within this share of its interval is there.
constexpr double kDueShare = 1e-6;

std::int16_t counts_of(double mm, double mm_per_count) noexcept {
  constexpr double kLeast = std::numeric_limits<std::int16_t>::min();
  constexpr double kMost = std::numeric_limits<std::int16_t>::max();
  return static_cast<std::int16_t>(std::lround(std::clamp(mm / mm_per_count, kLeast, kMost)));
}

}  // namespace

void SimulatedBoard::hold(std::uint64_t packed, std::int64_t now_ns) noexcept {
  // Time first: a reader that sees zero sees its time.
  if (packed == 0 && holds_force()) zeroed_ns_.store(now_ns, std::memory_order_release);
  held_.store(packed, std::memory_order_release);
}

void SimulatedBoard::command(std::span<const std::uint8_t> bytes, std::int64_t now_ns) noexcept {
  if (!plugged()) return;
  std::optional<Packet> packet;
  if (bytes.size() == kPacketBytes) packet = decoded(bytes.first<kPacketBytes>());
  if (!packet || packet->kind != PacketKind::kCommand) {
    refused_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  std::uint64_t packed = 0;
  for (std::size_t axis = 0; axis < packet->counts.size(); ++axis)
    packed |= std::uint64_t{static_cast<std::uint16_t>(packet->counts[axis])} << (16U * axis);
  hold(packed, now_ns);
  commands_.fetch_add(1, std::memory_order_relaxed);
}

void SimulatedBoard::unplug(std::int64_t now_ns) noexcept {
  plugged_.store(false, std::memory_order_release);
  hold(0, now_ns);
}

SimulatedBoard::Counts SimulatedBoard::held() const noexcept {
  const std::uint64_t packed = held_.load(std::memory_order_acquire);
  Counts counts{};
  for (std::size_t axis = 0; axis < counts.size(); ++axis)
    counts[axis] = static_cast<std::int16_t>(static_cast<std::uint16_t>(packed >> (16U * axis)));
  return counts;
}

Result<SharedBoard> SharedBoard::create() {
  void* memory =
      ::mmap(nullptr, sizeof(SimulatedBoard), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED)
    return Error{std::string("no memory for the simulated board: ") + std::strerror(errno),
                 "close other programs"};
  return SharedBoard(new (memory) SimulatedBoard);
}

void SharedBoard::Unmap::operator()(SimulatedBoard* board) const noexcept {
  ::munmap(board, sizeof(SimulatedBoard));
}

SimulatedLink::SimulatedLink(SimulatedBoard& board, const HandScript& script, const Clock& clock,
                             const SimulatedLinkOptions& options, std::vector<LinkFault> faults)
    : board_(board),
      script_(script),
      clock_(clock),
      options_(options),
      faults_(std::move(faults)),
      random_(options.seed) {}

Status SimulatedLink::open() {
  if (!(options_.rate_hz > 0.0) || !std::isfinite(options_.rate_hz) || !(options_.mm_per_count > 0.0))
    return Error{"the simulated link's rate or counts are not right", "give finite numbers above 0"};
  if (!board_.plugged()) return Error{"the simulated board is unplugged", "plug it in"};
  opened_s_ = clock_.now_s();
  newest_ = -1;
  open_.store(true);
  return Done{};
}

void SimulatedLink::close() noexcept {
  open_.store(false);
}

// Works after close() too, for a watchdog or guard.
bool SimulatedLink::submit(std::span<const std::uint8_t> bytes) noexcept {
  if (!board_.plugged()) return false;
  board_.command(bytes, clock_.now_ns());
  return true;
}

const LinkFault* SimulatedLink::fault_at(double t_s) const noexcept {
  for (const LinkFault& fault : faults_)
    if (t_s >= fault.start_s && t_s < fault.start_s + fault.duration_s) return &fault;
  return nullptr;
}

Packet SimulatedLink::packet_of(std::int64_t index, const LinkFault* fault) const noexcept {
  Vec3 place_mm = script_.at(static_cast<double>(index) / options_.rate_hz).position_mm;
  Packet packet;
  packet.sequence = static_cast<std::uint16_t>(index);
  packet.flags = options_.flags;
  if (fault != nullptr && fault->kind == LinkFault::Kind::kJump) place_mm += fault->jump_mm;
  if (fault != nullptr && fault->kind == LinkFault::Kind::kUnhomed)
    packet.flags &= static_cast<std::uint8_t>(~unsigned{Packet::kHomed});
  for (int axis = 0; axis < 3; ++axis)
    packet.counts[static_cast<std::size_t>(axis)] = counts_of(place_mm[axis], options_.mm_per_count);
  return packet;
}

/// Applies the fault to the bytes; returns how many arrive.
std::size_t SimulatedLink::apply_fault(PacketBytes& bytes, const LinkFault* fault) noexcept {
  if (fault == nullptr) return bytes.size();
  if (fault->kind == LinkFault::Kind::kShort) return bytes.size() / 2;
  if (fault->kind == LinkFault::Kind::kGarbled)
    for (int i = 0; i < kFlippedBits; ++i)
      bytes[random_.below(kPacketBytes)] ^= static_cast<std::uint8_t>(1U << random_.below(8));
  return bytes.size();
}

Polled SimulatedLink::poll(std::span<std::uint8_t> into) noexcept {
  if (!open_.load() || !board_.plugged()) return {0, true};
  const double t_s = clock_.now_s() - opened_s_;
  const LinkFault* fault = fault_at(t_s);
  const auto is = [&](LinkFault::Kind kind) { return fault != nullptr && fault->kind == kind; };
  if (is(LinkFault::Kind::kUnplugged)) {
    board_.unplug(clock_.now_ns());
    return {0, true};
  }
  if (is(LinkFault::Kind::kSilent) || into.size() < kPacketBytes) return {};
  const double age_s = is(LinkFault::Kind::kLate) ? fault->late_s : 0.0;
  const auto index = static_cast<std::int64_t>(std::floor((t_s - age_s) * options_.rate_hz + kDueShare));
  if (index <= newest_) return {};
  newest_ = index;
  PacketBytes bytes = encoded(packet_of(index, fault));
  if (is(LinkFault::Kind::kDuplicated)) bytes = last_;
  last_ = bytes;
  if (is(LinkFault::Kind::kLost) && index % fault->of != 0) return {};
  const std::size_t size = apply_fault(bytes, fault);
  std::copy_n(bytes.begin(), size, into.begin());
  return {size, false};
}

}  // namespace palpate::device
