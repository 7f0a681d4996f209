// `cloud` on surfaces that enclose a volume: which side is touched, and what a hole in them may not break.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "tests/stepped.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/core/random.h"
#include "toolkit/render/registry.h"

namespace palpate::render {
namespace {

constexpr double kRadius = 50.0;

/// Points of a sphere around `centre`; the hole, at +x, is 20 mm wide on one of 50 mm.
std::vector<Vec3> sphere_points(double radius, const Vec3& centre, bool with_hole) {
  const auto model =
      cloud::generate(parse_named_options("sphere:points=20000:extent_mm=100").value()).value();
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < model.cloud.size(); ++i) {
    const Vec3 p = model.cloud.point_mm(i) / kRadius;
    if (!with_hole || p.x() < 0.98) points.push_back(centre + radius * p);
  }
  return points;
}

test::Stepped sphere(bool with_hole, const char* renderer = "cloud") {
  return prepared(cloud_of(sphere_points(kRadius, Vec3::Zero(), with_hole)), renderer);
}

Frame glide(const test::Stepped& renderer, const Vec3& from, const Vec3& to) {
  constexpr int kFrames = 2000;
  Frame frame;
  for (int i = 0; i <= kFrames; ++i)
    frame = renderer->step(from + (to - from) * (static_cast<double>(i) / kFrames), 1e-3);
  return frame;
}

TEST(ClosedCloud, IsTouchedFromOutside) {
  const auto cloud = sphere(false);
  cloud->restart(Vec3(0, 0, kRadius + 5));
  const Frame frame = glide(cloud, Vec3(0, 0, kRadius + 5), Vec3(0, 0, kRadius - 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_GT(frame.force_n.z(), 0.0);
}

TEST(ClosedCloud, IsTouchedFromInsideWhereTheHipStartsInside) {
  const auto cloud = sphere(false);
  cloud->restart(Vec3(0, 0, 10));
  Frame frame = glide(cloud, Vec3(0, 0, 10), Vec3(0, 0, kRadius + 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_LT(frame.force_n.z(), 0.0);
  frame = glide(cloud, Vec3(0, 0, kRadius + 1), Vec3(0, 0, 20));
  EXPECT_FALSE(frame.contact);
  EXPECT_EQ(frame.force_n, Vec3::Zero());
}

// In by the hole and out through the wall: its back holds nobody, and its front is felt as before.
TEST(ClosedCloud, WithAHoleIsFeltFromOutsideAfterTheHipWasInside) {
  const auto cloud = sphere(true, "cloud:surface=stars");
  const Vec3 before(kRadius + 10, 0, 0), middle(0, 0, 0), wall(0, 0.3, kRadius + 1);
  cloud->restart(before);
  EXPECT_FALSE(glide(cloud, before, middle).contact);
  EXPECT_FALSE(glide(cloud, middle, wall).contact);
  const Frame frame = glide(cloud, Vec3(0, 0.3, kRadius + 5), Vec3(0, 0.3, kRadius - 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_GT(frame.force_n.z(), 0.0);
}

TEST(ClosedCloud, WithAHoleIsFeltFromInsideWhereTheHipStartsInside) {
  const auto cloud = sphere(true, "cloud:surface=stars");
  cloud->restart(Vec3(0, 0, 10));
  const Frame frame = glide(cloud, Vec3(0, 0, 10), Vec3(0, 0.3, kRadius + 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_LT(frame.force_n.z(), 0.0);
}

// As of a vase: in by its mouth, and the wall is there; the same for the smooth surface.
TEST(ClosedCloud, WithAHoleIsFeltFromBothSidesWhereThatIsAskedFor) {
  for (const char* renderer : {"cloud:sides=both", "cloud-smooth:sides=both"}) {
    const auto cloud = sphere(true, renderer);
    const Vec3 before(kRadius + 10, 0, 0), middle(0, 0, 0), wall(0, 0.3, kRadius + 1);
    cloud->restart(before);
    EXPECT_FALSE(glide(cloud, before, middle).contact) << renderer;
    const Frame frame = glide(cloud, middle, wall);
    ASSERT_TRUE(frame.contact) << renderer;
    EXPECT_LT(frame.force_n.z(), 0.0) << renderer;
  }
}

TEST(ClosedCloud, ABowlIsFeltFromBothSides) {
  std::vector<Vec3> points = sphere_points(kRadius, Vec3::Zero(), false);
  std::erase_if(points, [](const Vec3& p) { return p.z() > 0.0; });
  const auto cloud = prepared(cloud_of(points), "cloud:surface=stars");
  const Vec3 above(0, 0.3, kRadius), below(0, 0.3, -kRadius - 5);
  cloud->restart(above);
  Frame frame = glide(cloud, above, Vec3(0, 0.3, -kRadius - 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_GT(frame.force_n.z(), 0.0);
  cloud->restart(below);
  frame = glide(cloud, below, Vec3(0, 0.3, -kRadius + 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_LT(frame.force_n.z(), 0.0);
}

// Pressed against the wall, then along it into the mouth and to the middle: nothing is felt in free air.
TEST(ClosedCloud, AMouthLetsGoOfWhoSlidesIntoIt) {
  const auto cloud = sphere(true, "cloud:surface=stars");
  constexpr double kBeside = 0.3;  // of the way around, from the axis of the mouth
  const auto at = [](double angle, double radius) {
    return Vec3(radius * std::cos(angle), radius * std::sin(angle), 0.0);
  };
  cloud->restart(at(kBeside, kRadius + 2));
  Frame frame = glide(cloud, at(kBeside, kRadius + 2), at(kBeside, kRadius - 1));
  ASSERT_TRUE(frame.contact);
  frame = glide(cloud, at(kBeside, kRadius - 1), at(0.0, kRadius - 1));
  EXPECT_FALSE(frame.contact);
  EXPECT_FALSE(glide(cloud, at(0.0, kRadius - 1), Vec3::Zero()).contact);
}

// On planes at every point, a sphere with a hole is taken for a whole one: in by the hole, out through the
// surface, and everything is as it was before.
TEST(ClosedCloud, AHoleDoesNotTurnItInsideOut) {
  const auto cloud = sphere(true, "cloud:surface=vertices");
  const Vec3 before(kRadius + 10, 0, 0), middle(0, 0, 0), above(0, 0.3, kRadius + 5);
  cloud->restart(before);
  Frame frame = glide(cloud, before, middle);
  EXPECT_FALSE(frame.contact);
  frame = glide(cloud, middle, above);
  EXPECT_FALSE(frame.contact);
  frame = glide(cloud, above, Vec3(0, 0.3, kRadius - 1));
  ASSERT_TRUE(frame.contact);
  // 1 mm deep at the default 0.5 N/mm. A facet lies below the sphere, by no more than the square of its
  // corners' distance from its middle over the diameter, and is tilted by that distance over the radius. The
  // corners are neighbours, whose triangles the spacing spans.
  const double spacing = std::sqrt(4.0 * std::numbers::pi * kRadius * kRadius / 20000.0);
  EXPECT_GT(frame.force_n.norm(), 0.5 * (1.0 - spacing * spacing / (2.0 * kRadius)));
  EXPECT_LT(frame.force_n.norm(), 0.5 * 1.0001);
  const Vec3 outward = Vec3(0, 0.3, kRadius - 1).normalized();
  EXPECT_LT((frame.force_n.normalized() - outward).norm(), spacing / kRadius);
}

// Shells that do not touch: each is felt from the side that the HIP was on at the start.
struct Shell {
  Vec3 centre;
  double radius;
};

/// How deep a HIP is in the matter of a shell that was entered at `start`; negative where it is free of it.
double depth_mm(const Shell& shell, const Vec3& start, const Vec3& hip) {
  const double over = (hip - shell.centre).norm() - shell.radius;
  return (start - shell.centre).norm() < shell.radius ? over : -over;
}

/// Frames along a way whose contact or force is not that of the shells.
int wrong_frames(const test::Stepped& renderer, const std::vector<Shell>& shells, const Vec3& start,
                 const std::vector<Vec3>& way) {
  constexpr double kSpacing = 1.3;  // beyond it contact must be right
  constexpr int kFrames = 1000;
  int wrong = 0;
  for (std::size_t leg = 0; leg + 1 < way.size(); ++leg)
    for (int i = 0; i <= kFrames; ++i) {
      const Vec3 hip = way[leg] + (way[leg + 1] - way[leg]) * (static_cast<double>(i) / kFrames);
      const Frame frame = renderer->step(hip, 1e-3);
      double deepest = -1e9;
      for (const Shell& shell : shells) deepest = std::max(deepest, depth_mm(shell, start, hip));
      if (std::abs(deepest) < 0.1 * kSpacing) continue;
      wrong += frame.contact != (deepest > 0.0);
      if (frame.contact && deepest > 0.0) wrong += std::abs(frame.force_n.norm() - 0.5 * deepest) > 0.05;
    }
  return wrong;
}

TEST(ClosedCloud, EachOfTwoHollowSpheresHasASideOfItsOwn) {
  const std::vector<Shell> shells = {{Vec3::Zero(), kRadius}, {Vec3(150, 0, 0), 30.0}};
  std::vector<Vec3> points = sphere_points(kRadius, Vec3::Zero(), true);
  const std::vector<Vec3> other = sphere_points(30.0, shells[1].centre, false);
  points.insert(points.end(), other.begin(), other.end());
  const SceneInput scene = cloud_of(points);
  for (const char* spec : {"cloud", "cloud:partition=octree", "cloud:neighbours=exact-knn"}) {
    SCOPED_TRACE(spec);
    const auto cloud = prepared(scene, spec);
    // Inside the first: its inside wall, out by its hole, the outside of the second.
    const Vec3 inside(0, 5, 0);
    const std::vector<Vec3> way = {inside,          Vec3(0, 5, kRadius + 2), inside, Vec3(kRadius + 20, 0, 0),
                                   Vec3(122, 0, 0), Vec3(kRadius + 20, 0, 0)};
    cloud->restart(inside);
    EXPECT_EQ(wrong_frames(cloud, shells, inside, {way[0], way[1], way[2]}), 0);
    (void)glide(cloud, way[2], way[3]);
    EXPECT_EQ(wrong_frames(cloud, {shells[1]}, inside, {way[3], way[4], way[5]}), 0);
    // A restart inside the second, one outside of both.
    const Vec3 second(150, 0, 3), outside(0, kRadius + 10, 0);
    cloud->restart(second);
    EXPECT_EQ(wrong_frames(cloud, shells, second, {second, Vec3(150, 32, 0), second}), 0);
    cloud->restart(outside);
    EXPECT_EQ(wrong_frames(cloud, shells, outside, {outside, Vec3(0, kRadius - 2, 0), outside}), 0);
  }
}

TEST(ClosedCloud, NestedShellsAreFeltFromBetweenThem) {
  std::vector<Shell> shells;
  std::vector<Vec3> points;
  for (const double radius : {50.0, 30.0, 15.0}) {
    shells.push_back({Vec3::Zero(), radius});
    const std::vector<Vec3> shell = sphere_points(radius, Vec3::Zero(), false);
    points.insert(points.end(), shell.begin(), shell.end());
  }
  const auto cloud = prepared(cloud_of(points), "cloud");
  Random random(31);
  for (const double at : {5.0, 22.0, 40.0, 60.0})
    for (int run = 0; run < 5; ++run) {
      SCOPED_TRACE(testing::Message() << "seed 31, start at " << at << " mm, run " << run);
      const Vec3 u = Vec3(random.normal(), random.normal(), random.normal()).normalized();
      const Vec3 start = at * u;
      cloud->restart(start);
      const double in = at > 50   ? 48
                        : at > 30 ? 28
                        : at > 15 ? 13
                                  : 0,
                   out = at < 15   ? 17
                         : at < 30 ? 32
                                   : 52;
      EXPECT_EQ(wrong_frames(cloud, shells, start, {start, in * u, start}), 0);
      EXPECT_EQ(wrong_frames(cloud, shells, start, {start, out * u, start}), 0);
    }
}

// A surface that gives way keeps places for points to come: these may not tell where the inside is.
TEST(ClosedCloud, GivingWayDoesNotTurnAThinPlateInsideOut) {
  Scene scene = generated("slab:points=3000:thickness_mm=1:extent_mm=10");
  scene.input.models[0].surface.dent = {100.0, 1.0, 1.0};  // never reached
  for (const char* spec : {"cloud", "cloud:surface=vertices"}) {
    const auto cloud = prepared(scene.input, spec);
    const geometry::Aabb box = scene.surface->box_mm();
    Random random(37);
    int missed = 0;
    for (int run = 0; run < 400; ++run) {
      const double side = run % 2 == 0 ? 1.0 : -1.0;
      const Vec3 start(random.uniform(-4, 4), random.uniform(-4, 4),
                       side > 0 ? box.high_mm.z() + 0.5 : box.low_mm.z() - 0.5);
      cloud->restart(start);
      const Frame frame = glide(cloud, start, start - Vec3(0, 0, 0.8 * side));
      missed += !frame.contact || frame.force_n.z() * side <= 0.0;
    }
    EXPECT_EQ(missed, 0) << "seed 37, " << spec;
  }
}

}  // namespace
}  // namespace palpate::render
