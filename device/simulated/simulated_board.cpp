#include "device/simulated/simulated_board.h"

#include <sys/mman.h>

#include <cerrno>
#include <cstring>
#include <new>

#include "device/simulated/packets.h"

namespace palpate::device {

void SimulatedBoard::hold(std::uint64_t packed, std::int64_t now_ns) noexcept {
  // The time first: who sees zero sees when.
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
                 "close other programs", "", 0};
  return SharedBoard(new (memory) SimulatedBoard);
}

void SharedBoard::Unmap::operator()(SimulatedBoard* board) const noexcept {
  ::munmap(board, sizeof(SimulatedBoard));
}

}  // namespace palpate::device
