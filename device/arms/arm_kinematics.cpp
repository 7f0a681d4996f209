#include "device/arms/arm_kinematics.h"

#include <cmath>

namespace palpate::device {
namespace {

using Vec2 = Eigen::Vector2d;

// Of the linkage's own lengths: nearer to stretched out the rod passes no torque on, and the angle of the
// forearm is not determined by the cranks.
constexpr double kStretched = 1e-6;
constexpr double kGravityMS2 = 9.81;  // kg, mm and m/s^2 give N*mm

/// A plane linkage turned about z: rho outwards, z upwards, each with its derivatives by B and C.
ArmPose turned(double a, double rho, const std::array<double, 2>& d_rho, double z,
               const std::array<double, 2>& d_z, const Vec3& origin_mm) noexcept {
  const double c = std::cos(a), s = std::sin(a);
  ArmPose pose;
  pose.position_mm = Vec3(rho * c, rho * s, z) - origin_mm;
  pose.mm_per_rad.col(0) = Vec3(-rho * s, rho * c, 0.0);
  for (int i = 0; i < 2; ++i) {
    const auto at = static_cast<std::size_t>(i);
    pose.mm_per_rad.col(i + 1) = Vec3(d_rho[at] * c, d_rho[at] * s, d_z[at]);
  }
  return pose;
}

ArmPose chain_pose(const ArmGeometry& geometry, const ArmAngles& angles) noexcept {
  const double shoulder = geometry.lengths_mm[0], upper = geometry.lengths_mm[1],
               fore = geometry.lengths_mm[2];
  const double cb = std::cos(angles[1]), sb = std::sin(angles[1]);
  const double cc = std::cos(angles[2]), sc = std::sin(angles[2]);
  return turned(angles[0], upper * sb + fore * sc, {upper * cb, fore * cc}, shoulder + upper * cb - fore * cc,
                {-upper * sb, fore * sc}, geometry.origin_mm);
}

// In the plane of the arm: crank B ends at b, the elbow; crank C at e. The forearm goes through the elbow, on
// one side to the grip, on the other for L4 to the rod, which comes from e. With d = b - e and u the
// forearm's direction, |d - L4 u| = L3 is the angle between d and u.
std::optional<ArmPose> five_bar_pose(const ArmGeometry& geometry, const ArmAngles& angles) noexcept {
  const auto [l0, l1, l2, l3, l4, l5] = geometry.lengths_mm;
  const Vec2 unit_b(std::cos(angles[1]), std::sin(angles[1])),
      unit_c(std::cos(angles[2]), std::sin(angles[2]));
  const Vec2 b = Vec2(0.5 * l0, 0.0) + l1 * unit_b, e = Vec2(-0.5 * l0, 0.0) + l2 * unit_c;
  const Vec2 d = b - e, from_c = b - Vec2(-0.5 * l0, 0.0);
  // On the other side the linkage has gone through a position where it has two ways on.
  if (!(from_c.x() * l2 * unit_c.y() - from_c.y() * l2 * unit_c.x() > 0.0)) return std::nullopt;
  const double distance = d.norm();
  const double cosine = (d.squaredNorm() + l4 * l4 - l3 * l3) / (2.0 * distance * l4);
  if (!(std::abs(cosine) < 1.0 - kStretched)) return std::nullopt;
  const double forearm = std::atan2(d.y(), d.x()) - std::acos(cosine);
  const Vec2 u(std::cos(forearm), std::sin(forearm)), across(-u.y(), u.x());
  // r = d - L4 u keeps its length: r . (dd - L4 across dforearm) = 0.
  const Vec2 rod = d - l4 * u;
  const double lever = l4 * rod.dot(across);
  const Vec2 db(-l1 * unit_b.y(), l1 * unit_b.x()), de(-l2 * unit_c.y(), l2 * unit_c.x());
  const double forearm_by_b = rod.dot(db) / lever, forearm_by_c = -rod.dot(de) / lever;
  const Vec2 by_b = db + l5 * forearm_by_b * across, by_c = l5 * forearm_by_c * across;
  const Vec2 grip = b + l5 * u;
  return turned(angles[0], grip.x(), {by_b.x(), by_c.x()}, grip.y(), {by_b.y(), by_c.y()},
                geometry.origin_mm);
}

}  // namespace

std::optional<ArmPose> arm_pose(const ArmGeometry& geometry, const ArmAngles& angles) noexcept {
  std::optional<ArmPose> pose =
      geometry.linkage == ArmLinkage::kChain ? chain_pose(geometry, angles) : five_bar_pose(geometry, angles);
  if (pose && !(is_finite(pose->position_mm) && pose->mm_per_rad.allFinite())) pose.reset();
  return pose;
}

Vec3 weight_torques_n_mm(const ArmGeometry& geometry, const ArmMasses& masses,
                         const ArmAngles& angles) noexcept {
  if (geometry.linkage != ArmLinkage::kChain) return Vec3::Zero();
  const double upper = masses.upper_kg * masses.upper_mm + masses.fore_kg * geometry.lengths_mm[1];
  return {0.0, -kGravityMS2 * upper * std::sin(angles[1]),
          kGravityMS2 * masses.fore_kg * masses.fore_mm * std::sin(angles[2])};
}

double arm_resolution_mm(const ArmGeometry& geometry, const std::array<double, 3>& step_rad) noexcept {
  const auto& lengths = geometry.lengths_mm;
  const bool chain = geometry.linkage == ArmLinkage::kChain;
  const double reach = std::hypot(geometry.origin_mm.x(), geometry.origin_mm.y());
  // A step of crank C moves the rod's end by L2, and the grip by that over the lever L4.
  const double by_b = lengths[1], by_c = chain ? lengths[2] : lengths[5] * lengths[2] / lengths[4];
  return Vec3(reach * step_rad[0], by_b * step_rad[1], by_c * step_rad[2]).norm();
}

}  // namespace palpate::device
