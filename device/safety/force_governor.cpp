#include <palpate/device/force_governor.h>

#include <algorithm>
#include <array>
#include <cmath>

#include <palpate/result.h>
#include "device/interface/driver_options.h"

namespace palpate::device {
namespace {

/// 3 t^2 - 2 t^3 of t clamped to [0, 1]; slope 0 at both ends.
double smooth_step(double t) noexcept {
  const double held = std::clamp(t, 0.0, 1.0);
  return held * held * (3.0 - 2.0 * held);
}

struct AtEdge {
  double share;
  double damping_n_s_per_mm;
  Vec3 velocity_mm_s;
};

/// Fades at one wall with the unit normal `outward`; `reach` is 1 at the edge.
Vec3 at_wall(const AtEdge& edge, const Vec3& outward, double reach, const Vec3& force_n) noexcept {
  const double near = smooth_step((reach - (1.0 - edge.share)) / edge.share);
  if (near <= 0.0) return force_n;
  const double push_n = std::max(0.0, force_n.dot(outward));
  const double out_mm_s = std::max(0.0, edge.velocity_mm_s.dot(outward));
  return force_n - near * (push_n + edge.damping_n_s_per_mm * out_mm_s) * outward;
}

/// Fades at an ellipsoid of half axes `half_mm`; a zero axis is ignored.
Vec3 at_mantle(const AtEdge& edge, const Vec3& scaled, const Vec3& per_half, const Vec3& force_n) noexcept {
  const Vec3 gradient = scaled.cwiseProduct(per_half);
  const double length = gradient.norm();
  if (!(length > 0.0)) return force_n;  // the exact centre
  return at_wall(edge, gradient / length, scaled.norm(), force_n);
}

}  // namespace

Vec3 faded_at_edge(const DeviceLimits& limits, double share, double damping_n_s_per_mm,
                   const Vec3& position_mm, const Vec3& velocity_mm_s, const Vec3& force_n) noexcept {
  const AtEdge edge{share, damping_n_s_per_mm, velocity_mm_s};
  const Vec3 per_half = (0.5 * limits.workspace_mm.extent_mm()).cwiseInverse();
  const Vec3 scaled = (position_mm - limits.workspace_mm.centre_mm()).cwiseProduct(per_half);
  if (limits.workspace_shape == WorkspaceShape::kEllipsoid) return at_mantle(edge, scaled, per_half, force_n);
  Vec3 left_n = force_n;
  int first = 0;
  if (limits.workspace_shape == WorkspaceShape::kCylinder) {
    left_n = at_mantle(edge, Vec3{scaled.x(), scaled.y(), 0.0}, per_half, left_n);
    first = 2;
  }
  for (int axis = first; axis < 3; ++axis) {
    const Vec3 outward = std::copysign(1.0, scaled[axis]) * Vec3::Unit(axis);
    left_n = at_wall(edge, outward, std::abs(scaled[axis]), left_n);
  }
  return left_n;
}

namespace {

constexpr double kNewUserShare = 0.7;  // of the device's limit, if the user gave none
// Excess over a limit that rounding may cause; no motor can resolve it.
constexpr double kLimitSlack = 1.0 + 1e-12;
// Lateness is a difference of rounded times: a frame exactly at a border is not late.
constexpr double kTimeSlack = 1e-6;
// Jump threshold in steps of the resolution. A hand at 2 m/s moves 2 dt, and rounding on three axes adds
// sqrt(3) steps: below the larger of 5 dt and 3 steps.
constexpr double kJumpFloorSteps = 3.0;
// Time constant of the speed filter: one step of 0.055 mm then shows as 27 mm/s, instead of 220 at 4 kHz.
constexpr double kVelocityTauS = 2e-3;

Status check_fade(const GovernorOptions& options) {
  if (options.edge_share > 1.0 || options.edge_damping_share > 1.0)
    return Error{"edge_share or edge_damping_share is above 1", "give shares from 0 to 1"};
  const double from = options.fade_from_mm_per_s, to = options.fade_to_mm_per_s;
  if (from > 0.0 && !(to > from && std::isfinite(to)))
    return Error{"fade_to_mm_per_s is " + std::to_string(to), "give a finite speed above fade_from_mm_per_s"};
  return Done{};
}

Status check_workspace(const DeviceLimits& limits, const GovernorOptions& options) {
  if (options.edge_share == 0.0) return Done{};
  const geometry::Aabb& box = limits.workspace_mm;
  if (is_finite(box.low_mm) && is_finite(box.high_mm) && (box.low_mm.array() < box.high_mm.array()).all())
    return Done{};
  return Error{"the device's workspace is empty or not finite",
               "let the device say it, or set edge_share to 0"};
}

}  // namespace

const char* fault_name(Fault fault) noexcept {
  constexpr std::array kNames = {"none",
                                 "the force was not finite",
                                 "the position was not finite",
                                 "the position jumped",
                                 "the device was silent",
                                 "the device sent no packets",
                                 "the device was lost",
                                 "the device lost its homing",
                                 "the servo loop was late",
                                 "the servo loop stood still or was stopped",
                                 "the clock went back",
                                 "the governed force was out of range"};
  static_assert(kNames.size() == static_cast<std::size_t>(Fault::kOutOfRange) + 1);
  const auto at = static_cast<std::size_t>(fault);
  return at < kNames.size() ? kNames[at] : "unknown";
}

Status surface_fits(const DeviceLimits& limits, double stiffness_n_per_mm, double damping_n_s_per_mm) {
  const auto beyond = [](const char* what, double asked, double most, const char* unit) {
    return Error{std::string("the surface's ") + what + " is " + std::to_string(asked) + " " + unit +
                     " in the device's frame, which holds " + std::to_string(most),
                 std::string("lower the ") + what + " or the workspace's factor"};
  };
  // 0 means unknown.
  const double stiffest = limits.stiffness_max_n_per_mm, most_damping = limits.damping_max_n_s_per_mm;
  if (stiffest > 0.0 && !(stiffness_n_per_mm <= stiffest))
    return beyond("stiffness", stiffness_n_per_mm, stiffest, "N/mm");
  if (most_damping > 0.0 && !(damping_n_s_per_mm <= most_damping))
    return beyond("damping", damping_n_s_per_mm, most_damping, "N s/mm");
  return Done{};
}

Result<ForceGovernor> ForceGovernor::create(const DeviceLimits& limits, const GovernorOptions& options) {
  const double user_limit_n =
      options.user_limit_n == 0.0 ? kNewUserShare * limits.force_max_n : options.user_limit_n;
  const auto numbers =
      std::to_array<CheckedNumber>({{"the device's force limit", limits.force_max_n, false},
                                    {"the user's force limit", user_limit_n, false},
                                    {"the device's resolution", limits.resolution_mm, true},
                                    {"the device's stiffness", limits.stiffness_max_n_per_mm, true},
                                    {"the device's damping", limits.damping_max_n_s_per_mm, true},
                                    {"slew_n_per_s", options.slew_n_per_s, false},
                                    {"soft_start_s", options.soft_start_s, false},
                                    {"period_s", options.period_s, false},
                                    {"late_zero_s", options.late_zero_s, false},
                                    {"late_ramp_s", options.late_ramp_s, false},
                                    {"latch_late_s", options.latch_late_s, false},
                                    {"silence_s", options.silence_s, false},
                                    {"jump_mm_per_s", options.jump_mm_per_s, false},
                                    {"edge_share", options.edge_share, true},
                                    {"edge_damping_share", options.edge_damping_share, true},
                                    {"fade_from_mm_per_s", options.fade_from_mm_per_s, true},
                                    {"homing_settle_s", options.homing_settle_s, true}});
  PALPATE_TRY(check_numbers(numbers, ""));
  PALPATE_TRY(check_fade(options));
  PALPATE_TRY(check_workspace(limits, options));
  return ForceGovernor(limits, std::min(limits.force_max_n, user_limit_n), options);
}

void ForceGovernor::arm(double now_s) noexcept {
  armed_ = true;
  fault_ = Fault::kNone;
  ramp_start_s_ = now_s;
  ramp_s_ = options_.soft_start_s;
  last_fresh_s_ = now_s;
  has_frame_ = has_position_ = was_homed_ = settling_ = false;
  velocity_mm_s_.setZero();
  slewed_n_.setZero();
}

GovernedForce ForceGovernor::zero() noexcept {
  slewed_n_.setZero();
  return GovernedForce(Vec3::Zero());
}

void ForceGovernor::latch(Fault fault) noexcept {
  armed_ = false;
  if (fault_ != Fault::kNone) return;
  fault_ = fault;
  ++counters_.faults;
}

double ForceGovernor::late_s(double now_s) const noexcept {
  if (!has_frame_) return 0.0;
  return now_s - last_frame_s_ - options_.period_s * (1.0 + kTimeSlack);
}

Fault ForceGovernor::find_fault(double now_s, const DeviceState& state, const Vec3& wanted_n) const noexcept {
  if (!std::isfinite(now_s) || (has_frame_ && now_s < last_frame_s_)) return Fault::kClock;
  if (state.status == ReadStatus::kLost) return Fault::kLost;
  if (state.status == ReadStatus::kGarbled) return Fault::kGarbled;
  if (!is_finite(state.position_mm)) return Fault::kNonFinitePosition;
  if (!is_finite(wanted_n)) return Fault::kNonFiniteForce;
  if (late_s(now_s) > options_.latch_late_s) return Fault::kLate;
  return find_state_fault(now_s, state);
}

Fault ForceGovernor::find_state_fault(double now_s, const DeviceState& state) const noexcept {
  if (was_homed_ && !state.homed) return Fault::kHomingLost;
  const double since_fresh_s = now_s - last_fresh_s_;
  if (state.status != ReadStatus::kFresh)
    return since_fresh_s > options_.silence_s * (1.0 + kTimeSlack) ? Fault::kSilence : Fault::kNone;
  if (!has_position_) return Fault::kNone;
  // After silent periods the hand may have moved further; two frames close together may show a whole period.
  const double elapsed_s = std::max(options_.period_s, since_fresh_s) * (1.0 + kTimeSlack);
  const double most_mm =
      std::max(options_.jump_mm_per_s * elapsed_s, kJumpFloorSteps * limits_.resolution_mm);
  const double moved_mm = (state.position_mm - last_position_mm_).stableNorm();
  return moved_mm <= most_mm ? Fault::kNone : Fault::kJump;
}

void ForceGovernor::remember(double now_s, const DeviceState& state, const Vec3& wanted_n) noexcept {
  last_frame_s_ = now_s;
  has_frame_ = true;
  if (state.status != ReadStatus::kFresh) return;
  if (has_position_) {
    const Vec3 moved_mm = state.position_mm - last_position_mm_;
    velocity_mm_s_ = (kVelocityTauS * velocity_mm_s_ + moved_mm) / (kVelocityTauS + now_s - last_fresh_s_);
    // Both positions are rounded, and so is a wall's answer to them.
    const double most_n =
        limits_.stiffness_max_n_per_mm * (moved_mm.norm() + kJumpFloorSteps * limits_.resolution_mm);
    if (limits_.stiffness_max_n_per_mm > 0.0 && (wanted_n - last_wanted_n_).stableNorm() > most_n)
      ++counters_.too_stiff;
  }
  last_fresh_s_ = now_s;
  last_position_mm_ = state.position_mm;
  last_wanted_n_ = wanted_n;
  has_position_ = true;
}

/// False before homing and shortly after, when positions are not reliable. The soft start begins afterwards.
bool ForceGovernor::settled(double now_s, const DeviceState& state) noexcept {
  if (!state.homed) {
    settling_ = true;
    homed_s_ = now_s;
  }
  settling_ = settling_ && (!state.homed || now_s - homed_s_ < options_.homing_settle_s);
  if (!settling_) {
    was_homed_ = true;
    return true;
  }
  has_position_ = false;
  velocity_mm_s_.setZero();
  ramp_start_s_ = now_s;
  ramp_s_ = options_.soft_start_s;
  return false;
}

Vec3 ForceGovernor::faded(const Vec3& wanted_n) noexcept {
  if (!has_position_) return Vec3::Zero();  // no position, no force
  Vec3 left_n = wanted_n;
  const double speed = velocity_mm_s_.norm();
  if (options_.fade_from_mm_per_s > 0.0 && speed > options_.fade_from_mm_per_s) {
    const Vec3 ahead = velocity_mm_s_ / speed;
    const double push_n = std::max(0.0, left_n.dot(ahead));
    left_n -= smooth_step((speed - options_.fade_from_mm_per_s) /
                          (options_.fade_to_mm_per_s - options_.fade_from_mm_per_s)) *
              push_n * ahead;
    if (push_n > 0.0) ++counters_.speed_faded;
  }
  if (options_.edge_share == 0.0) return left_n;
  const Vec3 inside_n = faded_at_edge(limits_, options_.edge_share,
                                      options_.edge_damping_share * limits_.damping_max_n_s_per_mm,
                                      last_position_mm_, velocity_mm_s_, left_n);
  if (inside_n != left_n) ++counters_.edge_faded;
  return inside_n;
}

Vec3 ForceGovernor::clamped(const Vec3& wanted_n) noexcept {
  const double size_n = wanted_n.stableNorm();  // no overflow, unlike a square
  if (size_n <= limit_n_) return wanted_n;
  ++counters_.clamped;
  // Near the largest double even the norm overflows: scales by the largest component first.
  const Vec3 scaled = wanted_n / wanted_n.cwiseAbs().maxCoeff();
  return scaled * (limit_n_ / scaled.norm());
}

Vec3 ForceGovernor::slewed(const Vec3& target_n, double elapsed_s) noexcept {
  // A late frame is allowed no larger step than a punctual one.
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
    latch(found);
    return zero();
  }
  const double elapsed_s = has_frame_ ? now_s - last_frame_s_ : options_.period_s;
  const bool late = late_s(now_s) > options_.late_zero_s;
  remember(now_s, state, wanted_n);
  if (!settled(now_s, state)) return zero();
  if (late) {
    ++counters_.late_zeroed;
    // Starts the ramp so that it never overtakes a running soft start.
    const double share = gain(now_s);
    ramp_s_ = share < 1.0 ? ramp_s_ : options_.late_ramp_s;
    ramp_start_s_ = now_s;
    return zero();
  }
  slewed_n_ = slewed(clamped(faded(wanted_n)), elapsed_s);
  const Vec3 out_n = gain(now_s) * slewed_n_;
  if (!is_finite(out_n) || out_n.norm() > limit_n_ * kLimitSlack) {
    latch(Fault::kOutOfRange);
    return zero();
  }
  return GovernedForce(out_n);
}

}  // namespace palpate::device
