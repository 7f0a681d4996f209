// Limits every force between renderer and device; the only maker of GovernedForce. Each frame, in this order:
//
//   1. fault: non-finite position or force; device lost, silent or garbled; homing lost; position jump;
//      clock going back
//   2. lateness: beyond late_zero_s zero now and ramp up again; beyond latch_late_s fault
//   3. workspace edge: fades outward force and adds a damper; high speed: fades force along the motion
//   4. magnitude limit, direction kept: the lesser of device's and user's
//   5. slew limit, a safety net only: a low one destabilises stiff contact
//   6. soft-start gain, 0 to 1 after arming and homing (shorter after lateness)
//   7. fault if the output is not finite or out of range
//
// A fault latches: zero force in the same frame and until arm(). Times and speeds are absolute, not in
// periods, because hand and motor do not depend on the rate.
//
// First:
//   auto made = palpate::device::ForceGovernor::create(device.limits(), {.user_limit_n = 1.0});
//   if (!made) return failed(made.error());
//   made->arm(clock.now_s());
//   device.send(made->govern(clock.now_s(), device.read(), frame.force_n));
#pragma once

#include <cstdint>

#include <palpate/device/device.h>
#include <palpate/result.h>

namespace palpate::device {

enum class Fault : std::uint8_t {
  kNone,
  kNonFiniteForce,
  kNonFinitePosition,
  kJump,        ///< the position moved farther than a hand can
  kSilence,     ///< no fresh state for too long
  kGarbled,     ///< the device sends no valid packets
  kLost,        ///< the device is gone
  kHomingLost,  ///< the device lost its zero
  kLate,        ///< a frame came later than latch_late_s
  kStalled,     ///< a watchdog saw no heartbeat, or the program is stopping
  kClock,       ///< time went back or was not finite
  kOutOfRange,  ///< the governor's own result was wrong
};
[[nodiscard]] const char* fault_name(Fault fault) noexcept;

struct GovernorOptions {
  double user_limit_n = 0.0;     ///< 0 = 70 % of the device's limit, for new users
  double slew_n_per_s = 1000.0;  ///< 500 to 1000
  double soft_start_s = 0.5;     ///< 0.5 to 1 s
  double period_s = 1e-3;        ///< of the servo
  double late_zero_s = 5e-3;     ///< beyond: zero now, then ramp
  double late_ramp_s = 0.1;
  double latch_late_s = 0.05;  ///< beyond: fault
  double silence_s = 0.02;     ///< without a fresh state for longer: fault
  /// Faster than this between fresh states: fault. Hands reach 2 m/s, and a packet up to a period older than
  /// its frame doubles the apparent speed. Below three resolution steps nothing counts as a jump, because
  /// both ends are rounded per axis.
  double jump_mm_per_s = 5000.0;
  double edge_share = 0.1;           ///< fade zone, of the workspace's half extents; 0: none
  double edge_damping_share = 0.5;   ///< of the device's damping, at the edge; 0 to 1
  double fade_from_mm_per_s = 1e3;   ///< force along the motion fades above this speed; 0: never
  double fade_to_mm_per_s = 1500.0;  ///< speed at which it is gone
  double homing_settle_s = 0.05;     ///< after homing the counters may jump: no force yet
};

struct GovernorCounters {
  std::uint64_t frames = 0;
  std::uint64_t clamped = 0;      ///< frames at the magnitude limit
  std::uint64_t slewed = 0;       ///< frames at the slew limit
  std::uint64_t late_zeroed = 0;  ///< frames zeroed for lateness without a fault
  std::uint64_t edge_faded = 0;   ///< frames weakened at the workspace's edge
  std::uint64_t speed_faded = 0;  ///< frames weakened by the speed limit
  /// Fresh frames whose force implies more than the device's known stiffness. Only counted: see surface_fits.
  std::uint64_t too_stiff = 0;
  std::uint64_t faults = 0;
};

/// Checks, before a session, that a device can render this stiffness and damping (device frame); the Error
/// names the limit. A frame's governor sees only the force, and no force limit can soften a stiff wall.
[[nodiscard]] Status surface_fits(const DeviceLimits& limits, double stiffness_n_per_mm,
                                  double damping_n_s_per_mm);

/// Step 3 of the governor, so that an arm never meets its stop at full torque. Returns `force_n` (device
/// frame, at `position_mm`) with its outward part faded: from full at `share` of the way from edge to middle,
/// to none at the edge and beyond. Inward and tangential parts stay. A damper of `damping_n_s_per_mm`,
/// growing over the same range, acts against outward velocity only.
///
/// Continuously differentiable in the position. The gain depends on the position alone, so a force that does
/// too gives back on the way in exactly what it took on the way out along the normal; the damper only
/// dissipates. Lengths are shares of the workspace's half extents. A box has a wall per axis, an ellipsoid
/// one, a cylinder its mantle and ends. O(1), no allocation.
[[nodiscard]] Vec3 faded_at_edge(const DeviceLimits& limits, double share, double damping_n_s_per_mm,
                                 const Vec3& position_mm, const Vec3& velocity_mm_s,
                                 const Vec3& force_n) noexcept;

/// Owned by the servo thread. Takes the time with each call.
class ForceGovernor {
 public:
  /// For an open device, whose limits are valid. An Error names a limit or option that is not finite and
  /// positive.
  [[nodiscard]] static Result<ForceGovernor> create(const DeviceLimits& limits,
                                                    const GovernorOptions& options);

  /// Clears a fault and begins the soft start. Until it is called every force is zero.
  void arm(double now_s) noexcept;
  /// Zero from the next frame until armed.
  void disarm() noexcept { armed_ = false; }
  /// Latches a fault seen elsewhere. The first stays until arm().
  void latch(Fault fault) noexcept;

  /// The force that may be sent, for the state just read and the renderer's force (device frame). Call once a
  /// frame. Bounded work, no allocation.
  [[nodiscard]] GovernedForce govern(double now_s, const DeviceState& state, const Vec3& wanted_n) noexcept;
  /// Zero, at any time.
  [[nodiscard]] GovernedForce zero() noexcept;

  [[nodiscard]] bool armed() const noexcept { return armed_; }
  /// Not homed or just homed: positions are not valid yet.
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
