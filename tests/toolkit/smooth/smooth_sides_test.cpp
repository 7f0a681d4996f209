// `cloud-smooth`: which pieces of surface are felt from one side, and from which.
#include <gtest/gtest.h>

#include "tests/toolkit/smooth/smooth_scenes.h"
#include "toolkit/geometry/enclosure.h"

namespace palpate::render {
namespace {

using geometry::outer_side, geometry::share_around, geometry::SurfacePart;

constexpr double kBall = 12.0;

Vec3 by_chance_on_ball(Random& random) {
  const double z = 2.0 * random.uniform() - 1.0, a = 2.0 * std::numbers::pi * random.uniform();
  const double r = std::sqrt(1.0 - z * z);
  return {r * std::cos(a), r * std::sin(a), z};
}

/// Parts of a ball about `at` below a height in radii, of 24 voxels radius; the normals point outwards.
std::vector<SurfacePart> ball_parts(double below, double side, const Vec3& at) {
  constexpr std::size_t kParts = 3000;
  constexpr double kRadius = 24.0;
  Random random(5);
  std::vector<SurfacePart> parts;
  const double area = 4.0 * std::numbers::pi * kRadius * kRadius / static_cast<double>(kParts);
  for (std::size_t i = 0; i < kParts; ++i) {
    const Vec3 n = by_chance_on_ball(random);
    if (n.z() > below) continue;
    parts.push_back({(at + kRadius * n).cast<float>(), (side * area * n).cast<float>()});
  }
  return parts;
}

TEST(CloudSmoothSides, TheShareOfDirectionsTellsInsideFromOutside) {
  const Vec3 at(100.0, -40.0, 7.0);
  const std::vector<SurfacePart> ball = ball_parts(2.0, 1.0, at), turned = ball_parts(2.0, -1.0, at);
  for (const Vec3& d : {Vec3(0, 0, 0), Vec3(10, 5, -8), Vec3(0, -14, 3)}) {
    EXPECT_NEAR(share_around(ball, at + d), 1.0, 0.05);
    EXPECT_NEAR(share_around(turned, at + d), -1.0, 0.05);
  }
  for (const Vec3& d : {Vec3(40, 0, 0), Vec3(-25, 25, 0), Vec3(300, 200, -90)})
    EXPECT_NEAR(share_around(ball, at + d), 0.0, 0.05);
}

TEST(CloudSmoothSides, ABallIsClosedUntilAQuarterOfItIsGone) {
  const Vec3 at(3.0, 60.0, 7.0);
  for (const double side : {1.0, -1.0}) {
    for (const double below : {2.0, 0.95, 0.8, 0.65})
      EXPECT_EQ(outer_side(ball_parts(below, side, at)), static_cast<float>(side)) << below;
    for (const double below : {0.3, 0.0, -0.5}) EXPECT_EQ(outer_side(ball_parts(below, side, at)), 0.0f);
  }
  EXPECT_EQ(outer_side({}), 0.0f);
}

/// Points by chance on a ball, with noise, in the directions that `keep` keeps.
std::vector<Vec3> ball_points(std::size_t count, const std::function<bool(const Vec3&)>& keep) {
  Random random(17);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 n = by_chance_on_ball(random);
    const double off = 0.02 * random.normal();
    if (keep(n)) points.push_back((kBall + off) * n);
  }
  return points;
}

/// The frames in which the probe is held on its way between two places, in steps of 0.02 mm.
int held_frames(test::Stepped& renderer, const Vec3& from, const Vec3& to) {
  const int steps = static_cast<int>((to - from).norm() / 0.02);
  int held = 0;
  for (int i = 1; i <= steps; ++i)
    held += renderer->step(from + (to - from) * (static_cast<double>(i) / steps), 0.001).contact;
  return held;
}

TEST(CloudSmoothSides, ABallWithAMouthIsFeltFromOutsideAloneWhereTheReplayBeginsThere) {
  // The mouth is 30 degrees about z: a fifteenth of the ball.
  test::Stepped renderer =
      prepared(cloud_of(ball_points(30000, [](const Vec3& n) { return n.z() < 0.866; })), "cloud-smooth");
  const Vec3 above(0, 0, kBall + 3.0);
  renderer->restart(above);
  EXPECT_EQ(held_frames(renderer, above, Vec3(0, 0, 0)), 0);
  // Out through the wall, from behind.
  for (const Vec3& way : {Vec3(1, 0, 0), Vec3(0.3, -0.9, -0.2), Vec3(0, 0.1, -1)}) {
    const Vec3 out = (kBall + 2.0) * way.normalized();
    EXPECT_EQ(held_frames(renderer, Vec3(0, 0, 0), out), 0);
    // And in again, which is felt.
    EXPECT_NEAR(held_frames(renderer, out, 0.5 * out), (0.5 * (kBall + 2.0) - 2.0) / 0.02, 5);
    renderer->let_go(Vec3(0, 0, 0));
  }
}

TEST(CloudSmoothSides, ABallWithAMouthIsFeltFromInsideWhereTheReplayBeginsThere) {
  test::Stepped renderer =
      prepared(cloud_of(ball_points(30000, [](const Vec3& n) { return n.z() < 0.866; })), "cloud-smooth");
  for (const Vec3& begin : {Vec3(0, 0, 0), Vec3(kBall - 0.4, 0, 0)}) {
    renderer->restart(begin);
    EXPECT_NEAR(held_frames(renderer, begin, Vec3(kBall + 1.0, 0, 0)), 1.0 / 0.02, 5);
  }
}

TEST(CloudSmoothSides, AHalfBallIsFeltFromBothSides) {
  test::Stepped renderer =
      prepared(cloud_of(ball_points(30000, [](const Vec3& n) { return n.z() < 0.0; })), "cloud-smooth");
  const Vec3 below(0, 0, -kBall - 1.0), above(0, 0, 1.0);
  renderer->restart(below);
  EXPECT_NEAR(held_frames(renderer, below, Vec3(0, 0, -kBall + 1.0)), 1.0 / 0.02, 5);
  renderer->let_go(above);
  EXPECT_NEAR(held_frames(renderer, above, Vec3(0, 0, -kBall - 1.0)), 1.0 / 0.02, 5);
}

TEST(CloudSmoothSides, ComingOutOfAHoleDoesNotCatchTheProbe) {
  // Twelve holes of 9 degrees: the probe goes in by one, and out through the wall.
  Random random(23);
  std::vector<Vec3> holes;
  for (int i = 0; i < 12; ++i) holes.push_back(by_chance_on_ball(random));
  test::Stepped renderer = prepared(cloud_of(ball_points(40000,
                                                         [&](const Vec3& n) {
                                                           for (const Vec3& hole : holes)
                                                             if (n.dot(hole) > 0.9877) return false;
                                                           return true;
                                                         })),
                                    "cloud-smooth");
  renderer->restart((kBall + 1.0) * holes[0]);
  int caught = 0;
  for (const Vec3& hole : holes) {
    renderer->let_go((kBall + 1.0) * hole);
    const Vec3 in = (kBall - 1.5) * hole;
    const Vec3 aside = (hole + 0.6 * hole.unitOrthogonal()).normalized();
    const int held = held_frames(renderer, (kBall + 1.0) * hole, in) +
                     held_frames(renderer, in, (kBall - 1.5) * aside) +
                     held_frames(renderer, (kBall - 1.5) * aside, (kBall + 1.0) * aside);
    caught += held > 0;
  }
  // Beside the brim of a hole the surface goes on for a spacing or two, and pushes the probe out again.
  EXPECT_LE(caught, 2);
}

}  // namespace
}  // namespace palpate::render
