// An open arm over its link: counts to mm by its description, forces to motor currents.
//
// Above the governor there are forces; here they become currents by the transposed Jacobian, scaled down
// together where one would exceed the cap, so that the direction stays. Where the description says so the
// arm's weight is held as well: those currents pass below the governor, so that a fault does not let the arm
// drop, but count in the cap; they end with homing, with silence, and with cut_force until a force is shown
// again. The firmware switches its amplifiers off half a second after the last command; that is no substitute
// for the guard.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "device/arms/arm_description.h"
#include "device/interface/device.h"
#include "device/interface/link.h"
#include "toolkit/core/clock.h"

namespace palpate::device {

/// Currents of a force and of the arm's weight, mA, as the motors get them: the weight's first, all three
/// scaled down together to the cap; then as much of the force as there is room for. Zero where a number is
/// not finite.
[[nodiscard]] Milliamps limited_currents(const Vec3& force_ma, const Vec3& weight_ma, double cap_ma) noexcept;

struct ArmCounters {
  std::uint64_t reports = 0;    ///< that were whole
  std::uint64_t malformed = 0;  ///< of a wrong length, or no line
  std::uint64_t strange = 0;    ///< of another model, with an error, or of a pose that cannot be
  std::uint64_t jumps = 0;      ///< of the counters, faster than any joint turns
  std::uint64_t woken = 0;      ///< commands sent anew because none was answered
  std::uint64_t limited = 0;    ///< commands at the cap of current
};

/// What a person has to do before the arm knows where it is.
enum class ArmStep : std::uint8_t { kNothing, kLieStill, kPressButton, kWait, kSwitchOffAndOn };
/// In words, for a DeviceState::homing_step; empty: nothing is to be done, or it is none.
[[nodiscard]] std::string arm_homing_prompt(std::uint8_t homing_step);

struct ArmDeviceOptions {
  /// How often open() looks for a first report, 5 ms apart; 0: it does not wait for one.
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
  /// At most kMostPolls polls; of what came the newest report counts.
  [[nodiscard]] DeviceState read() noexcept override;
  /// An arm that alternates gets one command for each report, one more where it has not answered for
  /// 20 ms, and one at once where the force ends.
  void send(GovernedForce force) noexcept override;
  bool cut_force() noexcept override;

  [[nodiscard]] const ArmDescription& description() const noexcept { return arm_; }
  [[nodiscard]] const ArmCounters& counters() const noexcept { return counters_; }
  /// What is added to the counters a, b, c so that the rest pose is where the description has it: its
  /// calibration, once it is homed.
  [[nodiscard]] const std::array<double, 3>& counts_added() const noexcept { return offset_; }
  /// What the user is to do now. The thread that reads; others see it as DeviceState::homing_step.
  [[nodiscard]] ArmStep step() const noexcept;

  static constexpr int kMostPolls = 16;

 private:
  [[nodiscard]] bool poll_newest(ArmReport& newest) noexcept;
  [[nodiscard]] bool take_text(std::span<const std::uint8_t> bytes, ArmReport& newest) noexcept;
  void take(const ArmReport& report) noexcept;
  void count_on(const ArmReport& report, std::int64_t now_ns) noexcept;
  void find_rest(const ArmReport& report, std::int64_t now_ns) noexcept;
  void rest_here(std::int64_t now_ns) noexcept;
  void keep_raw(std::span<const std::uint8_t> bytes) noexcept;
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
  // Counters as they came, and run on over their wraps; what must be added to be right.
  std::array<std::int32_t, 3> raw_{};
  std::array<std::int64_t, 3> run_{};
  std::array<double, 3> offset_{};
  // The search for the rest pose.
  bool setting_ = false, set_sent_ = false, lost_rest_ = false, calibrate_before_ = false;
  std::array<std::int64_t, 3> still_{};
  std::int64_t still_from_ns_ = 0, homed_ns_ = 0;
  // The beat of commands.
  bool awaiting_ = false, sent_zero_ = true;
  std::int64_t sent_ns_ = 0;
  std::atomic<bool> cut_{false};
};

}  // namespace palpate::device
