// Clouds of every kind, and what none of them may break.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "tests/toolkit/stars/clouds.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {

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
inline std::uint64_t expect_rings_sound(const StarMesh& mesh) {
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
inline void expect_sound(const StarMesh& mesh) {
  EXPECT_EQ(expect_rings_sound(mesh), mesh.counts().triangles);
}

}  // namespace palpate::stars
