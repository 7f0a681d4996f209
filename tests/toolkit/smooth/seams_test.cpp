// Lines along which the curvature of clean points changes at once.
#include "toolkit/smooth/seams.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/random.h"
#include "toolkit/smooth/patch_links.h"

namespace palpate::render {
namespace {

constexpr double kEdgeRadius = 2.0, kEdgeSpacing = 0.12, kEdgeHalf = 2.5;

struct Looked {
  std::vector<Patch> patches;
  Seams seams;
  Vec3 origin;
};
Looked look(const std::vector<Vec3>& at, int threads) {
  const cloud::Cloud cloud = cloud::build_cloud(at, cloud::NonFinite::kDrop).value();
  const SmoothPoints points(cloud, 1);
  const NoiseField noise(points, 1);
  Looked out;
  out.origin = cloud.origin_mm;
  out.patches = cover_points(points, {2.0, noise, {}}, 1).patches;
  static_cast<void>(link_patches(points, out.patches, 1));
  out.seams = find_seams(points, out.patches, false, threads);
  return out;
}

/// Flat for x < 0, and from there round about an axis along y, at random, with noise in spacings.
std::vector<Vec3> rounded_edge(double noise) {
  Random random(81);
  std::vector<Vec3> points;
  const double arc = 0.5 * std::numbers::pi * kEdgeRadius;
  const auto count =
      static_cast<std::size_t>((kEdgeHalf + arc) * 2.0 * kEdgeHalf / (kEdgeSpacing * kEdgeSpacing));
  while (points.size() < count) {
    const double s = random.uniform(-kEdgeHalf, arc), y = random.uniform(-kEdgeHalf, kEdgeHalf),
                 off = noise * kEdgeSpacing * random.normal();
    const double angle = std::max(s, 0.0) / kEdgeRadius;
    points.push_back({std::min(s, 0.0) + (kEdgeRadius + off) * std::sin(angle), y,
                      (kEdgeRadius + off) * std::cos(angle) - kEdgeRadius});
  }
  return points;
}

TEST(Seams, AreFoundWhereARoundEdgeBegins) {
  const Looked one = look(rounded_edge(0.0), 1), two = look(rounded_edge(0.0), 2);
  ASSERT_GT(one.seams.all.size(), 6u);
  EXPECT_EQ(one.patches.size(), one.seams.plain + 2 * one.seams.all.size());
  ASSERT_EQ(one.seams.all.size(), two.seams.all.size());
  double off_sq = 0.0;
  for (std::size_t i = 0; i < one.seams.all.size(); ++i) {
    const Seam& seam = one.seams.all[i];
    EXPECT_EQ(seam.at, two.seams.all[i].at);
    const Vec3 at = seam.at + one.origin;
    EXPECT_NEAR(at.x(), 0.0, 0.3 * kEdgeSpacing);
    EXPECT_NEAR(std::abs(seam.across.x()), 1.0, 0.02);
    off_sq += at.x() * at.x();
    // One side is flat, the other as round as the edge.
    const Quadric& before = one.patches[seam.before].quadric;
    const Quadric& beyond = one.patches[seam.beyond].quadric;
    const double a = std::abs(before.uu + before.vv), b = std::abs(beyond.uu + beyond.vv);
    EXPECT_NEAR(std::min(a, b), 0.0, 0.03);
    EXPECT_NEAR(std::max(a, b), 0.5 / kEdgeRadius, 0.03);
  }
  EXPECT_LT(std::sqrt(off_sq / static_cast<double>(one.seams.all.size())), 0.06 * kEdgeSpacing);
  for (std::size_t i = 0; i < one.seams.plain; ++i)
    if (one.seams.crossed[i] != 0) {
      EXPECT_NEAR(one.patches[i].quadric.at.x() + one.origin.x(), 0.0, 4.0 * kEdgeSpacing);
    }
}

TEST(Seams, NoneInNoiseOrWhereNoneIsAskedFor) {
  EXPECT_TRUE(look(rounded_edge(0.1), 1).seams.all.empty());
  Looked looked = look(rounded_edge(0.0), 1);
  looked.patches.resize(looked.seams.plain);
  const cloud::Cloud cloud = cloud::build_cloud(rounded_edge(0.0), cloud::NonFinite::kDrop).value();
  const Seams none = find_seams(SmoothPoints(cloud, 1), looked.patches, true, 1);
  EXPECT_TRUE(none.all.empty());
  EXPECT_EQ(none.of.size(), none.plain);
}

// The curvature of these changes, but nowhere at once.
TEST(Seams, NoneOnRoundBodies) {
  Random random(82);
  std::vector<Vec3> wave, ball;
  for (int i = 0; i < 6000; ++i) {
    const double x = random.uniform(-5.0, 5.0), y = random.uniform(-5.0, 5.0);
    wave.push_back({x, y, std::sin(x) * std::cos(0.8 * y)});
    ball.push_back(3.0 * Vec3{random.normal(), random.normal(), random.normal()}.normalized());
  }
  EXPECT_TRUE(look(wave, 1).seams.all.empty());
  EXPECT_TRUE(look(ball, 1).seams.all.empty());
}

}  // namespace
}  // namespace palpate::render
