#include "device/simulated/simulated_admittance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "device/interface/option_check.h"
#include "toolkit/core/try.h"

namespace palpate::device {
Status SimulatedAdmittance::open() {
  const auto numbers =
      std::to_array<CheckedNumber>({{"mass_kg", options_.mass_kg, false},
                                    {"damping_n_s_per_mm", options_.damping_n_s_per_mm, true},
                                    {"bandwidth_hz", options_.bandwidth_hz, true},

                                    {"force_max_n", options_.force_max_n, false},
                                    {"speed_max_mm_s", options_.speed_max_mm_s, false},
                                    {"period_s", options_.period_s, false},
                                    {"workspace_mm", options_.workspace_mm, false}});
  PALPATE_TRY(check_numbers(numbers, name()));
  open_ = true;
  opened_s_ = clock_.now_s();
  now_s_ = last_sent_s_ = 0.0;
  last_read_s_ = -1.0;
  goal_mm_ = script_.at(0.0).position_mm;
  goal_mm_s_.setZero();
  motion_ = {goal_mm_, Vec3::Zero(), Vec3::Zero()};
  shown_n_.setZero();
  ledger_ = {};
  return Done{};
}

DeviceLimits SimulatedAdmittance::limits() const noexcept {
  const Vec3 half = Vec3::Constant(options_.workspace_mm);
  return {options_.force_max_n, {-half, half}, 0.0, 1.0 / options_.period_s};
}

Vec3 SimulatedAdmittance::hand_n(double t_s) const noexcept {
  if (t_s >= script_.release_s) return Vec3::Zero();
  const Goal goal = script_.at(t_s);
  return hand_.push_n + hand_.stiffness_n_per_mm * (goal.position_mm - motion_.x_mm) +
         hand_.damping_n_s_per_mm * (goal.velocity_mm_s - motion_.v_mm_s);
}

void SimulatedAdmittance::advance_to(double t_s) noexcept {
  const double way_s = t_s - now_s_;
  if (!(way_s > 0.0)) return;
  const double steps = std::max(1.0, std::ceil(way_s * kSubStepsPerPeriod / options_.period_s));
  const double h_s = way_s / steps, from_s = now_s_;
  const double rate = 2.0 * std::numbers::pi * options_.bandwidth_hz;
  for (double i = 0.0; i < steps; ++i) {
    const Vec3 before_mm = motion_.x_mm, before_n = hand_n(from_s + i * h_s);
    if (rate > 0.0) {
      // As if of one N s^2/mm: only the ratios count.
      motion_ = moved({1.0 / kNS2PerMmPerKg, 2.0 * rate, rate * rate, 0.0}, motion_,
                      {Vec3::Zero(), goal_mm_, goal_mm_s_, 2.0 * rate * goal_mm_s_}, h_s);
    } else {
      motion_.x_mm = goal_mm_ + h_s * goal_mm_s_;
      motion_.v_mm_s = goal_mm_s_;
    }
    goal_mm_ += h_s * goal_mm_s_;
    ledger_.motors -= 0.5 * (before_n + hand_n(from_s + (i + 1.0) * h_s)).dot(motion_.x_mm - before_mm);
  }
  now_s_ = t_s;
}

DeviceState SimulatedAdmittance::read() noexcept {
  DeviceState state;
  if (!open_) {
    state.status = ReadStatus::kLost;
    return state;
  }
  const double t_s = clock_.now_s() - opened_s_;
  advance_to(t_s);
  state.position_mm = goal_mm_;
  state.status = t_s == last_read_s_ ? ReadStatus::kNothingNew : ReadStatus::kFresh;
  last_read_s_ = t_s;
  return state;
}

void SimulatedAdmittance::send(GovernedForce force) noexcept {
  if (!open_) return;
  const Vec3 hand = hand_n(now_s_);
  shown_n_ = -hand;
  const double dt_s = now_s_ > last_sent_s_ ? now_s_ - last_sent_s_ : options_.period_s;
  last_sent_s_ = now_s_;
  const double mass = options_.mass_kg * kNS2PerMmPerKg;
  goal_mm_s_ += dt_s / mass * (hand + force.newtons() - options_.damping_n_s_per_mm * goal_mm_s_);
  const double speed = goal_mm_s_.norm();
  if (speed > options_.speed_max_mm_s) goal_mm_s_ *= options_.speed_max_mm_s / speed;
}

}  // namespace palpate::device
