// `cloud-smooth` against exact truths: clean and noisy points, two sheets, a border, stray points; and that
// its answers depend on nothing but the points.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "tests/toolkit/smooth/smooth_scenes.h"

namespace palpate::render {
namespace {

void expect_no_fault(const Score& s) {
  EXPECT_EQ(s.missed, 0);
  EXPECT_EQ(s.false_ones, 0);
  EXPECT_EQ(s.jumps, 0);
  EXPECT_EQ(s.bounds, 0);
}

TEST(CloudSmooth, CleanPointsAreFeltAsTheSurface) {
  const Score s = torus_score({});
  EXPECT_LT(s.rms_percent, 0.05);
  expect_no_fault(s);
}

TEST(CloudSmooth, GoesThroughNoise) {
  TorusSpec t;
  t.noise = 0.22;
  const Score smooth = torus_score(t), cloud = torus_score(t, "cloud");
  EXPECT_LT(smooth.rms_percent, 2.0);
  EXPECT_LT(smooth.rms_percent, 0.1 * cloud.rms_percent);
  expect_no_fault(smooth);
}

TEST(CloudSmooth, StrayPointsAreLeftOut) {
  TorusSpec t;
  t.noise = 0.15;
  t.outliers = 0.01;
  const Score s = torus_score(t);
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
  TorusSpec t;
  t.noise = 0.2;
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
  TorusSpec t;
  t.points = 20000;
  t.noise = 0.2;
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
  TorusSpec plain;
  plain.points = 20000;
  plain.noise = 0.1;
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

}  // namespace
}  // namespace palpate::render
