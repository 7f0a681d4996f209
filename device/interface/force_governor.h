// What stands between every renderer and every device. The only maker of GovernedForce. In this order in
// every frame:
//
//   1. non-finite position or force, a lost, silent or garbled device, lost homing, a jump of the position, a
//      clock that goes back: fault
//   2. lateness: by more than late_zero_s zero now and ramp up again; by more than latch_late_s fault
//   3. at the workspace's edge what pushes out fades, and a damper acts; above a speed what pushes along
//   fades
//   4. magnitude limit, direction kept: the lesser of the device's and the user's
//   5. slew limit, a safety net only: a low one inside a stiff contact destabilises
//   6. soft-start gain, 0 to 1 after arming and homing (and, shorter, after lateness)
//   7. finite-and-range check of what comes out: fault
//
// A fault latches: zero force in the very frame it is seen in, and in all later ones until arm() is called
// again. Times and speeds are absolute, not counted in periods: a hand and a motor do not know the rate.
#pragma once

#include <cstdint>

#include "device/interface/device.h"
#include "toolkit/core/result.h"

namespace palpate::device {

enum class Fault : std::uint8_t {
  kNone,
  kNonFiniteForce,
  kNonFinitePosition,
  kJump,        ///< the position moved further than a hand can
  kSilence,     ///< no fresh state for too long
  kGarbled,     ///< what the device sends is no packet
  kLost,        ///< the device is gone
  kHomingLost,  ///< the device has forgotten where its zero is
  kLate,        ///< a frame came later than latch_late_s
  kStalled,     ///< a watchdog saw no heartbeat, or the program is being stopped
  kClock,       ///< time went back or was not finite
  kOutOfRange,  ///< the result of the governor itself was wrong
};
[[nodiscard]] const char* fault_name(Fault fault) noexcept;

struct GovernorOptions {
  double user_limit_n = 0.0;     ///< 0 = 70 % of the device's limit, which suits new users
  double slew_n_per_s = 1000.0;  ///< 500 to 1000
  double soft_start_s = 0.5;     ///< 0.5 to 1 s
  double period_s = 1e-3;        ///< of the servo
  double late_zero_s = 5e-3;     ///< later than this: zero now, then ramp
  double late_ramp_s = 0.1;
  double latch_late_s = 0.05;  ///< later than this: fault
  double silence_s = 0.02;     ///< no fresh state for longer: fault
  /// Faster than this from one fresh state to the next: fault. Hands reach 2 m/s; a packet may be a period
  /// older than its frame, which doubles what is seen. Below three steps of the device's resolution nothing
  /// is a jump: both ends are rounded, along each axis.
  double jump_mm_per_s = 5000.0;
  double edge_share = 0.1;           ///< of the workspace's half extents, where forces fade; 0: they do not
  double edge_damping_share = 0.5;   ///< of the device's damping, at the edge; 0 to 1
  double fade_from_mm_per_s = 1e3;   ///< above this speed what pushes along fades; 0: it does not
  double fade_to_mm_per_s = 1500.0;  ///< none of it is left
  double homing_settle_s = 0.05;     ///< after homing the counters may still jump: no force yet
};

struct GovernorCounters {
  std::uint64_t frames = 0;
  std::uint64_t clamped = 0;      ///< frames at the magnitude limit
  std::uint64_t slewed = 0;       ///< frames at the slew limit
  std::uint64_t late_zeroed = 0;  ///< frames zeroed for lateness without a fault
  std::uint64_t edge_faded = 0;   ///< frames weakened by the workspace's edge
  std::uint64_t speed_faded = 0;  ///< frames weakened by the speed limit
  /// Fresh frames whose force asked for more stiffness than the device holds (where it is known). Only
  /// counted: see surface_fits.
  std::uint64_t too_stiff = 0;
  std::uint64_t faults = 0;
};

/// Whether a device can hold a surface of this stiffness and damping, both in its own frame: the Error names
/// the limit. To be asked before a session. In a frame a governor sees a force alone, not what it is made of:
/// a stiff wall's force is changed by no limit that keeps the wall, so stiffness and damping are judged here.
[[nodiscard]] Status surface_fits(const DeviceLimits& limits, double stiffness_n_per_mm,
                                  double damping_n_s_per_mm);

/// Owned by the servo thread. Time comes in with each call; there is no clock inside.
class ForceGovernor {
 public:
  /// For an open device: limits are valid only then. They and the options must be finite and positive, or
  /// there is an Error that names the one that is not.
  [[nodiscard]] static Result<ForceGovernor> create(const DeviceLimits& limits,
                                                    const GovernorOptions& options);

  /// Clears a fault and starts the soft start. Without it every force is zero.
  void arm(double now_s) noexcept;
  /// Zero from the next frame on, until armed.
  void disarm() noexcept { armed_ = false; }
  /// A fault that was seen elsewhere. The first one stays until arm().
  void latch(Fault fault) noexcept;

  /// The force that may be sent now, for the state just read and the force the renderer wants (device frame).
  /// To be called once a frame. Bounded work, no allocation.
  [[nodiscard]] GovernedForce govern(double now_s, const DeviceState& state, const Vec3& wanted_n) noexcept;
  /// Zero, at any time.
  [[nodiscard]] GovernedForce zero() noexcept;

  [[nodiscard]] bool armed() const noexcept { return armed_; }
  /// The device was not homed, or just has been: its positions are none yet.
  [[nodiscard]] bool settling() const noexcept { return settling_; }
  [[nodiscard]] Fault fault() const noexcept { return fault_; }
  [[nodiscard]] double limit_n() const noexcept { return limit_n_; }
  [[nodiscard]] const GovernorOptions& options() const noexcept { return options_; }
  [[nodiscard]] const GovernorCounters& counters() const noexcept { return counters_; }

 private:
  ForceGovernor(const DeviceLimits& limits, double limit_n, const GovernorOptions& options) noexcept
      : limits_(limits), limit_n_(limit_n), options_(options) {}

  [[nodiscard]] Fault find_fault(double now_s, const DeviceState& state, const Vec3& wanted_n) const noexcept;
  [[nodiscard]] Fault find_state_fault(double now_s, const DeviceState& state) const noexcept;
  [[nodiscard]] bool settled(double now_s, const DeviceState& state) noexcept;
  void remember(double now_s, const DeviceState& state, const Vec3& wanted_n) noexcept;
  [[nodiscard]] double late_s(double now_s) const noexcept;
  [[nodiscard]] Vec3 faded(const Vec3& wanted_n) noexcept;
  [[nodiscard]] Vec3 clamped(const Vec3& wanted_n) noexcept;
  [[nodiscard]] Vec3 slewed(const Vec3& target_n, double elapsed_s) noexcept;
  [[nodiscard]] double gain(double now_s) const noexcept;

  DeviceLimits limits_;
  double limit_n_;
  GovernorOptions options_;
  bool armed_ = false;
  Fault fault_ = Fault::kNone;
  double ramp_start_s_ = 0.0, ramp_s_ = 0.0;
  double last_frame_s_ = 0.0, last_fresh_s_ = 0.0, homed_s_ = 0.0;
  bool has_frame_ = false, has_position_ = false, was_homed_ = false, settling_ = false;
  Vec3 last_position_mm_ = Vec3::Zero(), velocity_mm_s_ = Vec3::Zero();
  Vec3 last_wanted_n_ = Vec3::Zero();
  Vec3 slewed_n_ = Vec3::Zero();  // before the soft-start gain
  GovernorCounters counters_;
};

}  // namespace palpate::device
