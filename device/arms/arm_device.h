// An open arm over its link: counts become mm by its description, forces become motor currents.
//
// The transposed Jacobian turns governed forces into currents, scaled down together to the cap so that the
// direction stays. Optional weight compensation bypasses the governor, so that a fault does not drop the arm,
// but counts in the cap; it ends with homing, with silence, and with cut_force until the next force. The
// firmware turns its amplifiers off half a second after the last command, which does not replace the guard.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/drivers.h>
#include <palpate/device/link.h>
#include "device/arms/arm_description.h"

namespace palpate::device {

/// Motor currents (mA) of a force and the arm's weight: the weight first, scaled down together to the cap,
/// then as much force as fits. Zero if a number is not finite.
[[nodiscard]] Milliamps limited_currents(const Vec3& force_ma, const Vec3& weight_ma, double cap_ma) noexcept;

struct ArmCounters {
  std::uint64_t reports = 0;    ///< valid
  std::uint64_t malformed = 0;  ///< wrong length, or not a line
  std::uint64_t strange = 0;    ///< other model, error code, or impossible pose
  std::uint64_t jumps = 0;      ///< of the counters, faster than any joint
  std::uint64_t woken = 0;      ///< commands repeated for lack of an answer
  std::uint64_t limited = 0;    ///< commands at the current cap
};

/// Step that the user must take before the arm knows its position.
enum class ArmStep : std::uint8_t { kNothing, kLieStill, kPressButton, kWait, kSwitchOffAndOn };
/// Words for a DeviceState::homing_step; empty: nothing to do, or unknown step.
[[nodiscard]] std::string arm_homing_prompt(std::uint8_t homing_step);

struct ArmDeviceOptions {
  /// Polls for a first report in open(), 5 ms apart; 0: does not wait.
  int open_tries = 200;
};

/// Keeps a reference to the clock.
class ArmDevice final : public Device {
 public:
  ArmDevice(ArmDescription description, std::unique_ptr<Link> link, const Clock& clock,
            const ArmDeviceOptions& options = {});
  ~ArmDevice() override { close(); }

  [[nodiscard]] std::string name() const override { return "arm:" + arm_.name; }
  /// Commands zero and waits for a first report.
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override { return arm_.limits; }
  /// At most kMaxPolls polls; the newest report counts.
  [[nodiscard]] DeviceState read() noexcept override;
  /// Sends an alternating arm one command per report, one more after 20 ms without an answer, one at once
  /// when the force ends.
  void send(GovernedForce force) noexcept override;
  bool cut_force() noexcept override;

  [[nodiscard]] const ArmDescription& description() const noexcept { return arm_; }
  [[nodiscard]] const ArmCounters& counters() const noexcept { return counters_; }
  /// Calibration of counters a, b, c, valid when homed: added to them, it puts the rest pose where the
  /// description has it.
  [[nodiscard]] const std::array<double, 3>& calibration_offset() const noexcept { return offset_; }
  /// The step that the user must take now. For the reading thread; others use DeviceState::homing_step.
  [[nodiscard]] ArmStep step() const noexcept;

  static constexpr int kMaxPolls = 16;

 private:
  [[nodiscard]] bool poll_newest(ArmReport& newest) noexcept;
  [[nodiscard]] bool take_text(std::span<const std::uint8_t> bytes, ArmReport& newest) noexcept;
  void take(const ArmReport& report) noexcept;
  void count_on(const ArmReport& report, std::int64_t now_ns) noexcept;
  void find_rest(const ArmReport& report, std::int64_t now_ns) noexcept;
  void rest_here(std::int64_t now_ns) noexcept;
  [[nodiscard]] CommandBytes command_for(const Vec3& force_n) noexcept;
  [[nodiscard]] Vec3 weight_ma(std::int64_t now_ns) const noexcept;

  ArmDescription arm_;
  std::unique_ptr<Link> link_;
  const Clock& clock_;
  ArmDeviceOptions options_;
  CommandBytes zero_;
  DeviceState state_;
  ArmCounters counters_;
  ArmLineReader lines_;
  std::optional<ArmPose> pose_;
  ArmAngles angles_{};
  bool open_ = false, gone_ = false, counted_ = false;
  std::uint32_t malformed_in_a_row_ = 0;
  std::uint16_t counter_ = 0;
  // Counters as received, unwrapped, and the correction.
  std::array<std::int32_t, 3> raw_{};
  std::array<std::int64_t, 3> run_{};
  std::array<double, 3> offset_{};
  // Search for the rest pose.
  bool setting_ = false, set_sent_ = false, lost_rest_ = false, calibrate_before_ = false;
  std::array<std::int64_t, 3> still_{};
  std::int64_t still_from_ns_ = 0, homed_ns_ = 0;
  // Rhythm of commands.
  bool awaiting_ = false, sent_zero_ = true;
  std::int64_t sent_ns_ = 0;
  std::atomic<bool> cut_{false};
};

/// "arm". The USB ids are those of the boards' frameworks, shared by other gadgets, so an arm is opened only
/// by name. Options: path, serial, current_cap_a, force_n, weight.
void register_arm_driver(Drivers& drivers);

[[nodiscard]] std::unique_ptr<Link> arm_link(const ArmDescription& arm);

[[nodiscard]] Result<ArmDescription> requested_arm(const DeviceRequest& request);

}  // namespace palpate::device
