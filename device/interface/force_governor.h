// What stands between every renderer and every device: NaN guard, magnitude limit, slew limit, soft start,
// watchdog. The only maker of GovernedForce. In this order in every frame:
//
//   1. non-finite position or force, a lost or silent device, a jump of the position, a clock that goes back:
//   fault
//   2. lateness: by more than 5 periods zero now and ramp up again; by more than 50 ms fault
//   3. magnitude limit, direction kept: the lesser of the device's and the user's
//   4. slew limit, a safety net only: a low one inside a stiff contact destabilises
//   5. soft-start gain, 0 to 1 after arming (and, shorter, after lateness)
//   6. finite-and-range check of what comes out: fault
//
// A fault latches: zero force in the very frame it is seen in, and in all later ones until arm() is called
// again.
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
  kLost,        ///< the device is gone
  kLate,        ///< a frame came later than latch_late_s
  kClock,       ///< time went back or was not finite
  kOutOfRange,  ///< the result of the governor itself was wrong
};
[[nodiscard]] const char* fault_name(Fault fault) noexcept;

struct GovernorOptions {
  double user_limit_n = 0.0;       ///< 0 = 70 % of the device's limit, which suits new users
  double slew_n_per_s = 1000.0;    ///< 500 to 1000
  double soft_start_s = 0.5;       ///< 0.5 to 1 s
  double period_s = 1e-3;          ///< of the servo
  double late_zero_periods = 5.0;  ///< later than this: zero now, then ramp
  double late_ramp_s = 0.1;
  double latch_late_s = 0.05;  ///< later than this: fault
  double silence_s = 0.02;     ///< no fresh state for longer: fault
  double jump_mm = 5.0;        ///< further in one period: fault (5 m/s)
};

struct GovernorCounters {
  std::uint64_t frames = 0;
  std::uint64_t clamped = 0;      ///< frames at the magnitude limit
  std::uint64_t slewed = 0;       ///< frames at the slew limit
  std::uint64_t late_zeroed = 0;  ///< frames zeroed for lateness without a fault
  std::uint64_t faults = 0;
};

/// Owned by the servo thread. Time comes in with each call; there is no clock inside.
class ForceGovernor {
 public:
  /// Limits and options must be finite and positive, or there is an Error that names the one that is not.
  [[nodiscard]] static Result<ForceGovernor> create(const DeviceLimits& limits,
                                                    const GovernorOptions& options);

  /// Clears a fault and starts the soft start. Without it every force is zero.
  void arm(double now_s) noexcept;
  /// Zero from the next frame on, until armed.
  void disarm() noexcept { armed_ = false; }

  /// The force that may be sent now, for the state just read and the force the renderer wants (device frame).
  /// To be called once a frame. Bounded work, no allocation.
  [[nodiscard]] GovernedForce govern(double now_s, const DeviceState& state, const Vec3& wanted_n) noexcept;
  /// Zero, at any time.
  [[nodiscard]] GovernedForce zero() noexcept;

  [[nodiscard]] bool armed() const noexcept { return armed_; }
  [[nodiscard]] Fault fault() const noexcept { return fault_; }
  [[nodiscard]] double limit_n() const noexcept { return limit_n_; }
  [[nodiscard]] const GovernorOptions& options() const noexcept { return options_; }
  [[nodiscard]] const GovernorCounters& counters() const noexcept { return counters_; }

 private:
  ForceGovernor(double limit_n, const GovernorOptions& options) noexcept
      : limit_n_(limit_n), options_(options) {}

  [[nodiscard]] Fault find_fault(double now_s, const DeviceState& state, const Vec3& wanted_n) const noexcept;
  void remember(double now_s, const DeviceState& state) noexcept;
  void trip(Fault fault) noexcept;
  [[nodiscard]] double late_s(double now_s) const noexcept;
  [[nodiscard]] Vec3 clamped(const Vec3& wanted_n) noexcept;
  [[nodiscard]] Vec3 slewed(const Vec3& target_n, double elapsed_s) noexcept;
  [[nodiscard]] double gain(double now_s) const noexcept;

  double limit_n_;
  GovernorOptions options_;
  bool armed_ = false;
  Fault fault_ = Fault::kNone;
  double ramp_start_s_ = 0.0, ramp_s_ = 0.0;
  double last_frame_s_ = 0.0, last_fresh_s_ = 0.0;
  bool has_frame_ = false, has_position_ = false;
  Vec3 last_position_mm_ = Vec3::Zero();
  Vec3 slewed_n_ = Vec3::Zero();  // before the soft-start gain
  GovernorCounters counters_;
};

}  // namespace palpate::device
