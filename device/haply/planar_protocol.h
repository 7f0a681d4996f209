// What Haply's boards say over their serial line. Source: the maker's published programs (facts).
//
//   set-up   1, address, motors (a bit for each port), a direction for each, encoders (bits), a direction for
//            each, 0 analogue inputs, 0 pulse outputs; for each encoder, by port, float32: degrees at this
//            moment, counts a turn
//   command  2, address, a float32 for each motor, by port: N*m
//   reply    address, a float32 for each encoder, by port: degrees
//
// Little-endian. No checksum, and no time-out: the board holds the last torque for ever.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "device/haply/planar_kinematics.h"
#include "device/links/newest_command.h"

namespace palpate::device {

/// One edition of the 2DIY. Motor and encoder 1 are on port 2, motor and encoder 2 on port 1.
struct PlanarModel {
  const char* name;
  PantographGeometry geometry;
  std::array<float, 2> rest_deg;  ///< angles 1 and 2 in the pose in which it is set up
  float counts_per_turn;
  std::array<std::uint8_t, 2> motor_counter, encoder_counter;  ///< counter-clockwise, by port
};
/// Of generation 2 or 3; nullptr: there is no such.
[[nodiscard]] const PlanarModel* planar_model(int generation) noexcept;

inline constexpr std::size_t kPlanarReplyBytes = 9;

[[nodiscard]] CommandBytes encoded_set_up(const PlanarModel& model) noexcept;
/// Torques of motors 1 and 2, N*m.
[[nodiscard]] CommandBytes encoded_torques(const std::array<float, 2>& torques_n_m) noexcept;
/// Zero torques six times, with a 0 between: for a board that may still wait for the rest of a command whose
/// sender died, the longest of which needs 25 bytes. It takes that rest from the first of them (what it makes
/// of them is below 1e-35 N*m, or a torque that was sent), and passes over bytes that begin no command:
/// alone, or each with the next one as its address, for which the 0 shifts every second zero by one.
[[nodiscard]] CommandBytes encoded_let_go() noexcept;

/// Finds replies in a stream that may be torn and damaged. One thread; no allocation.
class PlanarReader {
 public:
  /// Angles 1 and 2 in degrees, where `byte` ended a reply: the address, two finite numbers that an arm can
  /// have. At worst kPlanarReplyBytes^2 steps.
  [[nodiscard]] std::optional<std::array<float, 2>> take(std::uint8_t byte) noexcept;
  /// A command goes out: what has come of a reply so far belongs to none that is still to come.
  void begin() noexcept;
  [[nodiscard]] std::uint32_t malformed_in_a_row() const noexcept { return malformed_in_a_row_; }
  [[nodiscard]] const std::array<std::uint8_t, kPlanarReplyBytes>& bytes() const noexcept { return last_; }

 private:
  void drop_to_next_address() noexcept;
  void malformed() noexcept;

  std::array<std::uint8_t, kPlanarReplyBytes> held_{}, last_{};
  std::size_t size_ = 0;
  std::uint32_t malformed_in_a_row_ = 0;
};

}  // namespace palpate::device
