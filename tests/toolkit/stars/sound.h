// What every star mesh has to be.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <map>
#include <set>

#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {

/// What no cloud may break: every triangle stands in the rings of its three corners, the same way around, and
/// an edge has two at most, which run along it in opposite ways. Returns how many triangles there are.
inline std::uint64_t expect_sound(const StarMesh& mesh) {
  using Corners = std::array<std::uint32_t, 3>;
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
      for (const auto& [at, from, to] : {Corners{b, c, i}, Corners{c, i, b}}) {
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

}  // namespace palpate::stars
