// The Novint Falcon: three motors, no wrist, about 100 mm workspace. Based on public descriptions and tested
// on a simulated Falcon only; docs/how-to/connect-a-device.md lists what hardware must confirm.
//
// Device frame: mm, right-handed, x right, y up, z towards the user, origin at the workspace's middle, 130 mm
// before the base.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/drivers.h>
#include <palpate/vec.h>
#include "device/falcon/falcon_boot.h"
#include "device/falcon/falcon_packets.h"
#include "device/interface/driver_options.h"

namespace palpate::device {

// Kinematics of the Falcon's delta arm of three legs, each a driven thigh and a parallelogram shin: leg
// angles of a position in closed form, the inverse by Newton's method, and the Jacobian.
//
// Frame: mm, right-handed, origin at the middle of the base, x right, y up, z towards the user. Symbols of R.
// E. Stamper's thesis (University of Maryland 1997, PhD 97-4, p. 30). All lengths are published, none
// measured here.

/// Middle of the workspace: counters near 0, all legs bent alike.
inline constexpr double kFalconCentreMm = 130.0;

/// Thigh angles (rad) of a position; nothing if a leg cannot reach it. O(1).
[[nodiscard]] std::optional<Vec3> falcon_angles(const Vec3& position_mm) noexcept;

/// A with dθ = A dp, rad/mm, for a position and its angles. Nothing at a singular pose.
[[nodiscard]] std::optional<Mat3> falcon_jacobian(const Vec3& position_mm, const Vec3& angles_rad) noexcept;

/// Thigh torques (N mm) for a force (N) at the grip: A^-T F. Nothing if A has no inverse.
[[nodiscard]] std::optional<Vec3> falcon_torques(const Mat3& jacobian, const Vec3& force_n) noexcept;

struct FalconPose {
  Vec3 position_mm = Vec3(0.0, 0.0, kFalconCentreMm);
  int steps = 0;
  bool converged = false;  ///< otherwise no position has these angles, or none was found
};
/// Most steps of falcon_position, each with at most kFalconHalvings halvings.
inline constexpr int kFalconNewtonSteps = 24, kFalconHalvings = 12;
/// Finds the position of these angles from `start_mm`, which must be reachable. Bounded, no allocation.
[[nodiscard]] FalconPose falcon_position(const Vec3& angles_rad, const Vec3& start_mm) noexcept;

/// Leg angles of encoder counts, possibly fractional. 35 degrees at 0.
[[nodiscard]] Vec3 falcon_angles_of_counts(const Vec3& counts) noexcept;

/// Motor counts per torque from public code, unconfirmed by measurement: see docs/how-to/connect-a-device.md.
inline constexpr double kFalconCountsPerNmm = 10.0;
/// N, before and after calibration with weights.
inline constexpr double kFalconFirstForce = 2.0, kFalconForce = 8.0;

struct FalconOptions {
  double counts_per_n_mm = kFalconCountsPerNmm;
  bool calibrated = false;  ///< the number was found for this device
  bool event_character = false;
  /// Gives the image if no firmware runs; empty: searches the usual places.
  std::function<Result<FalconFirmware>()> firmware;
  /// Waits some ms in open() and close().
  std::function<void(int ms)> pause = sleep_ms;
};

struct FalconCounters {
  std::uint64_t replies = 0;      ///< used, or overtaken by a newer one
  std::uint64_t malformed = 0;    ///< sixteen bytes that are no reply
  std::uint64_t dropped = 0;      ///< bytes outside replies
  std::uint64_t unreachable = 0;  ///< leg angles without a position
  std::uint64_t refused = 0;      ///< commands that the link refused
};

/// Prompt for a DeviceState::homing_step: "Pull the grip all the way out ..."; empty: homed.
[[nodiscard]] std::string falcon_homing_prompt(std::uint8_t homed_legs);
/// Zero force and a red light, for a guard process.
[[nodiscard]] FalconBytes falcon_zero() noexcept;

/// Keeps a reference to the clock.
class FalconDevice final : public Device {
 public:
  FalconDevice(std::unique_ptr<ControlLink> link, const Clock& clock, FalconOptions options);
  ~FalconDevice() override { close(); }

  [[nodiscard]] std::string name() const override { return "falcon"; }
  /// Milliseconds if firmware runs, else some seconds: see falcon_boot.h. An Error for a scale not above 0.
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override;
  /// Takes at most kMaxPolls packets and keeps the newest. Garbled after three malformed or unreachable ones
  /// in a row; until then the last position holds.
  [[nodiscard]] DeviceState read() noexcept override;
  /// Sends only zero while a leg is not homed.
  void send(GovernedForce force) noexcept override;
  bool cut_force() noexcept override;

  /// For the reading thread.
  [[nodiscard]] FalconCounters counters() const noexcept;
  [[nodiscard]] const FalconBooted& booted() const noexcept { return booted_; }
  /// One bit per leg.
  [[nodiscard]] std::uint8_t homed_legs() const noexcept { return homed_legs_; }

  /// As many as a link may gather while nobody reads.
  static constexpr int kMaxPolls = 64;

 private:
  void take(const FalconReply& reply) noexcept;
  bool submit(const FalconBytes& bytes) noexcept;

  std::unique_ptr<ControlLink> link_;
  const Clock& clock_;
  FalconOptions options_;
  FalconBytes zero_;
  FalconBooted booted_;
  FalconReader reader_;
  FalconCounters counters_;
  DeviceState state_;
  Vec3 arm_mm_ = Vec3(0.0, 0.0, kFalconCentreMm);  ///< in the kinematics' frame
  std::uint8_t homed_legs_ = 0;
  std::uint32_t unreachable_in_a_row_ = 0;
  bool open_ = false;
};

/// "falcon", or "falcon:SERIAL" for one of several. Options: `firmware=FILE`; `k=COUNTS`, motor counts per N
/// mm; `calibrated=yes` if the weight procedure of docs/how-to/connect-a-device.md found that number, for 8 N
/// instead of 2; `event-character=on`.
void register_falcon_driver(Drivers& drivers);

}  // namespace palpate::device
