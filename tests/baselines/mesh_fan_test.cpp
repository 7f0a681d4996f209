// Corners of very many facets, as turned bodies have them on their axis: exact answers as far as a frame
// looks at all of them, and a warning beyond.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "experiments/stress/shapes.h"
#include "tests/baselines/stand.h"

namespace palpate::baselines {
namespace {

using geometry::TriangleMesh;
using test::kStiffness;
using test::Probe;

constexpr const char* kPointsOnFans[] = {"mesh-godobject:mesh=original", "mesh-proxy:mesh=original:radius=0"};
/// Rounding on lengths of some 20 mm, in a god object that many facets decide.
constexpr double kFanRoundingMm = 1e-9;

/// A profile that is not divided: one facet between two corners.
constexpr double kUndivided = 1e9;
TriangleMesh turned_body(const std::vector<experiments::OnProfile>& profile, int count) {
  return experiments::turned_mesh(profile, kUndivided, count);
}

/// A cylinder with a deep narrow pit from above, its bottom at the origin.
TriangleMesh body_with_pit(int count) {
  return turned_body({{0, -6}, {8, -6}, {8, 10}, {2, 10}, {0, 0}}, count);
}

// Below the bottom of a pit the god object stays there, wherever the HIP goes: each of the facets holds it.
TEST(MeshFan, ThePitOfAFunnelHolds) {
  for (const char* options : kPointsOnFans)
    for (const int count : {400, 1000}) {
      SCOPED_TRACE(std::string(options) + ", facets " + std::to_string(count));
      Probe probe = test::make(body_with_pit(count), options);
      EXPECT_TRUE(probe.report.warnings.empty()) << probe.report.warnings.front();
      constexpr int kWays = 36;
      for (int k = 0; k < kWays; ++k) {
        const double angle = 2.0 * std::numbers::pi * (k + 0.3) / kWays;
        const Vec3 start(0.01, 0.02, 15.0), below(0.01, 0.02, -1.0),
            beside(1.7 * std::cos(angle), 1.7 * std::sin(angle), -1.0);
        ASSERT_TRUE(probe.press(start, below, 0.05).contact) << k;
        const render::Frame frame = probe.glide(below, beside, 0.05);
        ASSERT_TRUE(frame.contact) << k;
        test::expect_near(frame.god_object_mm, Vec3::Zero(), kFanRoundingMm);
        test::expect_near(frame.force_n, -kStiffness * beside, kFanRoundingMm);
        EXPECT_FALSE(probe.glide(beside, below, 0.05).force_n.z() < 0.0);
        EXPECT_FALSE(probe.glide(below, start, 0.05).contact) << k;
      }
    }
}

// Under the tip of a blunt cone the HIP goes from one side to the other in one frame: the god object follows
// to the facet that is nearest there.
TEST(MeshFan, TheTipOfABluntConeIsGoneOver) {
  constexpr int kCount = 1000;
  const Vec3 tip(0, 0, 2);
  std::vector<Vec3> normals;
  const auto corner = [](int k) {
    const double angle = 2.0 * std::numbers::pi * k / kCount;
    return Vec3(6.0 * std::cos(angle), 6.0 * std::sin(angle), 0.0);
  };
  for (int k = 0; k < kCount; ++k)
    normals.push_back((corner(k) - tip).cross(corner(k + 1) - tip).normalized());
  for (const char* options : kPointsOnFans) {
    SCOPED_TRACE(options);
    Probe probe = test::make(turned_body({{0, -2}, {6, -2}, {6, 0}, {0, 2}}, kCount), options);
    constexpr int kWays = 24;
    for (int k = 0; k < kWays; ++k) {
      const double angle = 2.0 * std::numbers::pi * (k + 0.4) / kWays;
      const Vec3 across(0.5 * std::cos(angle), 0.5 * std::sin(angle), 0.0), down(0, 0, 1.5);
      ASSERT_TRUE(probe.press(down + across + Vec3(0, 0, 4), down + across, 0.05).contact);
      // A walk of half the fan may take a frame more than one.
      probe.to(down - across);
      const render::Frame frame = probe.to(down - across);
      ASSERT_TRUE(frame.contact) << k;
      double nearest = std::numeric_limits<double>::max();
      for (const Vec3& n : normals) nearest = std::min(nearest, std::abs(n.dot(down - across - tip)));
      EXPECT_NEAR((frame.god_object_mm - (down - across)).norm(), nearest, kFanRoundingMm) << k;
    }
  }
}

// What is more than a frame looks at is said before the first one.
TEST(MeshFan, MoreThanAFrameLooksAtIsWarnedOf) {
  constexpr int kCount = 3 * static_cast<int>(kMaxFan);
  Probe probe = test::make(body_with_pit(kCount), kPointsOnFans[0]);
  ASSERT_EQ(probe.report.warnings.size(), 1u);
  EXPECT_NE(
      probe.report.warnings.front().find(std::to_string(kCount) + " of the mesh's faces meet at one vertex"),
      std::string::npos)
      << probe.report.warnings.front();
  // Far from the axis nothing is lost.
  const Vec3 above(5.1, 0.3, 14.0), inside(5.1, 0.3, 9.6);
  test::expect_near(probe.press(above, inside, 0.05).force_n, Vec3(0, 0, 0.4 * kStiffness), kFanRoundingMm);
}

}  // namespace
}  // namespace palpate::baselines
