#include "experiments/stress/shapes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate::experiments {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr int kLeastOnRing = 5;  // fewer are no ring

/// A ring around `centre`, spanned by two unit vectors; every second one is turned by half a step.
void add_ring(std::vector<Vec3>& points, const Vec3& centre, const Vec3& u, const Vec3& v, double radius,
              double spacing, int turn) {
  const int count = std::max(kLeastOnRing, static_cast<int>(kTurn * radius / spacing));
  for (int i = 0; i < count; ++i) {
    const double angle = kTurn * (i + 0.5 * (turn % 2)) / count;
    points.push_back(centre + radius * (std::cos(angle) * u + std::sin(angle) * v));
  }
}

}  // namespace

std::vector<Vec3> lattice_points(const Vec3& corner, const Vec3& column, const Vec3& row, int columns,
                                 int rows) {
  std::vector<Vec3> points;
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) points.emplace_back(corner + i * column + j * row);
  return points;
}

std::vector<Vec3> ball_points(const Vec3& centre, double radius, int count) {
  std::vector<Vec3> points;
  for (int i = 0; i < count; ++i) {
    const double z = 1.0 - (2.0 * i + 1.0) / count, across = std::sqrt(1.0 - z * z);
    const double angle = kTurn * std::numbers::phi * i;
    points.emplace_back(centre + radius * Vec3(across * std::cos(angle), across * std::sin(angle), z));
  }
  return points;
}

std::vector<Vec3> cone_points(double radius, double height, double spacing) {
  std::vector<Vec3> points;
  const int rings = static_cast<int>(height / spacing);
  for (int k = 0; k < rings; ++k) {
    const double share = static_cast<double>(k) / rings;
    add_ring(points, {0, 0, share * height}, Vec3::UnitX(), Vec3::UnitY(), (1.0 - share) * radius, spacing,
             k);
  }
  points.emplace_back(0, 0, height);
  return points;
}

std::vector<Vec3> horn_points(double bend_radius, double thick_radius, double spacing) {
  std::vector<Vec3> points;
  const double quarter = 0.25 * kTurn;
  const int rings = static_cast<int>(quarter * bend_radius / spacing);
  for (int k = 0; k < rings; ++k) {
    const double share = static_cast<double>(k) / rings, angle = share * quarter;
    const Vec3 outward(std::cos(angle), std::sin(angle), 0);
    add_ring(points, bend_radius * outward, outward, Vec3::UnitZ(), (1.0 - share) * thick_radius, spacing, k);
  }
  points.emplace_back(0, bend_radius, 0);
  return points;
}

}  // namespace palpate::experiments
