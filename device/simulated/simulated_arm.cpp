#include "device/simulated/simulated_arm.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <palpate/result.h>
#include "device/interface/driver_options.h"

namespace palpate::device {
namespace {

// Taylor terms of a linear equation: for |A| h <= 1/2 the first omitted term is below 0.5^15 / 15! = 2e-17,
// less than half a unit roundoff.
constexpr int kTerms = 14;
constexpr double kReach = 0.5;

/// One step within the reach of the series, in positions relative to its start.
Motion series(const Plant& plant, const Motion& from, const Drive& drive, double h_s) noexcept {
  const double per_mass = 1.0 / (plant.mass_kg * kNS2PerMmPerKg);
  Vec3 x = Vec3::Zero(), v = from.v_mm_s, motor = plant.lag_s > 0.0 ? from.motor_n : drive.command_n;
  Motion to{x, v, motor};
  for (int k = 0; k < kTerms; ++k) {
    const double step = h_s / (k + 1);
    Vec3 force = motor - plant.damping_n_s_per_mm * v - plant.stiffness_n_per_mm * x;
    if (k == 0) force += drive.steady_n + plant.stiffness_n_per_mm * (drive.goal_mm - from.x_mm);
    if (k == 1) force += plant.stiffness_n_per_mm * h_s * drive.goal_mm_s;
    const Vec3 next_motor = plant.lag_s <= 0.0 ? Vec3(Vec3::Zero())
                            : k == 0           ? Vec3((step / plant.lag_s) * (drive.command_n - motor))
                                               : Vec3((-step / plant.lag_s) * motor);
    x = step * v;
    v = (step * per_mass) * force;
    motor = next_motor;
    to.x_mm += x;
    to.v_mm_s += v;
    to.motor_n += motor;
  }
  to.x_mm += from.x_mm;
  return to;
}

// Reversals within a sub-step; more is chatter and counts as rest.
constexpr int kMaxStops = 8;
constexpr int kHalvings = 40;  // of a sub-step to locate a stop: 1e-12 of it
// Rounding left of a velocity whose main part stopped.
constexpr double kStoppedShare = 1e-9;
// A shorter lag is invisible here and would only cost steps.
constexpr double kMinLagS = 1e-6;

/// Rounds each axis to whole steps; a step of 0 leaves it exact.
Vec3 in_steps(Vec3 value, double step) noexcept {
  if (step > 0.0)
    for (int a = 0; a < 3; ++a) value[a] = step * std::round(value[a] / step);
  return value;
}

/// Integral of v^2 over a step, by Simpson's rule on the cubic with these end values.
double squared_speed_integral(const Motion& from, const Motion& to, double h_s) noexcept {
  const Vec3 middle = 1.5 / h_s * (to.x_mm - from.x_mm) - 0.25 * (from.v_mm_s + to.v_mm_s);
  return h_s / 6.0 * (from.v_mm_s.squaredNorm() + 4.0 * middle.squaredNorm() + to.v_mm_s.squaredNorm());
}

}  // namespace

double Plant::rate_hz() const noexcept {
  const double mass = mass_kg * kNS2PerMmPerKg;
  const double rate = std::max(damping_n_s_per_mm / mass, std::sqrt(stiffness_n_per_mm / mass));
  return lag_s > 0.0 ? std::max(rate, 1.0 / lag_s) : rate;
}

Motion moved(const Plant& plant, const Motion& motion, const Drive& drive, double dt_s) noexcept {
  const double steps = std::max(1.0, std::ceil(dt_s * plant.rate_hz() / kReach));
  const double h_s = dt_s / steps;
  Motion now = motion;
  Drive driven = drive;
  for (double i = 0.0; i < steps; ++i) {
    now = series(plant, now, driven, h_s);
    driven.goal_mm += h_s * driven.goal_mm_s;
  }
  return now;
}

void SimulatedPlant::start() noexcept {
  open_ = true;
  opened_s_ = clock_.now_s();
  now_s_ = 0.0;
  last_read_s_ = -1.0;
  motion_ = {script_.at(0.0).position_mm, Vec3::Zero(), Vec3::Zero()};
  ledger_ = {};
}

DeviceState SimulatedPlant::read() noexcept {
  DeviceState state;
  if (!open_) {
    state.status = ReadStatus::kLost;
    return state;
  }
  const double t_s = clock_.now_s() - opened_s_;
  advance_to(t_s);
  state.position_mm = measured_mm();
  state.status = t_s == last_read_s_ ? ReadStatus::kNothingNew : ReadStatus::kFresh;
  last_read_s_ = t_s;
  return state;
}

SimulatedArm::SimulatedArm(const ArmOptions& options, const Hand& hand, const HandScript& script,
                           const Clock& clock)
    : SimulatedPlant(hand, script, clock), options_(options), in_flight_(kMaxInFlight) {}

Status SimulatedArm::open() {
  const auto numbers =
      std::to_array<CheckedNumber>({{"mass_kg", options_.mass_kg, false},
                                    {"damping_n_s_per_mm", options_.damping_n_s_per_mm, true},
                                    {"friction_n", options_.friction_n, true},
                                    {"encoder_mm", options_.encoder_mm, true},
                                    {"force_max_n", options_.force_max_n, false},
                                    {"force_step_n", options_.force_step_n, true},
                                    {"lag_s", options_.lag_s, true},
                                    {"delay_s", options_.delay_s, true},
                                    {"period_s", options_.period_s, false},
                                    {"workspace_mm", options_.workspace_mm, false},
                                    {"the hand's mass_kg", hand_.mass_kg, true},
                                    {"the hand's damping_n_s_per_mm", hand_.damping_n_s_per_mm, true},
                                    {"the hand's stiffness_n_per_mm", hand_.stiffness_n_per_mm, true}});
  PALPATE_TRY(check_numbers(numbers, name()));
  if (options_.lag_s > 0.0 && options_.lag_s < kMinLagS)
    return Error{"lag_s is below a microsecond", "give 0 for a motor without lag", name()};
  if (options_.delay_s > options_.period_s * static_cast<double>(kMaxInFlight - 1))
    return Error{"delay_s is more than " + std::to_string(kMaxInFlight - 1) + " periods",
                 "give a shorter delay", name()};
  start();
  command_n_.setZero();
  first_ = waiting_ = 0;
  hold(true);
  return Done{};
}

void SimulatedArm::close() noexcept {
  open_ = false;
  command_n_.setZero();
  motion_.motor_n.setZero();
  waiting_ = 0;
}

DeviceLimits SimulatedArm::limits() const noexcept {
  const Vec3 half = Vec3::Constant(options_.workspace_mm);
  return {options_.force_max_n, {-half, half}, options_.encoder_mm, 1.0 / options_.period_s};
}

void SimulatedArm::hold(bool held) noexcept {
  held_ = held;
  const Hand hand = held ? hand_ : Hand{};
  plant_ = {options_.mass_kg + hand.mass_kg, options_.damping_n_s_per_mm + hand.damping_n_s_per_mm,
            hand.stiffness_n_per_mm, options_.lag_s};
}

Vec3 SimulatedArm::measured_mm() const noexcept {
  return in_steps(motion_.x_mm, options_.encoder_mm);
}

Vec3 SimulatedArm::as_motor(const Vec3& force_n) const noexcept {
  Vec3 motor = force_n;
  const double size = motor.norm();
  if (size > options_.force_max_n) motor *= options_.force_max_n / size;
  return in_steps(motor, options_.force_step_n);
}

void SimulatedArm::send(GovernedForce force) noexcept {
  if (!open_) return;
  const Command command{now_s_ + options_.delay_s, as_motor(force.newtons())};
  if (options_.delay_s == 0.0 || waiting_ == kMaxInFlight) {
    command_n_ = command.force_n;
    return;
  }
  in_flight_[(first_ + waiting_++) % kMaxInFlight] = command;
}

void SimulatedArm::advance_to(double t_s) noexcept {
  while (waiting_ > 0 && in_flight_[first_].due_s <= t_s) {
    advance_by(in_flight_[first_].due_s - now_s_);
    command_n_ = in_flight_[first_].force_n;
    first_ = (first_ + 1) % kMaxInFlight;
    --waiting_;
  }
  advance_by(t_s - now_s_);
}

void SimulatedArm::advance_by(double dt_s) noexcept {
  if (!(dt_s > 0.0)) return;
  if (held_ && now_s_ < script_.release_s && now_s_ + dt_s > script_.release_s) {
    const double before_s = script_.release_s - now_s_;
    advance_by(before_s);
    hold(false);
    advance_by(dt_s - before_s);
    return;
  }
  if (held_ && now_s_ >= script_.release_s) hold(false);
  const double steps = std::max(1.0, std::ceil(dt_s * kSubStepsPerPeriod / options_.period_s));
  const double h_s = dt_s / steps, from_s = now_s_;
  for (double i = 0.0; i < steps; ++i) {
    now_s_ = from_s + i * h_s;
    if (held_ && hand_.guides)
      guided_step(h_s);
    else
      sub_step(h_s);
  }
  now_s_ = from_s + dt_s;
}

void SimulatedArm::account(const Motion& to, double h_s, const Vec3& friction_n) noexcept {
  if (!(h_s > 0.0)) return;
  const Vec3 way_mm = to.x_mm - motion_.x_mm;
  ledger_.motors += 0.5 * (motion_.motor_n + to.motor_n).dot(way_mm);
  ledger_.friction -= friction_n.dot(way_mm);
  ledger_.damping += options_.damping_n_s_per_mm * squared_speed_integral(motion_, to, h_s);
  motion_ = to;
}

/// The device follows the hand's goal exactly.
void SimulatedArm::guided_step(double h_s) noexcept {
  Motion to = moved({1.0, 0.0, 0.0, options_.lag_s}, motion_, {command_n_, {}, {}, {}}, h_s);
  to.x_mm = script_.at(now_s_ + h_s).position_mm;
  to.v_mm_s = (to.x_mm - motion_.x_mm) / h_s;
  motion_.v_mm_s = to.v_mm_s;
  if (options_.lag_s == 0.0) motion_.motor_n = command_n_;
  const double speed = stable_norm(to.v_mm_s);
  account(to, h_s, speed > 0.0 ? Vec3(-options_.friction_n / speed * to.v_mm_s) : Vec3(Vec3::Zero()));
}

void SimulatedArm::sub_step(double h_s) noexcept {
  Drive drive{command_n_, motion_.x_mm, Vec3::Zero(), Vec3::Zero()};
  if (held_) {
    const Goal goal = script_.at(now_s_), next = script_.at(now_s_ + h_s);
    drive.goal_mm = goal.position_mm;
    drive.goal_mm_s = (next.position_mm - goal.position_mm) / h_s;
    drive.steady_n = hand_.push_n + hand_.damping_n_s_per_mm * drive.goal_mm_s;
  }
  if (options_.lag_s == 0.0) motion_.motor_n = command_n_;
  double left_s = h_s;
  for (int stop = 0; left_s > 0.0; ++stop) {
    if (stop == kMaxStops) motion_.v_mm_s.setZero();
    const double taken_s = slide(left_s, drive);
    drive.goal_mm += taken_s * drive.goal_mm_s;
    left_s = stop == kMaxStops || taken_s >= left_s ? 0.0 : left_s - taken_s;
  }
}

/// Moves with friction against the motion while the direction stays; returns how long. At rest held by
/// friction: all of `h_s`.
double SimulatedArm::slide(double h_s, const Drive& drive) noexcept {
  Drive driven = drive;
  const bool rests = motion_.v_mm_s == Vec3::Zero();
  Vec3 direction = motion_.v_mm_s;
  if (options_.friction_n > 0.0) {
    if (rests)
      direction =
          motion_.motor_n + drive.steady_n + plant_.stiffness_n_per_mm * (drive.goal_mm - motion_.x_mm);
    const double size = direction.norm();
    if (rests && size <= options_.friction_n) {
      Motion to = moved({1.0, 0.0, 0.0, options_.lag_s}, motion_, {command_n_, {}, {}, {}}, h_s);
      to.x_mm = motion_.x_mm;
      to.v_mm_s.setZero();
      account(to, h_s, Vec3::Zero());
      return h_s;
    }
    direction /= size;
    driven.steady_n -= options_.friction_n * direction;
  }
  const Vec3 friction_n = driven.steady_n - drive.steady_n;
  const Motion to = moved(plant_, motion_, driven, h_s);
  if (options_.friction_n == 0.0 || rests || to.v_mm_s.dot(direction) > 0.0) {
    account(to, h_s, friction_n);
    return h_s;
  }
  double low = 0.0, high = h_s;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (moved(plant_, motion_, driven, middle).v_mm_s.dot(direction) > 0.0 ? low : high) = middle;
  }
  const double before = motion_.v_mm_s.norm();
  Motion stopped = moved(plant_, motion_, driven, high);
  stopped.v_mm_s -= direction.dot(stopped.v_mm_s) * direction;
  if (stopped.v_mm_s.norm() <= kStoppedShare * before) stopped.v_mm_s.setZero();
  account(stopped, high, friction_n);
  return high;
}

bool SimulatedArm::at_rest() const noexcept {
  const bool goal_rests = !held_ || (now_s_ >= script_.rests_from_s() && std::isinf(script_.release_s));
  return goal_rests && motion_.v_mm_s == Vec3::Zero();
}

EnergyLedger SimulatedArm::energy() const noexcept {
  EnergyLedger now = ledger_;
  now.kinetic = 0.5 * options_.mass_kg * kNS2PerMmPerKg * motion_.v_mm_s.squaredNorm();
  return now;
}

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
  start();
  last_sent_s_ = 0.0;
  goal_mm_ = motion_.x_mm;
  goal_mm_s_.setZero();
  shown_n_.setZero();
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
      // Mass 1 N s^2/mm: only ratios matter.
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
