// Points that no lattice orders: what scanners make.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/random.h"

namespace palpate::stars {

inline cloud::Cloud cloud_of(const std::vector<Vec3>& points) {
  return cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
}

/// Uniform over a torus of radii 30 and 10 mm, moved off it by `noise` spacings.
inline std::vector<Vec3> random_torus(std::size_t count, double noise, std::uint64_t seed) {
  constexpr double kMajor = 30.0, kMinor = 10.0;
  const double spacing =
      std::sqrt(4.0 * std::numbers::pi * std::numbers::pi * kMajor * kMinor / static_cast<double>(count));
  Random random(seed);
  std::vector<Vec3> points;
  while (points.size() < count) {
    const double u = random.uniform(0.0, 2.0 * std::numbers::pi),
                 v = random.uniform(0.0, 2.0 * std::numbers::pi);
    if (random.uniform() > (kMajor + kMinor * std::cos(v)) / (kMajor + kMinor)) continue;
    const double r = kMinor + noise * spacing * random.normal();
    points.emplace_back((kMajor + r * std::cos(v)) * std::cos(u), (kMajor + r * std::cos(v)) * std::sin(u),
                        r * std::sin(v));
  }
  return points;
}

/// Uniform over spheres around the origin.
inline std::vector<Vec3> random_spheres(const std::vector<double>& radii, double spacing,
                                        std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points;
  for (const double radius : radii) {
    const auto count =
        static_cast<std::size_t>(4.0 * std::numbers::pi * radius * radius / (spacing * spacing));
    for (std::size_t i = 0; i < count; ++i) {
      const Vec3 d{random.normal(), random.normal(), random.normal()};
      points.push_back(radius * d.normalized());
    }
  }
  return points;
}

/// Uniform in plan view over a square of 40 mm: two planes that meet at 90 degrees.
inline std::vector<Vec3> random_roof(std::size_t count, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < count; ++i) {
    const double x = random.uniform(-20.0, 20.0);
    points.emplace_back(x, random.uniform(-20.0, 20.0), -std::abs(x));
  }
  return points;
}

/// Lines eight times as far apart as the points on them.
inline std::vector<Vec3> scan_lines(std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points;
  for (double y = -20.0; y < 20.0; y += 0.8)
    for (double x = -20.0; x < 20.0; x += 0.1) {
      const double at = x + random.uniform(-0.03, 0.03);
      points.emplace_back(at, y + random.uniform(-0.005, 0.005),
                          3.0 * std::cos(at / 6.0) * std::cos(y / 6.0));
    }
  return points;
}

/// Sixteen times as many on one half as on the other.
inline std::vector<Vec3> density_step(std::size_t count, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points;
  while (points.size() < count) {
    const double x = random.uniform(-20.0, 20.0), y = random.uniform(-20.0, 20.0);
    if (x > 0.0 && random.uniform() > 1.0 / 16.0) continue;
    points.emplace_back(x, y, 3.0 * std::cos(x / 6.0) * std::cos(y / 6.0));
  }
  return points;
}

}  // namespace palpate::stars
