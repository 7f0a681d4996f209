#include "device/haply/planar_kinematics.h"

#include <cmath>

namespace palpate::device {
namespace {

// Sine of the angle between the two bars, below which a motor's torque becomes a force twenty times what it
// is with the bars across.
constexpr double kLeastSine = 0.05;

/// The angle at the motor between the line to the place and the crank; nothing out of reach.
std::optional<double> crank_turn(const PantographGeometry& geometry, double distance_mm) noexcept {
  const double l = geometry.crank_mm, bar = geometry.bar_mm;
  const double cosine = (l * l + distance_mm * distance_mm - bar * bar) / (2.0 * l * distance_mm);
  if (!(std::abs(cosine) <= 1.0)) return std::nullopt;
  return std::acos(cosine);
}

}  // namespace

std::optional<PantographPose> pantograph_pose(const PantographGeometry& geometry,
                                              const std::array<double, 2>& angles) noexcept {
  using Eigen::Vector2d;
  const double l = geometry.crank_mm, bar = geometry.bar_mm;
  const Vector2d unit_1(std::cos(angles[0]), std::sin(angles[0])),
      unit_2(std::cos(angles[1]), std::sin(angles[1]));
  const Vector2d a = l * unit_1, b = Vector2d(geometry.between_mm, 0.0) + l * unit_2;
  const Vector2d half = 0.5 * (b - a);
  const double height_sq = bar * bar - half.squaredNorm();
  if (!(height_sq > 0.0) || !(half.norm() > 0.0)) return std::nullopt;
  PantographPose pose;
  pose.position_mm = a + half + std::sqrt(height_sq) / half.norm() * Vector2d(-half.y(), half.x());
  // Bars keep their length: (p - a) . dp = (p - a) . da, and for b alike.
  const Vector2d along_1 = pose.position_mm - a, along_2 = pose.position_mm - b;
  const double across = along_1.x() * along_2.y() - along_1.y() * along_2.x();
  if (!(std::abs(across) >= kLeastSine * bar * bar)) return std::nullopt;
  const double push_1 = along_1.dot(l * Vector2d(-unit_1.y(), unit_1.x()));
  const double push_2 = along_2.dot(l * Vector2d(-unit_2.y(), unit_2.x()));
  pose.mm_per_rad.col(0) = push_1 / across * Vector2d(along_2.y(), -along_2.x());
  pose.mm_per_rad.col(1) = push_2 / across * Vector2d(-along_1.y(), along_1.x());
  return pose;
}

std::optional<std::array<double, 2>> pantograph_angles(const PantographGeometry& geometry,
                                                       const Eigen::Vector2d& place_mm) noexcept {
  const Eigen::Vector2d from_second = place_mm - Eigen::Vector2d(geometry.between_mm, 0.0);
  const std::optional<double> first = crank_turn(geometry, place_mm.norm());
  const std::optional<double> second = crank_turn(geometry, from_second.norm());
  if (!first || !second) return std::nullopt;
  return std::array<double, 2>{std::atan2(place_mm.y(), place_mm.x()) + *first,
                               std::atan2(from_second.y(), from_second.x()) - *second};
}

}  // namespace palpate::device
