// `cloud-smooth` against exact truths: clean and noisy points, two sheets, a border, stray points; and that
// its answers depend on nothing but the points.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include <palpate/generate.h>
#include "tests/toolkit/spline_sdf/spline_sdf_scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/spline_sdf/orient_patches.h"
#include "toolkit/spline_sdf/point_noise.h"

namespace palpate::spline_sdf {

using namespace render;

namespace {

void expect_no_fault(const Score& s) {
  expect_kept(s);
  EXPECT_EQ(s.jumps, 0);
}

TEST(CloudSmooth, CleanPointsAreFeltAsTheSurface) {
  const Score s = torus_score({});
  EXPECT_LT(s.rms_percent, 0.05);
  expect_no_fault(s);
}

TEST(CloudSmooth, GoesThroughNoise) {
  const TorusSpec t{.noise = 0.22};
  const Score smooth = torus_score(t), cloud = torus_score(t, "cloud");
  EXPECT_LT(smooth.rms_percent, 2.0);
  EXPECT_LT(smooth.rms_percent, 0.1 * cloud.rms_percent);
  expect_no_fault(smooth);
}

TEST(CloudSmooth, StrayPointsAreLeftOut) {
  const Score s = torus_score({.noise = 0.15, .outliers = 0.01});
  EXPECT_LT(s.rms_percent, 2.0);
  expect_no_fault(s);
}

std::vector<Vec3> sphere(double radius, double spacing, Random& random) {
  std::vector<Vec3> points(
      static_cast<std::size_t>(4.0 * std::numbers::pi * radius * radius / (spacing * spacing)));
  for (Vec3& p : points) p = radius * Vec3{random.normal(), random.normal(), random.normal()}.normalized();
  return points;
}

// The inner sheet lies 3 spacings below the outer one: one cube of four voxels holds both.
TEST(CloudSmooth, SheetsThreeSpacingsApartAreKeptApart) {
  Random random(3);
  std::vector<Vec3> points = sphere(10.0, 0.2, random);
  const std::vector<Vec3> inner = sphere(9.4, 0.2, random);
  points.insert(points.end(), inner.begin(), inner.end());
  test::Stepped renderer = prepared(cloud_of(points), "cloud-smooth", 2);
  const Score s = score(renderer, sphere_path(10.0, 9000), sphere_truth(10.0), 0.1);
  EXPECT_LT(s.rms_percent, 1.5);
  EXPECT_EQ(s.missed + s.false_ones + s.bounds, 0);
  EXPECT_LT(s.jumps, 15);
}

/// Both ways round, and more: what a border is must not hang on where chance put the points.
constexpr std::uint64_t kSheets = 24;

std::vector<Vec3> square(double half, double spacing, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points(static_cast<std::size_t>(4.0 * half * half / (spacing * spacing)));
  for (Vec3& p : points) {
    const double a = (2.0 * random.uniform() - 1.0) * half, b = (2.0 * random.uniform() - 1.0) * half;
    p = seed % 2 == 0 ? Vec3(b, a, 0.0) : Vec3(a, b, 0.0);
  }
  return points;
}

TEST(CloudSmooth, NothingIsFeltBesideABorder) {
  for (std::uint64_t seed = 0; seed < kSheets; ++seed) {
    test::Stepped renderer = prepared(cloud_of(square(10.0, 0.2, seed)), "cloud-smooth", 2);
    for (const double beside : {0.6, 0.8, 1.5})  // 3 spacings and more
      for (const double y : {-6.0, -3.0, 0.0, 3.0, 6.0}) {
        renderer->restart(Vec3(10.0 + beside, y, 1.0));
        int felt = 0;
        for (int k = 0; k <= 120; ++k)
          felt += renderer->step(Vec3(10.0 + beside, y + 0.01 * k, 1.0 - 0.01 * k), 0.001).contact;
        EXPECT_EQ(felt, 0) << beside << " beside, from " << y << ", seed " << seed;
      }
    // And it is felt inside it, from either side.
    for (const double side : {1.0, -1.0}) {
      renderer->restart(Vec3(9.0, 0.0, side));
      Frame frame;
      for (int k = 0; k <= 120; ++k)
        frame = renderer->step(Vec3(9.0, 0.01 * k, side * (1.0 - 0.01 * k)), 0.001);
      ASSERT_TRUE(frame.contact) << "seed " << seed;
      EXPECT_NEAR(frame.force_n.z(), side * 0.5 * 0.2, 1e-3);
    }
  }
}

TEST(CloudSmooth, AHandThatGoesPastTheBorderIsLetGo) {
  for (std::uint64_t seed = 0; seed < kSheets; ++seed) {
    test::Stepped renderer = prepared(cloud_of(square(10.0, 0.2, seed)), "cloud-smooth", 2);
    for (const double y : {-6.0, -3.0, 0.0, 3.0, 6.0}) {
      renderer->restart(Vec3(8.0, y, 0.5));
      bool held = false, after = true;
      for (int k = 0; k <= 60; ++k) held = renderer->step(Vec3(8.0, y, 0.5 - 0.015 * k), 0.001).contact;
      EXPECT_TRUE(held) << "from " << y << ", seed " << seed;
      for (int k = 0; k <= 300; ++k) after = renderer->step(Vec3(8.0 + 0.01 * k, y, -0.4), 0.001).contact;
      EXPECT_FALSE(after) << "from " << y << ", seed " << seed;
    }
  }
}

// The work of a closed path at constant stiffness without friction is nothing.
TEST(CloudSmooth, MakesNoEnergyOnClosedPaths) {
  const TorusSpec t{.noise = 0.2};
  test::Stepped renderer = prepared(cloud_of(torus_points(t)), "cloud-smooth", 2);
  for (int loop = 0; loop < 20; ++loop) {
    Random random(static_cast<std::uint64_t>(loop) + 1);
    const double a0 = 2.0 * std::numbers::pi * random.uniform(),
                 b0 = 2.0 * std::numbers::pi * random.uniform();
    constexpr int kFrames = 2000;
    double made = 0.0, moved = 0.0;
    Vec3 last = Vec3::Zero(), force = Vec3::Zero();
    for (int k = 0; k <= kFrames; ++k) {
      const double s = 2.0 * std::numbers::pi * k / kFrames;
      const double a = a0 + 0.1 * std::sin(s), b = b0 + 0.2 * std::sin(2.0 * s),
                   r = kTube + 0.3 - 0.7 * (1.0 - std::cos(s));
      const Vec3 h((kRing + r * std::cos(b)) * std::cos(a), (kRing + r * std::cos(b)) * std::sin(a),
                   r * std::sin(b));
      if (k == 0) renderer->restart(h);
      const Frame frame = renderer->step(h, 0.001);
      if (k > 0) {
        const double work = 0.5 * (frame.force_n + force).dot(h - last);
        made += work;
        moved += std::abs(work);
      }
      last = h;
      force = frame.force_n;
    }
    EXPECT_GT(moved, 0.1);
    EXPECT_LT(std::abs(made), 5e-4 * moved) << "loop " << loop;
  }
}

std::vector<Frame> frames_of(const std::vector<Vec3>& points, const TorusSpec& t, int threads) {
  test::Stepped renderer = prepared(cloud_of(points), "cloud-smooth", threads);
  const std::vector<Vec3> path = torus_path(t, 2000);
  renderer->restart(path.front());
  std::vector<Frame> frames;
  for (const Vec3& h : path) frames.push_back(renderer->step(h, 0.001));
  return frames;
}

TEST(CloudSmooth, AnswersDoNotDependOnThreadsOrOrder) {
  const TorusSpec t{.points = 20000, .noise = 0.2};
  std::vector<Vec3> points = torus_points(t);
  const std::vector<Frame> one = frames_of(points, t, 1), three = frames_of(points, t, 3);
  std::vector<Vec3> shuffled;
  for (std::size_t i = 0; i < points.size(); ++i) shuffled.push_back(points[i * 7919 % points.size()]);
  const std::vector<Frame> other = frames_of(shuffled, t, 2);
  for (std::size_t k = 0; k < one.size(); ++k) {
    ASSERT_EQ(one[k].force_n, three[k].force_n) << k;
    ASSERT_EQ(one[k].force_n, other[k].force_n) << k;
  }
}

TEST(CloudSmooth, SizeAndPlaceDoNotMatter) {
  const TorusSpec plain{.points = 20000, .noise = 0.1};
  const Score here = torus_score(plain);
  EXPECT_LT(here.rms_percent, 3.0);
  for (const double scale : {1e-3, 1e6}) {
    TorusSpec t = plain;
    t.scale = scale;
    const Score s = torus_score(t);
    EXPECT_NEAR(s.rms_percent, here.rms_percent, 0.05 * here.rms_percent) << scale;
    expect_no_fault(s);
  }
  TorusSpec far = plain;
  far.at = Vec3(1e6, -2e6, 5e5);
  EXPECT_NEAR(torus_score(far).rms_percent, here.rms_percent, 0.05 * here.rms_percent);
}

// What `cloud-smooth` says beforehand of points that it cannot follow, and of which it says nothing.

InputQuality input_quality_of(const cloud::Cloud& cloud) {
  const MortonPoints points(cloud, 1);
  return assess_input_quality(points, estimate_noise(points, 1), 1);
}
cloud::Cloud generated(const std::string& text) {
  return cloud::generate(parse_named_options(text).value()).value().cloud;
}

TEST(InputQuality, OfThinPlates) {
  for (const double thickness : {0.01, 0.03, 0.1}) {
    const InputQuality d = input_quality_of(
        generated(fmt::format("slab:extent_mm=16:thickness_mm={}:spacing_mm=0.3", thickness)));
    EXPECT_GT(d.layered, 0.5) << thickness;
    EXPECT_NEAR(d.layer_distance_mm, thickness, 0.2 * thickness);
    EXPECT_LT(d.scattered, 0.01);
  }
  EXPECT_LT(input_quality_of(generated("slab:extent_mm=16:thickness_mm=1:spacing_mm=0.3")).layered, 0.02);
  // Two spacings apart and a third of one rough: as one sheet a hundredth of its contact is felt.
  EXPECT_GT(input_quality_of(generated("slab:points=20000:noise=0.15")).layered, 0.5);
}

// Cells along the grid count as more area on one face than on the other.
TEST(InputQuality, AClosedSlabHasNoMouth) {
  for (const double thickness : {2.3, 3.0, 5.0}) {
    SceneInput scene;
    scene.models.emplace_back().cloud = std::make_shared<const cloud::Cloud>(
        generated(fmt::format("slab:points=30000:thickness_mm={}", thickness)));
    const PrepareReport report = prepare_report(scene, "cloud-smooth").value();
    for (const std::string& warning : report.warnings)
      EXPECT_EQ(warning.find("mouth"), std::string::npos) << thickness << ": " << warning;
  }
}

TEST(InputQuality, NoneOfSurfaces) {
  for (const char* text : {"sinusoid:points=10201", "sinusoid:points=10000:sampling=random:noise=0.2",
                           "sphere:points=5000", "sinusoid:points=10000:sampling=random:noise=0.5",
                           "pebble:points=6000", "slab:points=20000:thickness_mm=5:noise=0.15",
                           "sinusoid:sampling=scan:points=20000:noise=0.1:dropout=0.05:flying=0.01:seed=1"}) {
    const InputQuality d = input_quality_of(generated(text));
    EXPECT_LT(d.layered, 0.02) << text;
    EXPECT_LT(d.scattered, 0.05) << text;
  }
}

TEST(InputQuality, OfVolumes) {
  Random random(9);
  const auto length = [&] { return random.uniform(-5.0, 5.0); };
  std::vector<Vec3> points;
  for (int i = 0; i < 3000; ++i) points.push_back(Vec3{length(), length(), length()});
  EXPECT_GT(input_quality_of(cloud::build_cloud(points, cloud::NonFinite::kRefuse).value()).scattered, 0.3);
}

// What is left out beside a surface that is known.

constexpr double kWide = 10.0;

/// Flat, a spacing of one, and beyond doubt; with points everywhere, or only where x is less than nothing.
QuadricPatch known_patch(bool everywhere) {
  QuadricPatch p;
  p.support = p.extent = kWide;
  p.spacing = 1.0;
  p.sigma = p.noise = 0.1;
  p.points = 300;
  p.reliable = true;
  p.occupancy = DiscOccupancy(2000);
  for (int i = 0; i <= 80; ++i)
    for (int j = 0; j <= 80; ++j) {
      const double a = 0.025 * (i - 40), b = 0.025 * (j - 40);
      if (everywhere || a < 0.0) p.occupancy.add(a, b);
    }
  return p;
}
QuadricPatch small_patch(const Vec3& at, double spacing) {
  QuadricPatch p;
  p.quadric.at = at;
  p.support = p.extent = 1.3 * spacing;
  p.spacing = spacing;
  p.sigma = p.noise = 0.1;
  p.points = 9;
  return p;
}
std::size_t left_of(const std::vector<QuadricPatch>& given) {
  std::vector<QuadricPatch> one = given, two = given;
  drop_outlier_patches(one, 1);
  drop_outlier_patches(two, 2);
  EXPECT_EQ(one.size(), two.size());
  return one.size();
}

TEST(Strays, WhatLiesBesideAKnownSurfaceIsLeftOut) {
  const QuadricPatch known = known_patch(true);
  EXPECT_EQ(left_of({known, small_patch({1.0, 0.5, 2.0}, 1.0)}), 1u);
  EXPECT_EQ(left_of({small_patch({1.0, 0.5, -2.0}, 1.0), known}), 1u);
  // On it, and far from it.
  EXPECT_EQ(left_of({known, small_patch({1.0, 0.5, 0.2}, 1.0)}), 2u);
  EXPECT_EQ(left_of({known, small_patch({1.0, 0.5, 13.0}, 1.0)}), 2u);
  // On it, but of few points that are not its own.
  EXPECT_EQ(left_of({known, small_patch({1.0, 0.5, 0.2}, 2.5)}), 1u);
  // Beyond doubt itself: another sheet.
  QuadricPatch other = known;
  other.quadric.at.z() = 1.0;
  EXPECT_EQ(left_of({known, other}), 2u);
}

TEST(Strays, WhereTheKnownSurfaceEndsTheyStay) {
  const QuadricPatch known = known_patch(false);
  EXPECT_EQ(left_of({known, small_patch({1.0, 0.5, 2.0}, 1.0)}), 2u);
  EXPECT_EQ(left_of({known, small_patch({-5.0, 0.5, 2.0}, 1.0)}), 1u);
}

}  // namespace
}  // namespace palpate::spline_sdf
