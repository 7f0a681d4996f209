#include "experiments/stress/shapes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate::experiments {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr int kLeastOnRing = 5;  // fewer make no ring

/// Adds a ring around `centre` spanned by two unit vectors; every second ring is turned by half a step.
void add_ring(std::vector<Vec3>& points, const Vec3& centre, const Vec3& u, const Vec3& v, double radius,
              double spacing, int turn) {
  const int count = std::max(kLeastOnRing, static_cast<int>(kTurn * radius / spacing));
  for (int i = 0; i < count; ++i) {
    const double angle = kTurn * (i + 0.5 * (turn % 2)) / count;
    points.push_back(centre + radius * (std::cos(angle) * u + std::sin(angle) * v));
  }
}

/// The profile's corners with points between, at most `step_mm` apart.
std::vector<OnProfile> filled_profile(const std::vector<OnProfile>& corners, double step_mm) {
  std::vector<OnProfile> filled = {corners.front()};
  for (std::size_t i = 1; i < corners.size(); ++i) {
    const OnProfile from = corners[i - 1], to = corners[i];
    const double radius = to.radius_mm - from.radius_mm, z = to.z_mm - from.z_mm;
    const int steps = std::max(1, static_cast<int>(std::ceil(std::hypot(radius, z) / step_mm)));
    for (int k = 1; k < steps; ++k) {
      const double share = static_cast<double>(k) / steps;
      filled.push_back({from.radius_mm + share * radius, from.z_mm + share * z});
    }
    filled.push_back(to);
  }
  return filled;
}

}  // namespace

std::vector<Vec3> joined_points(std::vector<Vec3> points, const std::vector<Vec3>& more) {
  points.insert(points.end(), more.begin(), more.end());
  return points;
}

std::vector<Vec3> lattice_points(const Vec3& corner, const Vec3& column, const Vec3& row, int columns,
                                 int rows) {
  std::vector<Vec3> points;
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) points.emplace_back(corner + i * column + j * row);
  return points;
}

std::vector<Vec3> flat_lattice(int half, double step, double z) {
  return lattice_points({-half * step, -half * step, z}, {step, 0, 0}, {0, step, 0}, 2 * half + 1,
                        2 * half + 1);
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

geometry::TriangleMesh turned_mesh(const std::vector<OnProfile>& corners, double step_mm, int count) {
  const std::vector<OnProfile> profile = filled_profile(corners, step_mm);
  geometry::TriangleMesh mesh;
  std::vector<std::uint32_t> first;
  for (const OnProfile& p : profile) {
    first.push_back(static_cast<std::uint32_t>(mesh.vertices_mm.size()));
    for (int k = 0; k < (p.radius_mm > 0.0 ? count : 1); ++k) {
      const double angle = 2.0 * std::numbers::pi * k / count;
      mesh.vertices_mm.emplace_back(p.radius_mm * std::cos(angle), p.radius_mm * std::sin(angle), p.z_mm);
    }
  }
  for (std::size_t i = 0; i + 1 < profile.size(); ++i)
    for (int k = 0; k < count; ++k) {
      const auto on = [&](std::size_t ring, int step) {
        return first[ring] + (profile[ring].radius_mm > 0.0 ? static_cast<std::uint32_t>(step % count) : 0u);
      };
      if (profile[i].radius_mm > 0.0) mesh.triangles.push_back({on(i, k), on(i, k + 1), on(i + 1, k)});
      if (profile[i + 1].radius_mm > 0.0)
        mesh.triangles.push_back({on(i, k + 1), on(i + 1, k + 1), on(i + 1, k)});
    }
  return mesh;
}

}  // namespace palpate::experiments
