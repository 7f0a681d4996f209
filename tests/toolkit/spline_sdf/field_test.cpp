// From points to the field of `cloud-smooth`: sides, what a place is made of, bricks.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>
#include <vector>

#include <palpate/cloud.h>
#include "tests/toolkit/spline_sdf/spline_sdf_scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/spline_sdf/build_bricks.h"
#include "toolkit/spline_sdf/fit_patches.h"
#include "toolkit/spline_sdf/orient_patches.h"
#include "toolkit/spline_sdf/patch_field.h"
#include "toolkit/spline_sdf/patch_lanes.h"
#include "toolkit/spline_sdf/point_noise.h"
#include "toolkit/spline_sdf/spline.h"
#include "toolkit/spline_sdf/spline_sdf_model.h"

namespace palpate::spline_sdf {

using namespace render;

namespace {

/// Points, and what preparation makes of them before the field.
struct Prepared {
  explicit Prepared(const std::vector<Vec3>& at, int threads = 2)
      : cloud(cloud_of(at).models[0].cloud), points(*cloud, threads) {
    const NoiseField noise(points, threads);
    patches = fit_patches(points, {2.0, noise}, threads).patches;
    piece = orient_outwards(points, patches, threads).piece;
    of_points = assign_patches(points, patches, threads);
  }
  [[nodiscard]] Vec3 place(std::size_t patch) const { return cloud->origin_mm + patches[patch].quadric.at; }
  [[nodiscard]] BrickGrid bricks(int threads,
                                 std::size_t at_once = BrickBuildOptions{}.bricks_at_once) const {
    BrickBuildOptions build;
    build.bricks_at_once = at_once;
    build.voxel_mm = SplineSdfOptions{}.voxel_spacings * points.spacing_mm();
    build.tolerance_mm = 0.05 * points.spacing_mm();
    return build_bricks(points, patches, piece, of_points, build, threads);
  }
  struct FieldValue {
    double distance_mm;
    Vec3 normal;
  };
  [[nodiscard]] FieldValue field_at(const Vec3& at) const {
    PatchDistanceField field(points, patches, of_points);
    EXPECT_TRUE(field.begin(at - cloud->origin_mm, 0.01 * points.spacing_mm(), 1e3));
    FieldLanes values;
    field.evaluate({}, values);
    return {values.distance_at(0), values.normal_at(0)};
  }

  std::shared_ptr<const cloud::Cloud> cloud;
  MortonPoints points;
  std::vector<QuadricPatch> patches;
  std::vector<std::uint32_t> piece;
  std::vector<PointPatches> of_points;
};

/// Points at random on a box's faces.
std::vector<Vec3> box_points(const Vec3& half, std::size_t count, double noise = 0.0) {
  Random random(31);
  std::vector<Vec3> points;
  const Vec3 areas(half.y() * half.z(), half.x() * half.z(), half.x() * half.y());
  while (points.size() < count) {
    double pick = random.uniform() * areas.sum();
    Eigen::Index axis = 0;
    while (axis < 2 && pick > areas[axis]) pick -= areas[axis++];
    Vec3 p;
    for (Eigen::Index a = 0; a < 3; ++a) p[a] = half[a] * random.uniform(-1.0, 1.0);
    p[axis] = (random.uniform() < 0.5 ? -half[axis] : half[axis]) + noise * random.normal();
    points.push_back(p);
  }
  return points;
}

std::vector<Vec3> sphere_points(double radius, std::size_t count, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points(count);
  for (Vec3& p : points) p = Vec3(random.normal(), random.normal(), random.normal()).normalized() * radius;
  return points;
}

// A plate of two spacings: neither its faces nor their points' neighbours tell the sides apart.
TEST(PatchSides, AThinPlateLooksOutwardsOnBothFaces) {
  const double half_mm = 0.2;
  const Prepared made(box_points(Vec3(10.0, 10.0, half_mm), 21000));
  ASSERT_NEAR(made.points.spacing_mm(), 0.2, 0.02);
  std::size_t right = 0, asked = 0;
  for (std::size_t i = 0; i < made.patches.size(); ++i) {
    const Vec3 at = made.place(i);
    if (std::max(std::abs(at.x()), std::abs(at.y())) > 9.0) continue;
    ++asked;
    if (made.patches[i].quadric.n.z() * at.z() > 0.0) ++right;
  }
  ASSERT_GT(asked, 500u);
  EXPECT_EQ(right, asked);
}

/// Points of a cup, at random, one a square: the wall is as thick as 2.5 spacings, with noise of .35.
std::vector<Vec3> cup_points(std::uint64_t seed) {
  constexpr double kOuter = 16.0, kWall = 2.5, kHigh = 24.0, kInner = kOuter - kWall, kNoise = 0.35;
  Random random(seed);
  std::vector<Vec3> points;
  const auto add = [&](double area, const auto& place_and_normal) {
    for (double left = area; left > random.uniform(); left -= 1.0) {
      const auto [place, normal] = place_and_normal();
      points.push_back(place + kNoise * random.normal() * normal);
    }
  };
  const auto wall = [&](double radius, double from, double facing) {
    add(2.0 * std::numbers::pi * radius * (kHigh - from), [&, radius, from, facing] {
      const double a = random.uniform(0.0, 2.0 * std::numbers::pi);
      const Vec3 n(std::cos(a), std::sin(a), 0.0);
      return std::pair<Vec3, Vec3>(radius * n + Vec3(0, 0, random.uniform(from, kHigh)), facing * n);
    });
  };
  const auto ring = [&](double from, double to, double height, double facing) {
    add(std::numbers::pi * (to * to - from * from), [&, from, to, height, facing] {
      const double a = random.uniform(0.0, 2.0 * std::numbers::pi),
                   r = std::sqrt(random.uniform(from * from, to * to));
      return std::pair<Vec3, Vec3>(Vec3(r * std::cos(a), r * std::sin(a), height), Vec3(0, 0, facing));
    });
  };
  wall(kOuter, 0.0, 1.0);
  wall(kInner, kWall, -1.0);
  ring(0.0, kOuter, 0.0, -1.0);
  ring(0.0, kInner, kWall, 1.0);
  ring(kInner, kOuter, kHigh, 1.0);
  return points;
}

// One link between a leaning patch and the wall's other side turned the whole inner side: of five cups,
// three.
TEST(PatchSides, ACupsInnerSideLooksInwards) {
  for (const std::uint64_t seed : {1u, 2u, 3u, 4u, 5u}) {
    const Prepared made(cup_points(seed));
    std::size_t asked = 0, right = 0;
    for (std::size_t i = 0; i < made.patches.size(); ++i) {
      const Vec3 at = made.place(i), across(at.x(), at.y(), 0.0);
      if (at.z() < 5.0 || at.z() > 22.0 || across.norm() > 14.5) continue;
      ++asked;
      if (made.patches[i].quadric.n.dot(across) < 0.0) ++right;
    }
    ASSERT_GT(asked, 20u);
    EXPECT_GT(static_cast<double>(right), 0.9 * static_cast<double>(asked)) << "seed " << seed;
  }
}

// What lies between two sheets is on one side of both.
TEST(PatchSides, TheWallBetweenTwoSpheresIsInside) {
  std::vector<Vec3> points = sphere_points(10.0, 30000, 5);
  const std::vector<Vec3> inner = sphere_points(9.3, 26000, 6);
  points.insert(points.end(), inner.begin(), inner.end());
  const Prepared made(points);
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < made.patches.size(); ++i) {
    const Vec3 at = made.place(i);
    const bool outwards = made.patches[i].quadric.n.dot(at) > 0.0;
    if (outwards != (at.norm() > 9.65)) ++wrong;
  }
  EXPECT_EQ(wrong, 0u) << "of " << made.patches.size();
}

// Outside and inside an edge and a corner, and in the plane of a face beyond the edge: the nearest face's
// plane tells, to a tenth of a spacing.
TEST(PatchDistanceField, KeepsAFaceUpToItsEdge) {
  const double half = 6.0;
  const Prepared made(box_points(Vec3::Constant(half), 20000));
  const double spacing = made.points.spacing_mm();
  for (const double along : {-0.7, 0.1, 0.6})
    for (const double in : {0.5, 1.0, 3.0}) {
      // Below the one face, and as far or farther from the other.
      const Vec3 at(half - in * spacing, 5.0 * along, half - 0.4 * spacing);
      EXPECT_NEAR(made.field_at(at).distance_mm, -std::min(in, 0.4) * spacing, 0.1 * spacing) << in;
      // On the face itself.
      EXPECT_NEAR(made.field_at(Vec3(half - in * spacing, 5.0 * along, half)).distance_mm, 0.0,
                  0.1 * spacing);
      // Off the other face, in the plane of the first: no lip.
      EXPECT_GT(made.field_at(Vec3(half + 0.5 * spacing, 5.0 * along, half)).distance_mm, 0.2 * spacing);
    }
}

// Two walls that meet in a corner: the lesser distance counts.
TEST(PatchDistanceField, KeepsACornerSharp) {
  Random random(8);
  std::vector<Vec3> points;
  for (int i = 0; i < 20000; ++i) {
    const double a = 8.0 * random.uniform(), b = random.uniform(-4.0, 4.0);
    points.push_back(i % 2 == 0 ? Vec3(a, b, 0.0) : Vec3(0.0, b, a));
  }
  const Prepared made(points);
  const double spacing = made.points.spacing_mm();
  const double side = made.field_at(Vec3(3.0, 0.0, 0.3)).distance_mm > 0.0 ? 1.0 : -1.0;
  for (const double off : {0.4, 0.8, 2.0}) {
    EXPECT_NEAR(side * made.field_at(Vec3(off * spacing, 0.0, 0.3 * spacing)).distance_mm, 0.3 * spacing,
                0.1 * spacing);
    EXPECT_NEAR(made.field_at(Vec3(off * spacing, 0.0, 0.0)).distance_mm, 0.0, 0.1 * spacing);
  }
}

TEST(PatchDistanceField, HasAValueAtACentreOfCurvatureAndFarOff) {
  const Prepared made(sphere_points(3.0, 6000, 9));
  for (const Vec3& at : {Vec3(0.0, 0.0, 0.0), Vec3(0.01, 0.0, 0.0), Vec3(0.0, 60.0, 0.0)}) {
    const auto value = made.field_at(at);
    EXPECT_TRUE(std::isfinite(value.distance_mm)) << at.transpose();
    EXPECT_NEAR(value.normal.norm(), 1.0, 1e-6);  // single precision
    EXPECT_EQ(value.distance_mm > 0.0, at.norm() > 3.0) << at.transpose();
  }
}

// Where patches agree their mean is what the points around a node tell of it, too.
TEST(TileBlend, IsTheFieldWherePatchesAgree) {
  const Prepared made(sphere_points(12.0, 40000, 10));
  const double voxel = SplineSdfOptions{}.voxel_spacings * made.points.spacing_mm();
  std::vector<std::uint32_t> all;
  const Vec3 middle(12.0, 0.0, 0.0);
  for (std::uint32_t i = 0; i < made.patches.size(); ++i)
    if ((made.place(i) - middle).norm() < made.patches[i].support + kTileReach * voxel) all.push_back(i);
  Tile tile;
  ASSERT_TRUE(blend_tile(made.patches, all, middle - made.cloud->origin_mm, voxel,
                         0.02 * made.points.spacing_mm(), tile));
  for (std::size_t i = 0; i < kTileCount; ++i) {
    const Vec3 node = middle + voxel * (Vec3(static_cast<double>(i / 16), static_cast<double>(i / 4 % 4),
                                             static_cast<double>(i % 4)) -
                                        Vec3::Constant(1.5));
    EXPECT_NEAR(static_cast<double>(tile[i]) * voxel, node.norm() - 12.0, 2e-3 * voxel);
    EXPECT_NEAR(static_cast<double>(tile[i]) * voxel, made.field_at(node).distance_mm, 5e-3 * voxel);
  }
}

TEST(TileBlend, DoesNotBlendTwoFaces) {
  const Prepared made(box_points(Vec3::Constant(6.0), 20000));
  std::vector<std::uint32_t> all(made.patches.size());
  for (std::uint32_t i = 0; i < all.size(); ++i) all[i] = i;
  Tile tile;
  EXPECT_FALSE(blend_tile(made.patches, all, Vec3(6.0, 0.0, 6.0) - made.cloud->origin_mm,
                          SplineSdfOptions{}.voxel_spacings * made.points.spacing_mm(), 0.02, tile));
  EXPECT_FALSE(blend_tile(made.patches, {}, Vec3::Zero(), 1.0, 0.02, tile));
}

// A crowd of points on a coarse plane: bricks as large as the plane's own spacing asks for, few of them, and
// smaller ones where the crowd has a step.
TEST(FieldBricks, FollowTheSpacingWhereItIsUneven) {
  std::vector<Vec3> points;
  for (int i = 0; i <= 60; ++i)
    for (int k = 0; k <= 60; ++k) points.emplace_back(0.5 * i - 15.0, 0.5 * k - 15.0, 0.0);
  for (int i = 0; i < 120; ++i)
    for (int k = 0; k < 120; ++k) {
      const double x = 0.01 * i - 0.6;
      points.emplace_back(x + 0.1, 0.01 * k - 0.5, x > 0.0 ? 0.2 : 0.0);
    }
  const Prepared made(points);
  ASSERT_NEAR(made.points.spacing_mm(), 0.01, 1e-3);
  const BrickGrid grid = made.bricks(2);
  EXPECT_GE(grid.coarser, 4);
  EXPECT_LT(grid.bricks.size(), 6000u) << "at the crowd's spacing the plane alone has 180,000";
  const auto place_at = [&](const Vec3& at) { return grid.find(grid.in_voxels(at - made.cloud->origin_mm)); };
  EXPECT_LT(place_at(Vec3(-7.0, 6.0, 0.0)).level, grid.coarser - 2);
  EXPECT_GE(place_at(Vec3(0.3, 0.0, 0.2)).level, grid.coarser - 1);
}

// The bricks of a level are made in parts, whose borders leave no trace.
TEST(FieldBricks, AreTheSameInParts) {
  const Prepared made(box_points(Vec3(6.0, 5.0, 4.0), 20000, 0.01));
  const BrickGrid whole = made.bricks(2), parts = made.bricks(2, 40);
  ASSERT_GT(whole.bricks.size(), 400u);
  ASSERT_GT(whole.levels, 1);
  ASSERT_EQ(whole.bricks.size(), parts.bricks.size());
  ASSERT_EQ(whole.levels, parts.levels);
  for (std::size_t l = 0; l < whole.level.size(); ++l) EXPECT_EQ(whole.level[l].brick, parts.level[l].brick);
  for (std::size_t i = 0; i < whole.bricks.size(); ++i) {
    ASSERT_EQ(whole.bricks[i].distance, parts.bricks[i].distance) << i;
    ASSERT_EQ(whole.bricks[i].piece, parts.bricks[i].piece) << i;
    ASSERT_EQ(whole.bricks[i].mask, parts.bricks[i].mask) << i;
  }
}

// Faces need one brick in seven spacings, edges smaller ones; every brick is found where it stands.
TEST(FieldBricks, AreSmallWhereTheSurfaceIsSharp) {
  const Prepared made(box_points(Vec3::Constant(6.0), 30000));
  const BrickGrid grid = made.bricks(2);
  EXPECT_EQ(grid.levels, BrickGrid::kFineLevels);
  ASSERT_EQ(grid.closed_components.size(), 1u);
  EXPECT_TRUE(grid.closed_components[0].tight);
  EXPECT_EQ(grid.closed_components[0].normal_orientation, 1.0f);
  const auto level_at = [&](const Vec3& at) {
    return grid.find(grid.in_voxels(at - made.cloud->origin_mm)).level;
  };
  EXPECT_EQ(level_at(Vec3(6.0, 0.3, -0.4)), 0);
  EXPECT_EQ(level_at(Vec3(6.0, 0.3, 6.0)), BrickGrid::kFineLevels - 1);
  for (const BrickGrid::BrickRef& place : grid.places()) {
    const double size = kBrickCells / grid.per_voxel_of(place.level);
    const Vec3 middle = (Vec3(place.cube[0], place.cube[1], place.cube[2]) + Vec3::Constant(0.5)) * size;
    const BrickGrid::BrickRef found = grid.find(middle + Vec3::Constant(1e-3 * size));
    EXPECT_EQ(found.brick == place.brick, found.level == place.level);
    EXPECT_TRUE(!place.whole || found.brick == place.brick);
    EXPECT_GE(found.level, place.level);
  }
}

Brick any_brick(Random& random) {
  Brick brick;
  for (std::int16_t& one : brick.distance) one = static_cast<std::int16_t>(random.below(65536));
  return brick;
}

BrickPosition any_place(Random& random) {
  BrickPosition at;
  for (std::size_t a = 0; a < 3; ++a) {
    at.cell[a] = static_cast<int>(random.below(kBrickCells));
    // Walls too, and a little beyond them.
    at.t[a] = random.below(4) == 0 ? static_cast<float>(random.below(2))
                                   : static_cast<float>(random.uniform(-0.3, 1.3));
  }
  return at;
}

/// Weight k of the cubic B-spline at t, and of its derivatives.
double weight(int k, double t, int derivative) {
  const double s = 1.0 - t;
  const double of[3][4] = {
      {s * s * s / 6, 2.0 / 3 - t * t * (1 - t / 2), 2.0 / 3 - s * s * (1 - s / 2), t * t * t / 6},
      {-s * s / 2, t * (1.5 * t - 2), s * (2 - 1.5 * s), t * t / 2},
      {s, 3 * t - 2, 1 - 3 * t, t}};
  return of[derivative][k];
}
double plain(const Brick& brick, const BrickPosition& at, int x, int y, int z) {
  double sum = 0.0;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      for (int k = 0; k < 4; ++k) {
        const int node = ((at.cell[0] + i) * kBrickNodes + at.cell[1] + j) * kBrickNodes + at.cell[2] + k;
        sum += weight(i, static_cast<double>(at.t[0]), x) * weight(j, static_cast<double>(at.t[1]), y) *
               weight(k, static_cast<double>(at.t[2]), z) *
               static_cast<double>(brick.distance[static_cast<std::size_t>(node)]);
      }
  return sum * static_cast<double>(kDistanceUnit);
}

TEST(Spline, IsItsFormula) {
  Random random(61);
  // 64 products of single precision, of numbers up to the reach: weights sum to one, and to four for the
  // second derivatives.
  constexpr double kRounding = 64 * 6e-8 * kMaxBrickDistance * 4;
  for (int round = 0; round < 300; ++round) {
    const Brick brick = any_brick(random);
    const BrickPosition at = any_place(random);
    const Jet jet = spline_jet(brick, at);
    const auto near = [&](float is, int x, int y, int z) {
      EXPECT_NEAR(static_cast<double>(is), plain(brick, at, x, y, z), kRounding) << x << y << z;
    };
    near(jet.value, 0, 0, 0);
    // In the brick itself it is as near as renderers say.
    if (std::all_of(at.t.begin(), at.t.end(), [](float t) { return t >= 0.0f && t <= 1.0f; })) {
      EXPECT_NEAR(static_cast<double>(jet.value), plain(brick, at, 0, 0, 0), kReadRounding);
    }
    near(jet.gradient.x(), 1, 0, 0);
    near(jet.gradient.y(), 0, 1, 0);
    near(jet.gradient.z(), 0, 0, 1);
    near(jet.second[0], 2, 0, 0);
    near(jet.second[1], 0, 2, 0);
    near(jet.second[2], 0, 0, 2);
    near(jet.second[3], 1, 1, 0);
    near(jet.second[4], 1, 0, 1);
    near(jet.second[5], 0, 1, 1);
  }
}

TEST(Spline, HasTheSameBitsByFourAndByEight) {
  Random random(62);
  const auto bits = [](float x) { return std::bit_cast<std::uint32_t>(x); };
  for (int round = 0; round < 20'000; ++round) {
    const Brick brick = any_brick(random);
    const BrickPosition at = any_place(random);
    const Jet a = spline_jet(brick, at), b = narrow_spline_jet(brick, at);
    ASSERT_EQ(bits(a.value), bits(b.value));
    for (int i = 0; i < 3; ++i) ASSERT_EQ(bits(a.gradient[i]), bits(b.gradient[i]));
    for (std::size_t i = 0; i < 6; ++i) ASSERT_EQ(bits(a.second[i]), bits(b.second[i]));
    // The value alone is the jet's.
    ASSERT_EQ(bits(spline_value(brick, at)), bits(a.value));
    ASSERT_EQ(bits(narrow_spline_value(brick, at)), bits(a.value));
  }
}

// The noise of points place by place.

constexpr double kFine = 0.1, kRough = 0.3;
constexpr double kEndMm = 140.0, kWideMm = 60.0, kRoughFromMm = 100.0;

/// A point a square millimetre at random, rough beyond a line; `bend`: the slope on the far side of a ridge.
std::vector<Vec3> strip(double rough, double bend) {
  Random random(7);
  std::vector<Vec3> points;
  while (points.size() < static_cast<std::size_t>(kEndMm * kWideMm)) {
    const double x = random.uniform(0.0, kEndMm), y = random.uniform(0.0, kWideMm);
    const double noise = x > kRoughFromMm ? rough : kFine;
    const double ridge = -bend * std::max(x - 0.5 * kRoughFromMm, 0.0);
    points.push_back({x, y, ridge + noise * random.normal()});
  }
  return points;
}
MortonPoints sorted(const std::vector<Vec3>& points) {
  return {cloud::build_cloud(points, cloud::NonFinite::kDrop).value(), 1};
}
/// The mean of the field over the points between two x, from the strip's beginning.
double mean_between(const NoiseField& field, const MortonPoints& points, double low, double high) {
  double sum = 0.0, count = 0.0;
  const double begin = points.box_mm().low_mm.x();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double x = points[i].x() - begin;
    if (x < low || x > high) continue;
    sum += field.at(i);
    count += 1.0;
  }
  return sum / count;
}

TEST(NoiseField, TellsRoughPlacesFromFineOnes) {
  const MortonPoints points = sorted(strip(kRough, 0.0));
  const NoiseField field(points, 2), one(points, 1), everywhere(points, 2, true);
  EXPECT_NEAR(field.median(), kFine, 0.3 * kFine);
  EXPECT_NEAR(mean_between(field, points, 20.0, 60.0), field.median(), 0.02 * kFine);
  EXPECT_NEAR(mean_between(field, points, 120.0, 139.0), kRough, 0.2 * kRough);
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_EQ(field.at(i), one.at(i)) << i;
    ASSERT_EQ(everywhere.at(i), field.median()) << i;
  }
}

// A ridge is shape: a fit over it is off by more than noise, but not those beside it.
TEST(NoiseField, ARidgeIsNoNoise) {
  const MortonPoints points = sorted(strip(kFine, 1.0));
  const NoiseField field(points, 2);
  EXPECT_NEAR(mean_between(field, points, 45.0, 55.0), field.median(), 0.1 * kFine);
}

// What is found of points without noise is their shape: one answer everywhere.
TEST(NoiseField, CleanPointsHaveNone) {
  Random random(3);
  std::vector<Vec3> points;
  for (int i = 0; i < 6000; ++i) {
    const double x = random.uniform(0.0, 80.0), y = random.uniform(0.0, 80.0);
    points.push_back({x, y, 0.01 * x * x + (x > 40.0 ? 0.5 * (x - 40.0) : 0.0)});
  }
  const MortonPoints all = sorted(points);
  const NoiseField field(all, 2);
  for (std::size_t i = 0; i < all.size(); ++i) ASSERT_EQ(field.at(i), field.median());
}

}  // namespace
}  // namespace palpate::spline_sdf
