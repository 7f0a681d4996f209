#include "toolkit/smooth/shared_tiles.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <iterator>
#include <numeric>
#include <span>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/smooth/fit_sums.h"
#include "toolkit/smooth/surround.h"

namespace palpate::render {
namespace {

Vec3 tile_vector(Random& random, double most) {
  const auto one = [&] { return random.uniform(-most, most); };
  return Vec3{one(), one(), one()};
}

/// Around tile (4, 4, 4), which has its middle at 16.5 voxels, each as large as its bend lets it be.
std::vector<Patch> tile_patches(Random& random, std::size_t count) {
  std::vector<Patch> patches(count);
  for (Patch& p : patches) {
    p.quadric.at = Vec3::Constant(16.5) + tile_vector(random, 4.0);
    turn_to(p.quadric, tile_vector(random, 1.0).normalized());
    p.support = random.uniform(0.7, 3.0);
    const auto bend = [&] { return random.uniform(-0.12, 0.12) / p.support; };
    p.quadric.uu = bend();
    p.quadric.uv = bend();
    p.quadric.vv = bend();
  }
  return patches;
}

/// The node is above the patch: by the same step to the foot as a tile takes, of all nodes.
double plain_rest(const Patch& p, const Vec3& node) {
  const Quadric& q = p.quadric;
  const Vec3 d = node - q.at;
  const double a = d.dot(q.u), b = d.dot(q.v), w = d.dot(q.n);
  const double s = 2.0 * q.uu * a + q.uv * b, t = 2.0 * q.vv * b + q.uv * a;
  const double back = (w - 0.5 * (s * a + t * b)) / (1.0 + s * s + t * t);
  const double a1 = a + s * back, b1 = b + t * back;
  return 1.0 - (a1 * a1 + b1 * b1) / (p.support * p.support);
}

TEST(SharedTiles, EveryNodeAboveAPatchIsKnownAndNoOther) {
  Random random(11);
  const std::vector<Patch> patches = tile_patches(random, 400);
  const BrickGrid grid;
  SharedTiles tiles(patches, grid, {});
  int known = 0, unknown = 0;
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    tiles.take_face(std::span<const std::uint32_t>(&i, 1));
    const Tile& tile = tiles.at({4, 4, 4});
    for (int node = 0; node < static_cast<int>(kTileCount); ++node) {
      const Vec3 at = Vec3(node / 16, node / 4 % 4, node % 4) + Vec3::Constant(15.0);
      const double rest = plain_rest(patches[i], at);
      const auto k = static_cast<std::size_t>(node);
      // Far off its weight is too small to count; a foot is not moved by more than a voxel.
      const Vec3 d = at - patches[i].quadric.at;
      const double w = d.dot(patches[i].quadric.n), lateral = std::sqrt(d.squaredNorm() - w * w);
      if (rest > 0.2 && std::abs(w) < 2.0 && lateral < patches[i].support + 1.0) {
        EXPECT_EQ(tile.known[k], 1) << "patch " << i << ", node " << node;
        ++known;
      } else if (rest < 0.0) {
        EXPECT_EQ(tile.known[k], 0) << "patch " << i << ", node " << node;
        ++unknown;
      }
    }
  }
  EXPECT_GT(known, 500);
  EXPECT_GT(unknown, 5000);
}

TEST(SharedTiles, APlanesDistanceIsItsOwn) {
  std::vector<Patch> patches(1);
  patches[0].quadric.at = Vec3(16.2, 16.9, 16.4);
  turn_to(patches[0].quadric, Vec3(1.0, 2.0, 3.0).normalized());
  patches[0].support = 20.0;
  const BrickGrid grid;
  SharedTiles tiles(patches, grid, {});
  const std::uint32_t only = 0;
  tiles.take_face(std::span<const std::uint32_t>(&only, 1));
  const Tile& tile = tiles.at({4, 4, 4});
  for (int node = 0; node < static_cast<int>(kTileCount); ++node) {
    const Vec3 at = Vec3(node / 16, node / 4 % 4, node % 4) + Vec3::Constant(15.0);
    const auto k = static_cast<std::size_t>(node);
    EXPECT_EQ(tile.known[k], 1);
    EXPECT_NEAR(tile.distance[k], patches[0].quadric.residual(at), 1e-5);
    EXPECT_NEAR(tile.y[k], patches[0].quadric.n.y(), 1e-5);
  }
}

TEST(SharedTiles, WhatWasAskedBeforeDoesNotMatter) {
  Random random(12);
  const std::vector<Patch> patches = tile_patches(random, 40);
  std::vector<std::uint32_t> all(patches.size()), some;
  std::iota(all.begin(), all.end(), 0u);
  std::copy_if(all.begin(), all.end(), std::back_inserter(some), [](std::uint32_t i) { return i % 3 != 1; });
  const BrickGrid grid;
  SharedTiles used(patches, grid, {});
  // More tiles than are kept, some with the same place and other patches.
  for (int round = 0; round < 3; ++round)
    for (int x = 0; x < 16; ++x)
      for (int y = 0; y < 16; ++y)
        for (int z = 0; z < 8; ++z) {
          used.take_face(round % 2 == 0 ? all : some);
          static_cast<void>(used.at({x, y, z}));
        }
  for (const std::vector<std::uint32_t>& face : {all, some})
    for (const BrickGrid::Coordinate& place : {BrickGrid::Coordinate{4, 4, 4}, {3, 4, 4}, {4, 3, 5}}) {
      SharedTiles fresh(patches, grid, {});
      fresh.take_face(face);
      used.take_face(face);
      const Tile a = fresh.at(place), b = used.at(place);
      EXPECT_EQ(std::memcmp(a.distance.data(), b.distance.data(), sizeof a.distance), 0);
      EXPECT_EQ(std::memcmp(a.x.data(), b.x.data(), sizeof a.x), 0);
      EXPECT_EQ(a.known, b.known);
    }
}

TEST(FitSums, MomentsAndMediansAreThoseOfPlainLoops) {
  Random random(13);
  for (std::size_t count = 1; count < 90; ++count) {
    std::vector<Vec3> away;
    for (std::size_t i = 0; i < count; ++i) away.push_back(tile_vector(random, 0.8));
    const FitFrame frame{tile_vector(random, 0.1), Vec3::UnitX(), Vec3::UnitY(), Vec3::UnitZ()};
    const FitHeight height{0.01, 0.1, -0.2, 0.3, 0.1, -0.1};
    FitPoints points;
    points.take(away);
    FitMoments sums;
    points.moments(frame, height, 2.0, sums);
    double m0 = 0.0, m13 = 0.0, r4 = 0.0, weights = 0.0;
    std::vector<double> off;
    for (const Vec3& p : away) {
      const Vec3 d = p - frame.shift;
      const double a = d.x(), b = d.y();
      const double residual = d.z() - (height[0] + a * (height[1] + height[3] * a + height[4] * b) +
                                       b * (height[2] + height[5] * b));
      off.push_back(std::abs(residual));
      const double robust = 1.0 / std::pow(1.0 + 4.0 * residual * residual, 2);
      const double k = std::max(1.0 - a * a - b * b, 0.0) * robust;
      m0 += k;
      m13 += k * a * b * b * b;
      r4 += k * d.z() * a * b;
      weights += robust;
    }
    const auto middle = off.begin() + static_cast<std::ptrdiff_t>(count / 2);
    std::nth_element(off.begin(), middle, off.end());
    EXPECT_NEAR(sums.m[0], m0, 1e-12) << count;
    EXPECT_NEAR(sums.m[13], m13, 1e-12) << count;
    EXPECT_NEAR(sums.r[4], r4, 1e-12) << count;
    EXPECT_NEAR(points.weights(frame, height, 2.0), weights, 1e-12) << count;
    EXPECT_NEAR(points.median_residual(height), *middle, 1e-15) << count;
  }
}

TEST(Surround, OpenIsWhereAWideAngleIsEmpty) {
  constexpr int kSectors = 48, kOpenFrom = 22;
  Random random(14);
  int open = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    Surround seen;
    std::array<bool, kSectors> filled{};
    const auto points = random.below(9);
    for (std::uint64_t i = 0; i < points; ++i) {
      const double a = random.uniform(-1.0, 1.0), b = random.uniform(-1.0, 1.0);
      seen.add(a, b);
      filled[std::min(static_cast<std::size_t>(turn_of(a, b) * kSectors), std::size_t{kSectors - 1})] = true;
    }
    int run = 0, most = 0;
    for (std::size_t i = 0; i < 2 * std::size_t{kSectors}; ++i) {
      run = filled[i % kSectors] ? 0 : run + 1;
      most = std::max(most, run);
    }
    EXPECT_EQ(seen.open(), most >= kOpenFrom) << trial;
    open += seen.open() ? 1 : 0;
  }
  EXPECT_GT(open, 200);
  EXPECT_LT(open, 1800);
}

}  // namespace
}  // namespace palpate::render
