// Points that no lattice orders, as scanners make them, clouds of every kind, and what none may break.
#pragma once

#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include <palpate/cloud.h>
#include "toolkit/core/random.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"

namespace palpate::local_delaunay {

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

/// On a torus of radius 30 mm around z, `r` from the middle of its tube.
inline Vec3 on_torus(double u, double v, double r) {
  return {(30 + r * std::cos(v)) * std::cos(u), (30 + r * std::cos(v)) * std::sin(u), r * std::sin(v)};
}

/// Numbers below `count` in no order.
inline std::vector<std::uint32_t> shuffled_order(std::size_t count, Random& random) {
  std::vector<std::uint32_t> order(count);
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random.below(i)]);
  return order;
}

template <class Visit>
void each_triangle(const LocalDelaunayMesh& mesh, Visit&& visit) {
  for (std::uint32_t i = 0; i < mesh.size(); ++i) mesh.for_triangles_of(i, visit);
}

/// Of a body around the origin of its points.
inline void expect_outward(const LocalDelaunayMesh& mesh) {
  each_triangle(mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const Vec3 n = (mesh.at(b) - mesh.at(a)).cross(mesh.at(c) - mesh.at(a));
    EXPECT_GT(n.dot(mesh.at(a) + mesh.origin_mm()), 0.0);
  });
}

using Triple = std::array<std::uint32_t, 3>;
/// The lowest first, the way around kept.
inline std::vector<Triple> in_order(std::vector<Triple> all) {
  for (Triple& t : all) std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  std::sort(all.begin(), all.end());
  return all;
}
/// By the cloud's indices.
inline std::vector<Triple> triangles_of(const LocalDelaunayMesh& mesh) {
  return in_order(mesh.as_mesh().triangles);
}

struct Named {
  std::string name;
  std::vector<Vec3> points;
};
inline std::vector<Named> all_clouds() {
  std::vector<Vec3> doubled = random_spheres({5.0}, 0.3, 4);
  for (std::size_t i = 0, n = doubled.size(); i < n; i += 3) doubled.push_back(doubled[i]);
  std::vector<Vec3> line, pile(50, Vec3(1, 2, 3));
  for (int i = 0; i < 60; ++i) line.emplace_back(0.1 * i, 0.2 * i, -0.3 * i);
  std::vector<Vec3> chaos;
  Random random(8);
  for (int i = 0; i < 3000; ++i) chaos.push_back(Vec3{random.uniform(), random.uniform(), random.uniform()});
  return {{"torus", random_torus(20000, 0.0, 1)},
          {"noisy torus", random_torus(20000, 0.22, 2)},
          {"shells", random_spheres({10.0, 9.6}, 0.2, 3)},
          {"roof", random_roof(8000, 5)},
          {"lines", scan_lines(6)},
          {"step", density_step(20000, 7)},
          {"doubled", doubled},
          {"line", line},
          {"pile", pile},
          {"chaos", chaos},
          {"one", {Vec3(1, 1, 1)}},
          {"two", {Vec3(1, 1, 1), Vec3(2, 1, 1)}},
          {"three", {Vec3(1, 1, 1), Vec3(2, 1, 1), Vec3(1, 2, 1)}}};
}

/// What no cloud may break: every triangle stands in the rings of its three corners, the same way around, and
/// an edge has two at most, which run along it in opposite ways. Returns how many triangles there are.
inline std::uint64_t expect_rings_sound(const LocalDelaunayMesh& mesh) {
  std::map<std::array<std::uint32_t, 2>, int> edges;
  std::uint64_t triangles = 0;
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    const Ring ring = mesh.ring(i);
    std::set<std::uint32_t> seen;
    for (std::uint32_t k = 0; k < ring.size; ++k) {
      EXPECT_TRUE(seen.insert(ring.of[k]).second) << i << " has " << ring.of[k] << " twice";
      EXPECT_NE(ring.of[k], i);
      if (!ring.has_sector(k)) continue;
      ++triangles;
      const std::uint32_t b = ring.of[k], c = ring.of[ring.next(k)];
      ++edges[{b, c}];
      for (const auto& [at, from, to] : {std::array{b, c, i}, std::array{c, i, b}}) {
        const Ring other = mesh.ring(at);
        const std::uint32_t k2 = other.find(from);
        EXPECT_LT(k2, other.size) << at;
        if (k2 == other.size) continue;
        EXPECT_TRUE(other.has_sector(k2));
        EXPECT_EQ(other.of[other.next(k2)], to);
      }
    }
  }
  for (const auto& [edge, count] : edges) EXPECT_EQ(count, 1) << edge[0] << ' ' << edge[1];
  EXPECT_EQ(triangles % 3, 0u);
  return triangles / 3;
}
inline void expect_sound(const LocalDelaunayMesh& mesh) {
  EXPECT_EQ(expect_rings_sound(mesh), mesh.counts().triangles);
}

}  // namespace palpate::local_delaunay
