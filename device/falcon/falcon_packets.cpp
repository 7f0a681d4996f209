#include "device/falcon/falcon_packets.h"

#include <algorithm>
#include <cmath>

namespace palpate::device {
namespace {

constexpr std::uint8_t kFirst = '<', kLast = '>', kBase = 'A';
constexpr std::size_t kFlagsAt = 13, kSpareAt = 14, kLastAt = 15;
constexpr unsigned kNibble = 0xF, kNibbleBits = 4;
constexpr std::size_t kNibbles = 4;  // per number
constexpr unsigned kMaxReplyFlags = 0x7F, kMaxCommandFlags = 0x0F;
constexpr unsigned kHomedShift = 4;

void put_number(FalconBytes& bytes, std::size_t axis, int value) noexcept {
  const auto bits = static_cast<unsigned>(static_cast<std::uint16_t>(value));
  for (std::size_t i = 0; i < kNibbles; ++i)
    bytes[1 + kNibbles * axis + i] =
        static_cast<std::uint8_t>(kBase + ((bits >> (kNibbleBits * i)) & kNibble));
}

FalconBytes frame_of(const std::array<int, 3>& numbers, unsigned flags) noexcept {
  FalconBytes bytes{};
  bytes[0] = kFirst;
  for (std::size_t axis = 0; axis < numbers.size(); ++axis) put_number(bytes, axis, numbers[axis]);
  bytes[kFlagsAt] = static_cast<std::uint8_t>(kBase + flags);
  bytes[kSpareAt] = kBase;
  bytes[kLastAt] = kLast;
  return bytes;
}

struct Framed {
  std::array<std::int16_t, 3> numbers{};
  unsigned flags = 0;
};

std::optional<Framed> framed(std::span<const std::uint8_t, kFalconPacketBytes> bytes,
                             unsigned most_flags) noexcept {
  if (bytes[0] != kFirst || bytes[kLastAt] != kLast) return std::nullopt;
  Framed result;
  for (std::size_t axis = 0; axis < result.numbers.size(); ++axis) {
    unsigned bits = 0;
    for (std::size_t i = 0; i < kNibbles; ++i) {
      const unsigned nibble = unsigned{bytes[1 + kNibbles * axis + i]} - kBase;  // wraps below 'A'
      if (nibble > kNibble) return std::nullopt;
      bits |= nibble << (kNibbleBits * i);
    }
    result.numbers[axis] = static_cast<std::int16_t>(static_cast<std::uint16_t>(bits));
  }
  result.flags = unsigned{bytes[kFlagsAt]} - kBase;  // unsigned: a homed reply's byte is above 0x7F
  if (result.flags > most_flags) return std::nullopt;
  return result;
}

}  // namespace

FalconBytes encoded(const FalconCommand& command) noexcept {
  std::array<int, 3> motors{};
  for (std::size_t axis = 0; axis < motors.size(); ++axis)
    motors[axis] = std::clamp(command.motors[axis], -kFalconMostCounts, kFalconMostCounts);
  return frame_of(motors, command.flags & kMaxCommandFlags);
}

FalconBytes encoded(const FalconReply& reply) noexcept {
  const unsigned flags =
      (reply.buttons & kNibble) | ((reply.homed & unsigned{FalconReply::kAllLegs}) << kHomedShift);
  return frame_of({reply.counts[0], reply.counts[1], reply.counts[2]}, flags);
}

std::optional<FalconCommand> falcon_command(
    std::span<const std::uint8_t, kFalconPacketBytes> bytes) noexcept {
  const std::optional<Framed> found = framed(bytes, kMaxCommandFlags);
  if (!found) return std::nullopt;
  return FalconCommand{{found->numbers[0], found->numbers[1], found->numbers[2]},
                       static_cast<std::uint8_t>(found->flags)};
}

bool falcon_lets_go(std::span<const std::uint8_t> bytes) noexcept {
  if (bytes.size() != kFalconPacketBytes) return false;
  const std::optional<FalconCommand> command = falcon_command(bytes.first<kFalconPacketBytes>());
  return command && command->motors == std::array<int, 3>{};
}

std::optional<FalconReply> falcon_reply(std::span<const std::uint8_t, kFalconPacketBytes> bytes) noexcept {
  const std::optional<Framed> found = framed(bytes, kMaxReplyFlags);
  if (!found) return std::nullopt;
  return FalconReply{found->numbers, static_cast<std::uint8_t>(found->flags & kNibble),
                     static_cast<std::uint8_t>(found->flags >> kHomedShift)};
}

std::array<int, 3> falcon_motors(const Vec3& torques_n_mm, double counts_per_n_mm) noexcept {
  Vec3 counts = -counts_per_n_mm * torques_n_mm;
  if (!is_finite(counts)) return {};
  const double largest = counts.cwiseAbs().maxCoeff();
  if (largest > kFalconMostCounts) counts *= kFalconMostCounts / largest;
  std::array<int, 3> motors{};
  for (std::size_t axis = 0; axis < motors.size(); ++axis)
    motors[axis] = static_cast<int>(std::lround(counts[static_cast<Eigen::Index>(axis)]));
  return motors;
}

}  // namespace palpate::device
