#include "device/simulated/loop_theory.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace palpate::device {
namespace {

constexpr double kStep = 1.1;    // of the search upwards
constexpr double kRange = 1e6;   // that it covers
constexpr double kExact = 1e-6;  // of the halving
// Rounding of the eigenvalues: a pole on the circle, such as that of a device nobody holds, counts as inside.
constexpr double kOnCircle = 1e-12;

/// One axis of the plant over dt: (x, v, motor) and the command make the next (x, v, motor).
Eigen::Matrix<double, 3, 4> over(const Plant& plant, double dt_s) {
  Eigen::Matrix<double, 3, 4> map;
  for (int c = 0; c < 4; ++c) {
    const Motion from{c == 0 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::Zero()),
                      c == 1 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::Zero()),
                      c == 2 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::Zero())};
    Drive drive;
    if (c == 3) drive.command_n = Vec3::UnitX();
    const Motion to = dt_s > 0.0 ? moved(plant, from, drive, dt_s) : from;
    map.col(c) << to.x_mm.x(), to.v_mm_s.x(), to.motor_n.x();
  }
  return map;
}

}  // namespace

double passive_stiffness_n_per_mm(double damping_n_s_per_mm, double wall_damping_n_s_per_mm,
                                  double friction_n, double encoder_mm, double period_s) noexcept {
  const double sampled =
      std::max(0.0, 2.0 * (damping_n_s_per_mm - std::abs(wall_damping_n_s_per_mm)) / period_s);
  return encoder_mm > 0.0 ? std::min(sampled, 2.0 * friction_n / encoder_mm) : sampled;
}

double delayed_stiffness_n_per_mm(double damping_n_s_per_mm, double wall_damping_n_s_per_mm, double period_s,
                                  double delay_s) noexcept {
  return (damping_n_s_per_mm + wall_damping_n_s_per_mm) / (0.5 * period_s + delay_s);
}

double spectral_radius(const LinearLoop& loop, double stiffness_n_per_mm) {
  const auto whole = static_cast<int>(
      std::clamp(std::floor(loop.delay_s / loop.period_s), 0.0, static_cast<double>(kMostPeriodsOfDelay)));
  const double rest_s = std::max(0.0, loop.delay_s - whole * loop.period_s);
  // State: x, v, motor, x one period ago, and the commands that are still to act, the newest first.
  const int sent = whole + 1, size = 4 + sent;
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(size, size);
  Eigen::RowVectorXd command = Eigen::RowVectorXd::Zero(size);
  command(0) = -stiffness_n_per_mm - loop.wall_damping_n_s_per_mm / loop.period_s;
  command(3) = loop.wall_damping_n_s_per_mm / loop.period_s;
  // During the first part of the period the command of `whole + 1` periods ago acts, then that of `whole`.
  Eigen::RowVectorXd early = Eigen::RowVectorXd::Zero(size), late = command;
  early(4 + whole) = 1.0;
  if (whole > 0) {
    late.setZero();
    late(4 + whole - 1) = 1.0;
  }
  Eigen::MatrixXd motion = Eigen::MatrixXd::Zero(3, size);
  motion.leftCols(3).setIdentity();
  for (const auto& [dt_s, acts] : {std::pair{rest_s, early}, std::pair{loop.period_s - rest_s, late}}) {
    if (!(dt_s > 0.0)) continue;
    const Eigen::Matrix<double, 3, 4> part = over(loop.plant, dt_s);
    motion = (part.leftCols(3) * motion + part.col(3) * acts).eval();
  }
  map.topRows(3) = motion;
  map(3, 0) = 1.0;
  map.row(4) = command;
  for (int i = 1; i < sent; ++i) map(4 + i, 4 + i - 1) = 1.0;
  return Eigen::EigenSolver<Eigen::MatrixXd>(map, false).eigenvalues().cwiseAbs().maxCoeff();
}

double linear_stiffness_n_per_mm(const LinearLoop& loop, double least_n_per_mm) {
  const auto stable = [&](double k) { return spectral_radius(loop, k) <= 1.0 + kOnCircle; };
  double high = least_n_per_mm;
  while (stable(high)) {
    high *= kStep;
    if (high > kRange * least_n_per_mm) return std::numeric_limits<double>::infinity();
  }
  double low = high / kStep;
  while (high > low * (1.0 + kExact)) {
    const double middle = std::sqrt(low * high);
    (stable(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace palpate::device
