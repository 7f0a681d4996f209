#include "device/interface/force_governor.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace palpate::device {
namespace {

constexpr double kNewUserShare = 0.7;  // of the device's limit, where the user gave none
// What a clamp may exceed its limit by: a handful of roundings, far from anything a motor could tell apart.
constexpr double kLimitSlack = 1.0 + 1e-12;
// Lateness is a difference of times that each carry rounding: a frame exactly at a border is not late.
constexpr double kTimeSlackPeriods = 1e-6;

}  // namespace

const char* fault_name(Fault fault) noexcept {
  switch (fault) {
    case Fault::kNone:
      return "none";
    case Fault::kNonFiniteForce:
      return "the force was not finite";
    case Fault::kNonFinitePosition:
      return "the position was not finite";
    case Fault::kJump:
      return "the position jumped";
    case Fault::kSilence:
      return "the device was silent";
    case Fault::kLost:
      return "the device was lost";
    case Fault::kLate:
      return "the servo loop was late";
    case Fault::kClock:
      return "the clock went back";
    case Fault::kOutOfRange:
      return "the governed force was out of range";
  }
  return "unknown";
}

Result<ForceGovernor> ForceGovernor::create(const DeviceLimits& limits, const GovernorOptions& options) {
  struct Named {
    const char* name;
    double value;
  };
  const double user_limit_n =
      options.user_limit_n == 0.0 ? kNewUserShare * limits.force_max_n : options.user_limit_n;
  for (const Named& named : std::array<Named, 10>{{{"the device's force limit", limits.force_max_n},
                                                   {"the user's force limit", user_limit_n},
                                                   {"slew_n_per_s", options.slew_n_per_s},
                                                   {"soft_start_s", options.soft_start_s},
                                                   {"period_s", options.period_s},
                                                   {"late_zero_periods", options.late_zero_periods},
                                                   {"late_ramp_s", options.late_ramp_s},
                                                   {"latch_late_s", options.latch_late_s},
                                                   {"silence_s", options.silence_s},
                                                   {"jump_mm", options.jump_mm}}}) {
    if (std::isfinite(named.value) && named.value > 0.0) continue;
    return Error{std::string(named.name) + " is " + std::to_string(named.value),
                 "give a finite number above 0", "", 0};
  }
  return ForceGovernor(std::min(limits.force_max_n, user_limit_n), options);
}

void ForceGovernor::arm(double now_s) noexcept {
  armed_ = true;
  fault_ = Fault::kNone;
  ramp_start_s_ = now_s;
  ramp_s_ = options_.soft_start_s;
  last_fresh_s_ = now_s;
  has_frame_ = false;
  has_position_ = false;
  slewed_n_.setZero();
}

GovernedForce ForceGovernor::zero() noexcept {
  slewed_n_.setZero();
  return GovernedForce(Vec3::Zero());
}

void ForceGovernor::trip(Fault fault) noexcept {
  fault_ = fault;
  armed_ = false;
  ++counters_.faults;
}

double ForceGovernor::late_s(double now_s) const noexcept {
  if (!has_frame_) return 0.0;
  return now_s - last_frame_s_ - options_.period_s * (1.0 + kTimeSlackPeriods);
}

Fault ForceGovernor::find_fault(double now_s, const DeviceState& state, const Vec3& wanted_n) const noexcept {
  if (!std::isfinite(now_s) || (has_frame_ && now_s < last_frame_s_)) return Fault::kClock;
  if (state.status == ReadStatus::kLost) return Fault::kLost;
  if (!is_finite(state.position_mm)) return Fault::kNonFinitePosition;
  if (!is_finite(wanted_n)) return Fault::kNonFiniteForce;
  if (late_s(now_s) > options_.latch_late_s) return Fault::kLate;
  if (state.status == ReadStatus::kFresh) {
    if (!has_position_) return Fault::kNone;
    // After silent periods the hand may have gone further.
    const double periods = std::max(1.0, (now_s - last_fresh_s_) / options_.period_s);
    const double moved_mm = (state.position_mm - last_position_mm_).stableNorm();
    if (!(moved_mm <= options_.jump_mm * periods * (1.0 + kTimeSlackPeriods))) return Fault::kJump;
  } else if (now_s - last_fresh_s_ > options_.silence_s * (1.0 + kTimeSlackPeriods)) {
    return Fault::kSilence;
  }
  return Fault::kNone;
}

void ForceGovernor::remember(double now_s, const DeviceState& state) noexcept {
  last_frame_s_ = now_s;
  has_frame_ = true;
  if (state.status != ReadStatus::kFresh) return;
  last_fresh_s_ = now_s;
  last_position_mm_ = state.position_mm;
  has_position_ = true;
}

Vec3 ForceGovernor::clamped(const Vec3& wanted_n) noexcept {
  const double size_n = wanted_n.stableNorm();  // does not overflow where a square would
  if (size_n <= limit_n_) return wanted_n;
  ++counters_.clamped;
  // Sizes near the largest double can make even the norm infinite: scale by the largest component first.
  const Vec3 scaled = wanted_n / wanted_n.cwiseAbs().maxCoeff();
  return scaled * (limit_n_ / scaled.norm());
}

Vec3 ForceGovernor::slewed(const Vec3& target_n, double elapsed_s) noexcept {
  // A late frame is allowed no larger step than one in time.
  const double step_n = options_.slew_n_per_s * std::min(elapsed_s, options_.period_s);
  const Vec3 change_n = target_n - slewed_n_;
  const double size_n = change_n.norm();
  if (size_n <= step_n) return target_n;
  ++counters_.slewed;
  return slewed_n_ + change_n * (step_n / size_n);
}

double ForceGovernor::gain(double now_s) const noexcept {
  return std::clamp((now_s - ramp_start_s_) / ramp_s_, 0.0, 1.0);
}

GovernedForce ForceGovernor::govern(double now_s, const DeviceState& state, const Vec3& wanted_n) noexcept {
  ++counters_.frames;
  if (!armed_) return zero();
  const Fault found = find_fault(now_s, state, wanted_n);
  if (found != Fault::kNone) {
    trip(found);
    return zero();
  }
  const double elapsed_s = has_frame_ ? now_s - last_frame_s_ : options_.period_s;
  const bool late = late_s(now_s) > options_.late_zero_periods * options_.period_s;
  remember(now_s, state);
  if (late) {
    ++counters_.late_zeroed;
    // Start the ramp so that it never runs ahead of a soft start still under way.
    const double share = gain(now_s);
    ramp_s_ = share < 1.0 ? ramp_s_ : options_.late_ramp_s;
    ramp_start_s_ = now_s;
    return zero();
  }
  slewed_n_ = slewed(clamped(wanted_n), elapsed_s);
  const Vec3 out_n = gain(now_s) * slewed_n_;
  if (!is_finite(out_n) || out_n.norm() > limit_n_ * kLimitSlack) {
    trip(Fault::kOutOfRange);
    return zero();
  }
  return GovernedForce(out_n);
}

}  // namespace palpate::device
