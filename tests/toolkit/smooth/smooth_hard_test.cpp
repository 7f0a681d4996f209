// `cloud-smooth` where there is little to go by, and its properties.
#include <gtest/gtest.h>

#include "tests/toolkit/smooth/smooth_scenes.h"
#include "toolkit/surface/surface.h"

namespace palpate::render {
namespace {

void expect_finite(const std::vector<Vec3>& points) {
  test::Stepped renderer = prepared(cloud_of(points), "cloud-smooth");
  const Vec3 from = points.front() + Vec3(0.1, 0.2, 3.0);
  renderer->restart(from);
  for (int k = 0; k <= 100; ++k) {
    const Frame frame = renderer->step(from - Vec3(0, 0, 0.06 * k), 0.001);
    EXPECT_TRUE(is_finite(frame.force_n));
    EXPECT_TRUE(is_finite(frame.god_object_mm));
  }
}

TEST(CloudSmoothHard, TakesCloudsThatAreNoSurface) {
  expect_finite({Vec3(1, 2, 3)});
  expect_finite(std::vector<Vec3>(100, Vec3(1, 2, 3)));
  std::vector<Vec3> line, few, pile, lattice;
  for (int i = 0; i < 200; ++i) line.emplace_back(0.1 * i, 0.0, 0.0);
  for (int i = 0; i < 7; ++i) few.emplace_back(i % 3, i / 3, 0.1 * i);
  Random random(1);
  for (int i = 0; i < 500; ++i) pile.push_back(Vec3{random.uniform(), random.uniform(), random.uniform()});
  for (int i = 0; i < 1000; ++i) lattice.emplace_back(i % 10, i / 10 % 10, i / 100);
  expect_finite(line);
  expect_finite(few);
  expect_finite(pile);
  expect_finite(lattice);
}

TEST(CloudSmoothHard, SaysThatPointsOnALineMakeNoSurface) {
  std::vector<Vec3> line;
  for (int i = 0; i < 200; ++i) line.emplace_back(0.1 * i, 0.0, 0.0);
  Registry registry;
  register_toolkit_renderers(registry);
  const auto renderer = registry.make("cloud-smooth", {}).value();
  const Result<PrepareReport> report = renderer->prepare(cloud_of(line), {1, nullptr});
  ASSERT_TRUE(report);
  ASSERT_EQ(report->warnings.size(), 1u);
  EXPECT_NE(report->warnings[0].find("nothing is felt"), std::string::npos);
}

TEST(CloudSmoothHard, RepeatedPointsChangeNothing) {
  TorusSpec t;
  t.points = 20000;
  std::vector<Vec3> points = torus_points(t);
  const std::size_t once = points.size();
  for (std::size_t i = 0; i < once; i += 3) points.push_back(points[i]);
  test::Stepped renderer = prepared(cloud_of(points), "cloud-smooth");
  const Score s = score(renderer, torus_path(t, 5000), torus_truth(t), 0.1);
  EXPECT_LT(s.rms_percent, 0.2);
  EXPECT_EQ(s.missed + s.false_ones + s.jumps, 0);
}

TEST(CloudSmoothHard, AHipFarOffIsFreeAndComesBack) {
  TorusSpec t;
  t.points = 20000;
  test::Stepped renderer = prepared(cloud_of(torus_points(t)), "cloud-smooth");
  const Vec3 above(kRing, 0.0, kTube + 1.0);
  renderer->restart(above);
  EXPECT_FALSE(renderer->step(Vec3(1e300, 0, 0), 0.001).contact);
  EXPECT_EQ(renderer->step(Vec3(NAN, 0, 0), 0.001).status, FrameStatus::kNonFinite);
  renderer->let_go(above);
  EXPECT_FALSE(renderer->step(above, 0.001).contact);
  EXPECT_TRUE(renderer->step(above - Vec3(0, 0, 1.5), 0.001).contact);
}

TEST(CloudSmoothHard, PropertiesFollowThePoints) {
  TorusSpec t;
  t.points = 20000;
  SceneInput scene = cloud_of(torus_points(t));
  auto values = std::make_shared<surface::PointProperties>();
  const cloud::Cloud& cloud = *scene.models[0].cloud;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    values->deformation.push_back(cloud.point_mm(i).x() > 0.0 ? 0.5f : 0.0f);
  scene.models[0].surface.per_point = values;
  test::Stepped renderer = prepared(scene, "cloud-smooth");
  for (const double x : {-kRing, kRing}) {
    const Vec3 above(x, 0.0, kTube + 0.5);
    renderer->restart(above);
    Frame frame;
    for (int k = 0; k <= 100; ++k) frame = renderer->step(above - Vec3(0, 0, 0.01 * k), 0.001);
    ASSERT_TRUE(frame.contact);
    EXPECT_NEAR(frame.force_n.z(), (x > 0.0 ? 0.5 : 1.0) * kTestStiffness * 0.5, 2e-3);
  }
}

TEST(CloudSmoothHard, FrictionHolds) {
  TorusSpec t;
  t.points = 20000;
  SceneInput scene = cloud_of(torus_points(t));
  scene.models[0].surface.friction = {0.7, 0.5};
  test::Stepped renderer = prepared(scene, "cloud-smooth");
  const Vec3 above(kRing, 0.0, kTube + 0.5);
  renderer->restart(above);
  for (int k = 0; k <= 100; ++k) (void)renderer->step(above - Vec3(0, 0, 0.01 * k), 0.001);
  const Frame frame = renderer->step(above + Vec3(0, 0.1, -1.0), 0.001);
  EXPECT_NEAR(frame.force_n.y(), -0.1 * kTestStiffness, 5e-3);
}

}  // namespace
}  // namespace palpate::render
