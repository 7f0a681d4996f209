#include "device/falcon/falcon_device.h"

#include <Eigen/LU>

#include <array>
#include <cmath>
#include <numbers>

namespace palpate::device {
namespace {

// Stamper's symbols, mm.
constexpr double kThighMm = 60.0;                     // a
constexpr double kShinMm = 102.5;                     // b
constexpr double kGripU = 14.43, kGripV = -25.0;      // c, f: end of a shin, from the grip's middle
constexpr double kStubsMm = 2.0 * 11.25;              // d + e: above and below the parallelogram
constexpr double kBaseU = 40.0, kBaseV = -23.09;      // r, s: start of a thigh
constexpr double kDegree = std::numbers::pi / 180.0;  // rad
// Cosines and sines of the legs' directions, to the last digit of a double. Clockwise from the top as the
// user sees them: 105, -15 (right), -135 degrees (left).
struct LegTurn {
  double c, s;
};
constexpr double kCos15 = 0.96592582628906829, kSin15 = 0.25881904510252076;
constexpr double kHalfRoot = std::numbers::sqrt2 / 2.0;
constexpr std::array<LegTurn, 3> kLegs = {LegTurn{-kSin15, kCos15}, LegTurn{kCos15, -kSin15},
                                          LegTurn{-kHalfRoot, -kHalfRoot}};

// 320 lines, four counts each per motor turn; the capstan drives a sector.
constexpr double kCountsPerTurn = 320.0 * 4.0, kCapstanMm = 14.25, kSectorMm = 110.0;
constexpr double kRadPerCount = 2.0 * std::numbers::pi / kCountsPerTurn * kCapstanMm / kSectorMm;
constexpr double kAngleAtZero = 35.0 * kDegree;

// Newton's method doubles the digits: the next step is rounding. A count is 6e5 times larger.
constexpr double kConvergedRad = 1e-10;
// A smaller determinant of A, (rad/mm)^3, is a singular pose: the centre has 4e-6, the workspace a 3.5-fold
// range.
constexpr double kMinDeterminant = 1e-9;

/// Leg plane: u outwards, v across, w along z.
struct LegPoint {
  double u, v_plus_f, w;
  double q;       // length of the shin seen along v
  double across;  // q plus the stubs: L
};

/// Nothing if the parallelogram cannot lean that far.
std::optional<LegPoint> leg_point(const Vec3& position_mm, std::size_t leg) noexcept {
  const auto [c, s] = kLegs[leg];
  const double u = c * position_mm.x() + s * position_mm.y() - kBaseU;
  const double v = c * position_mm.y() - s * position_mm.x() - kBaseV;
  LegPoint point{u + kGripU, v + kGripV, position_mm.z(), 0.0, 0.0};
  const double squared = kShinMm * kShinMm - point.v_plus_f * point.v_plus_f;
  if (!(squared > 0.0)) return std::nullopt;
  point.q = std::sqrt(squared);
  point.across = kStubsMm + point.q;
  return point;
}

std::optional<double> leg_angle(const LegPoint& point) noexcept {
  const double squared = point.u * point.u + point.w * point.w;
  const double cosine =
      (squared + kThighMm * kThighMm - point.across * point.across) / (2.0 * kThighMm * std::sqrt(squared));
  if (!(std::abs(cosine) <= 1.0)) return std::nullopt;
  return std::atan2(point.w, point.u) - std::acos(cosine);
}

}  // namespace

std::optional<Vec3> falcon_angles(const Vec3& position_mm) noexcept {
  Vec3 angles;
  for (std::size_t leg = 0; leg < kLegs.size(); ++leg) {
    const std::optional<LegPoint> point = leg_point(position_mm, leg);
    if (!point) return std::nullopt;
    const std::optional<double> angle = leg_angle(*point);
    if (!angle) return std::nullopt;
    angles[static_cast<Eigen::Index>(leg)] = *angle;
  }
  return angles;
}

// From g = (U - a cos θ)² + (w - a sin θ)² - L² = 0, constant along the leg's motion.
std::optional<Mat3> falcon_jacobian(const Vec3& position_mm, const Vec3& angles_rad) noexcept {
  Mat3 jacobian;
  for (std::size_t leg = 0; leg < kLegs.size(); ++leg) {
    const auto row = static_cast<Eigen::Index>(leg);
    const std::optional<LegPoint> point = leg_point(position_mm, leg);
    if (!point) return std::nullopt;
    const double c = std::cos(angles_rad[row]), s = std::sin(angles_rad[row]);
    const double du = point->u - kThighMm * c, dw = point->w - kThighMm * s;
    const double by_angle = 2.0 * kThighMm * (du * s - dw * c);
    const double by_u = 2.0 * du, by_v = 2.0 * point->across * point->v_plus_f / point->q;
    const auto [cos_leg, sin_leg] = kLegs[leg];
    const Vec3 by_place{by_u * cos_leg - by_v * sin_leg, by_u * sin_leg + by_v * cos_leg, 2.0 * dw};
    jacobian.row(row) = -by_place.transpose() / by_angle;
  }
  if (!jacobian.allFinite()) return std::nullopt;
  return jacobian;
}

std::optional<Vec3> falcon_torques(const Mat3& jacobian, const Vec3& force_n) noexcept {
  if (!(std::abs(jacobian.determinant()) > kMinDeterminant)) return std::nullopt;
  const Vec3 torques = jacobian.inverse().transpose() * force_n;
  if (!is_finite(torques)) return std::nullopt;
  return torques;
}

FalconPose falcon_position(const Vec3& angles_rad, const Vec3& start_mm) noexcept {
  FalconPose pose;
  pose.position_mm = start_mm;
  std::optional<Vec3> angles = falcon_angles(start_mm);
  if (!angles || !is_finite(angles_rad)) return pose;
  for (;; ++pose.steps) {
    const Vec3 missing = angles_rad - *angles;
    if (missing.cwiseAbs().maxCoeff() < kConvergedRad) break;
    if (pose.steps == kFalconNewtonSteps) return pose;
    const std::optional<Mat3> jacobian = falcon_jacobian(pose.position_mm, *angles);
    if (!jacobian || !(std::abs(jacobian->determinant()) > kMinDeterminant)) return pose;
    Vec3 step = jacobian->inverse() * missing;
    // Halves a step that leaves the reach of the legs, where no angles exist.
    std::optional<Vec3> next = falcon_angles(pose.position_mm + step);
    for (int halvings = 0; !next && halvings < kFalconHalvings; ++halvings) {
      step *= 0.5;
      next = falcon_angles(pose.position_mm + step);
    }
    if (!next) return pose;
    pose.position_mm += step;
    angles = next;
  }
  // The same angles fit a mirrored arm behind the base, which no Falcon has.
  pose.converged = pose.position_mm.z() > 0.0;
  return pose;
}

Vec3 falcon_angles_of_counts(const Vec3& counts) noexcept {
  return Vec3::Constant(kAngleAtZero) + kRadPerCount * counts;
}

}  // namespace palpate::device
