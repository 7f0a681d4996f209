// The Falcon's packets: 16 bytes each way, one reply for each command.
//
//   byte    0    1-4      5-8      9-12     13      14    15
//           '<'  motor 1  motor 2  motor 3  flags   'A'   '>'     to the device
//           '<'  leg 1    leg 2    leg 3    flags   any   '>'     from it
//
// A 16-bit number is four bytes, its least significant nibble first, each nibble plus 'A'. Flags are 'A'
// plus: to the device 1 homing, 2 green, 4 blue, 8 red; from it bits 0 to 3 buttons, 4 to 6 legs homed. Taken
// from public descriptions; the colours and the order of the legs' flags are not confirmed by hardware.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "toolkit/core/vec.h"

namespace palpate::device {

inline constexpr std::size_t kFalconPacketBytes = 16;
using FalconBytes = std::array<std::uint8_t, kFalconPacketBytes>;

/// The most that a motor's command may be, either way: published logs of the maker's own program stop here.
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
  std::uint8_t homed = 0;    ///< one bit a leg

  friend bool operator==(const FalconReply&, const FalconReply&) = default;
};

/// Motors beyond the limit are held there, each for itself, so that no number ever wraps; who wants the
/// direction kept scales before (falcon_motors).
[[nodiscard]] FalconBytes encoded(const FalconCommand& command) noexcept;
[[nodiscard]] FalconBytes encoded(const FalconReply& reply) noexcept;
/// Nothing where it is none.
[[nodiscard]] std::optional<FalconCommand> falcon_command(
    std::span<const std::uint8_t, kFalconPacketBytes> bytes) noexcept;
[[nodiscard]] std::optional<FalconReply> falcon_reply(
    std::span<const std::uint8_t, kFalconPacketBytes> bytes) noexcept;

/// Of a command's bytes: no motor is given anything, whatever the flags. What is no command does not let go.
[[nodiscard]] bool falcon_lets_go(std::span<const std::uint8_t> bytes) noexcept;

/// Motor commands for torques in N mm at `counts_per_n_mm`. All three are scaled together where one would
/// not fit: the direction stays. Zero for what is not finite.
[[nodiscard]] std::array<int, 3> falcon_motors(const Vec3& torques_n_mm, double counts_per_n_mm) noexcept;

/// Finds replies in a stream that may be torn, glued and damaged. One thread; no allocation.
class FalconReader {
 public:
  /// Takes the next byte: a reply where it was the last byte of one. After damage it looks on from the next
  /// '<' that it holds. Bounded: kFalconPacketBytes^2 steps for a byte at worst.
  [[nodiscard]] std::optional<FalconReply> take(std::uint8_t byte) noexcept;
  /// Of the reply that take() gave last.
  [[nodiscard]] const FalconBytes& bytes() const noexcept { return last_; }
  /// Sixteen bytes from a '<' on that were no reply, since the last reply.
  [[nodiscard]] std::uint32_t malformed_in_a_row() const noexcept { return malformed_in_a_row_; }
  [[nodiscard]] std::uint64_t malformed() const noexcept { return malformed_; }
  /// Bytes that belonged to no reply, ever.
  [[nodiscard]] std::uint64_t dropped() const noexcept { return dropped_; }
  void clear() noexcept { *this = {}; }

 private:
  void drop_to_next_start() noexcept;

  FalconBytes held_{}, last_{};
  std::size_t size_ = 0;
  std::uint32_t malformed_in_a_row_ = 0;
  std::uint64_t malformed_ = 0, dropped_ = 0;
};

}  // namespace palpate::device
