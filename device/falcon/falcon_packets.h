// Packets of the Falcon: 16 bytes each way, one reply per command.
//
//   byte    0    1-4      5-8      9-12     13      14    15
//           '<'  motor 1  motor 2  motor 3  flags   'A'   '>'     to the device
//           '<'  leg 1    leg 2    leg 3    flags   any   '>'     from it
//
// A 16-bit number is four bytes, least significant nibble first, each nibble plus 'A'. Flags are 'A' plus: to
// the device 1 homing, 2 green, 4 blue, 8 red; from it bits 0 to 3 buttons, 4 to 6 legs homed. From public
// descriptions; colours and order of legs are unconfirmed by hardware.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include <palpate/vec.h>
#include "device/interface/stream_reader.h"

namespace palpate::device {

inline constexpr std::size_t kFalconPacketBytes = 16;
using FalconBytes = std::array<std::uint8_t, kFalconPacketBytes>;

/// Largest motor command, either sign, in published logs of the maker's program.
inline constexpr int kFalconMostCounts = 4095;

struct FalconCommand {
  static constexpr std::uint8_t kHoming = 1, kGreen = 2, kBlue = 4, kRed = 8;

  std::array<int, 3> motors{};
  std::uint8_t flags = kHoming;

  friend bool operator==(const FalconCommand&, const FalconCommand&) = default;
};

struct FalconReply {
  static constexpr std::uint8_t kAllLegs = 7;

  std::array<std::int16_t, 3> counts{};
  std::uint8_t buttons = 0;  ///< 1 right (plus), 2 forward, 4 centre, 8 left (minus)
  std::uint8_t homed = 0;    ///< one bit per leg

  friend bool operator==(const FalconReply&, const FalconReply&) = default;
};

/// Clamps each motor separately, so nothing wraps; scale before to keep the direction (falcon_motors).
[[nodiscard]] FalconBytes encoded(const FalconCommand& command) noexcept;
[[nodiscard]] FalconBytes encoded(const FalconReply& reply) noexcept;
/// Nothing if malformed.
[[nodiscard]] std::optional<FalconCommand> falcon_command(
    std::span<const std::uint8_t, kFalconPacketBytes> bytes) noexcept;
[[nodiscard]] std::optional<FalconReply> falcon_reply(
    std::span<const std::uint8_t, kFalconPacketBytes> bytes) noexcept;

/// Whether a command's bytes drive no motor. False for malformed bytes.
[[nodiscard]] bool falcon_lets_go(std::span<const std::uint8_t> bytes) noexcept;

/// Motor commands for torques (N mm) at `counts_per_n_mm`. All three are scaled together to fit, so the
/// direction stays. Zero if not finite.
[[nodiscard]] std::array<int, 3> falcon_motors(const Vec3& torques_n_mm, double counts_per_n_mm) noexcept;

struct FalconFormat {
  using Packet = FalconReply;
  static constexpr std::uint8_t kStart = '<';
  static constexpr std::size_t kBytes = kFalconPacketBytes;
  static std::optional<FalconReply> decode(std::span<const std::uint8_t, kBytes> bytes) noexcept {
    return falcon_reply(bytes);
  }
};
using FalconReader = StreamReader<FalconFormat>;

}  // namespace palpate::device
