// Haply's 2DIY over its serial line. Two degrees of freedom: z is always 0, forces along z are not shown. The
// board holds the last torque for ever, so zero is sent on every path: opening, closing, destruction,
// cut_force, guard, and when a force ends.
#pragma once

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/drivers.h>
#include <palpate/device/link.h>
#include <palpate/vec.h>
#include "device/interface/stream_reader.h"
#include "device/links/newest_command.h"

namespace palpate::device {

// Serial messages of Haply's boards. Source: the maker's published programs (facts).
//
//   set-up   1, address, motors (a bit for each port), a direction for each, encoders (bits), a direction for
//            each, 0 analogue inputs, 0 pulse outputs; for each encoder, by port, float32: degrees at this
//            moment, counts a turn
//   command  2, address, a float32 for each motor, by port: N*m
//   reply    address, a float32 for each encoder, by port: degrees
//
// Little-endian. No checksum and no time-out: the board holds the last torque for ever.

/// The 2DIY's pantograph: two motors side by side, two arms of two bars that meet in the grip. Plane: x from
/// the first motor's axis to the second's, y away from them. Lengths mm, angles rad from x. Source: the
/// maker's published kinematics, derived anew.
struct PantographGeometry {
  double crank_mm = 70.0, bar_mm = 90.0;
  double between_mm = 0.0;  ///< between the motors' axes: 0 if coaxial
};

struct PantographPose {
  Eigen::Vector2d position_mm = Eigen::Vector2d::Zero();
  Eigen::Matrix2d mm_per_rad = Eigen::Matrix2d::Zero();  ///< column i: derivative by motor i
};

/// Nothing if the bars do not meet, or are too nearly aligned for the cranks to determine the grip. Takes the
/// solution away from the motors.
[[nodiscard]] std::optional<PantographPose> pantograph_pose(const PantographGeometry& geometry,
                                                            const std::array<double, 2>& angles) noexcept;

/// One edition of the 2DIY. Motor and encoder 1 are on port 2, motor and encoder 2 on port 1.
struct PlanarModel {
  const char* name;
  PantographGeometry geometry;
  std::array<float, 2> rest_deg;  ///< angles 1 and 2 in the set-up pose
  float counts_per_turn;
  std::array<std::uint8_t, 2> motor_counter, encoder_counter;  ///< counter-clockwise, by port
};
/// Generation 2 or 3; nullptr: unknown.
[[nodiscard]] const PlanarModel* planar_model(int generation) noexcept;

inline constexpr std::size_t kPlanarReplyBytes = 9;

[[nodiscard]] CommandBytes encoded_set_up(const PlanarModel& model) noexcept;
[[nodiscard]] CommandBytes encoded_torques(const std::array<float, 2>& torques_n_m) noexcept;
/// Zero torques six times, with a 0 between, for a board that may wait for the rest of a dead sender's
/// command, at most 25 bytes. The first zeros become that rest (below 1e-35 N*m, or a torque already sent).
/// The board skips bytes that begin no command alone, or each with the next as its address; for that case the
/// 0 shifts every second zero by one.
[[nodiscard]] CommandBytes encoded_release() noexcept;

/// Replies: angles 1 and 2 in degrees, two finite and plausible numbers after the board's address.
struct PlanarFormat {
  using Packet = std::array<float, 2>;
  static constexpr std::uint8_t kStart = 5;  ///< address of the 2DIY
  static constexpr std::size_t kBytes = kPlanarReplyBytes;
  [[nodiscard]] static std::optional<Packet> decode(std::span<const std::uint8_t, kBytes> bytes) noexcept;
};
/// A reply that is still partial when the next command goes out is discarded by begin().
using PlanarReader = StreamReader<PlanarFormat>;

struct PlanarOptions {
  double torque_cap_n_mm = 123.0;  ///< per motor, the board's own clamp; both are scaled together
  double force_max_n = 1.5;        ///< reachable everywhere in the workspace
  int open_tries = 200;            ///< polls of open() for a first reply, 5 ms apart; 0: does not wait
};

/// For a guard process with its own open link: releases the motors whatever partial command the dead program
/// left in the board. Sends zeros; then, twice, waits for silence and sends a zero that the board must
/// answer. Otherwise starts again, at most five times: 0.4 s. False: not released.
[[nodiscard]] bool release_plane(Link& link) noexcept;

/// Keeps references to clock and model.
class PlanarDevice final : public Device {
 public:
  PlanarDevice(std::unique_ptr<Link> link, const Clock& clock, const PlanarModel& model,
               const PlanarOptions& options = {});
  ~PlanarDevice() override { close(); }

  [[nodiscard]] std::string name() const override { return "planar"; }
  /// The grip must be in its rest pose, at the base, where the encoders start.
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override;
  [[nodiscard]] DeviceState read() noexcept override;
  /// Sends one command per reply, one more after 20 ms without any, and one at once when the force ends.
  void send(GovernedForce force) noexcept override;
  bool cut_force() noexcept override;

  /// Middle of the workspace in the pantograph's plane, mm.
  [[nodiscard]] Eigen::Vector2d origin_mm() const noexcept;
  static constexpr int kMaxPolls = 8;

 private:
  void take(const std::array<float, 2>& degrees) noexcept;
  void poll_all() noexcept;
  [[nodiscard]] std::array<float, 2> torques_for(const Vec3& force_n) const noexcept;

  std::unique_ptr<Link> link_;
  const Clock& clock_;
  const PlanarModel& model_;
  PlanarOptions options_;
  CommandBytes zero_;
  PlanarReader reader_;
  DeviceState state_;
  std::optional<PantographPose> pose_;
  bool open_ = false, gone_ = false, awaiting_ = false, sent_zero_ = true;
  std::int64_t sent_ns_ = 0;
};

/// "planar". Options: path (required: its board shares its name with many), generation (2 or 3), force_n.
void register_planar_driver(Drivers& drivers);

}  // namespace palpate::device
