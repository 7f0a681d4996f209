#include "device/falcon/falcon_packets.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate::device {
namespace {

constexpr std::uint8_t kFirst = '<', kLast = '>', kBase = 'A';
constexpr std::size_t kFlagsAt = 13, kSpareAt = 14, kLastAt = 15;
constexpr unsigned kNibble = 0xF, kNibbleBits = 4;
constexpr std::size_t kNibbles = 4;  // of a number
constexpr unsigned kMostReplyFlags = 0x7F, kMostCommandFlags = 0x0F;
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
  return frame_of(motors, command.flags & kMostCommandFlags);
}

FalconBytes encoded(const FalconReply& reply) noexcept {
  const unsigned flags =
      (reply.buttons & kNibble) | ((reply.homed & unsigned{FalconReply::kAllLegs}) << kHomedShift);
  return frame_of({reply.counts[0], reply.counts[1], reply.counts[2]}, flags);
}

std::optional<FalconCommand> falcon_command(
    std::span<const std::uint8_t, kFalconPacketBytes> bytes) noexcept {
  const std::optional<Framed> found = framed(bytes, kMostCommandFlags);
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
  const std::optional<Framed> found = framed(bytes, kMostReplyFlags);
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

std::optional<FalconReply> FalconReader::take(std::uint8_t byte) noexcept {
  if (size_ == 0 && byte != kFirst) {
    ++dropped_;
    return std::nullopt;
  }
  held_[size_++] = byte;
  if (size_ < kFalconPacketBytes) return std::nullopt;
  const std::optional<FalconReply> reply = falcon_reply(held_);
  if (reply) {
    last_ = held_;
    size_ = 0;
    malformed_in_a_row_ = 0;
  } else {
    ++malformed_;
    if (malformed_in_a_row_ < std::numeric_limits<std::uint32_t>::max()) ++malformed_in_a_row_;
    drop_to_next_start();
  }
  return reply;
}

void FalconReader::drop_to_next_start() noexcept {
  const auto end = held_.begin() + static_cast<std::ptrdiff_t>(size_);
  const auto next = std::find(held_.begin() + 1, end, kFirst);
  dropped_ += static_cast<std::uint64_t>(next - held_.begin());
  size_ = static_cast<std::size_t>(std::copy(next, end, held_.begin()) - held_.begin());
}

}  // namespace palpate::device
