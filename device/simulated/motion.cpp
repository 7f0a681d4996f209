#include "device/simulated/motion.h"

#include <algorithm>
#include <cmath>

namespace palpate::device {
namespace {

// Of the Taylor series of a linear equation: with |A| h <= 1/2 the term after the last is below
// 0.5^15 / 15! = 2e-17, less than half a unit roundoff.
constexpr int kTerms = 14;
constexpr double kReach = 0.5;

/// One step within the reach of the series; positions count from where it begins, so that a device far from
/// the origin moves as one near it.
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

}  // namespace palpate::device
