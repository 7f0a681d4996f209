// The Novint Falcon: three motors, no wrist, about 100 mm across. Everything here was taken from public
// descriptions and shown on a simulated Falcon alone; docs/devices.md says what waits for hardware.
//
// Device frame: mm, right-handed, x right, y up, z towards the user, from the middle of the workspace, which
// is 130 mm before the base.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "device/falcon/falcon_boot.h"
#include "device/falcon/falcon_kinematics.h"
#include "device/falcon/falcon_packets.h"
#include "device/interface/device.h"
#include "toolkit/core/clock.h"

namespace palpate::device {

/// Motor counts for a torque, as public code has it. No measurement confirms it: see docs/devices.md.
inline constexpr double kFalconCountsPerNmm = 10.0;
/// N, before and after the scale was found by weights.
inline constexpr double kFalconFirstForce = 2.0, kFalconForce = 8.0;

struct FalconOptions {
  double counts_per_n_mm = kFalconCountsPerNmm;
  bool calibrated = false;  ///< that number was found for this very device
  bool event_character = false;
  /// Asked where no firmware runs; empty: looked for in the usual places.
  std::function<Result<FalconFirmware>()> firmware;
  /// Waits so many ms in open() and close(); empty: sleeps.
  std::function<void(int ms)> pause;
};

struct FalconCounters {
  std::uint64_t replies = 0;      ///< that were used or overtaken by a newer one
  std::uint64_t malformed = 0;    ///< sixteen bytes that were none
  std::uint64_t dropped = 0;      ///< bytes that belonged to none
  std::uint64_t unreachable = 0;  ///< leg angles that no position has
  std::uint64_t refused = 0;      ///< commands that the link did not take
};

/// "Pull the grip all the way out ..." while legs are missing; empty: homed. Of a DeviceState::homing_step.
[[nodiscard]] std::string falcon_homing_prompt(std::uint8_t homed_legs);
/// Zero force and a red light: for a guard process, which has no device.
[[nodiscard]] FalconBytes falcon_zero() noexcept;

/// Keeps a reference to the clock.
class FalconDevice final : public Device {
 public:
  FalconDevice(std::unique_ptr<ControlLink> link, const Clock& clock, FalconOptions options);
  ~FalconDevice() override { close(); }

  [[nodiscard]] std::string name() const override { return "falcon"; }
  /// Milliseconds where firmware runs; else some seconds: see falcon_boot.h. An Error for a scale that is not
  /// above 0.
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override;
  /// Takes all that has come, at most kMostPolls packets, and keeps the newest. Garbled: three in a row that
  /// are no reply, or whose angles no position has; until then the last position holds.
  [[nodiscard]] DeviceState read() noexcept override;
  /// Nothing but zero while a leg is not homed.
  void send(GovernedForce force) noexcept override;
  bool cut_force() noexcept override;

  /// The thread that reads.
  [[nodiscard]] FalconCounters counters() const noexcept;
  /// Of the last open().
  [[nodiscard]] const FalconBooted& booted() const noexcept { return booted_; }
  /// One bit a leg, for falcon_homing_prompt.
  [[nodiscard]] std::uint8_t homed_legs() const noexcept { return homed_legs_; }

  /// As many as a link may have gathered while nobody read.
  static constexpr int kMostPolls = 64;

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
  Vec3 arm_mm_ = Vec3(0.0, 0.0, kFalconCentreMm);  ///< in the frame of the kinematics
  std::uint8_t homed_legs_ = 0;
  std::uint32_t unreachable_in_a_row_ = 0;
  bool open_ = false;
};

}  // namespace palpate::device
