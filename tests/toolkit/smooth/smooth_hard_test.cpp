// `cloud-smooth` where there is little to go by, and its properties.
#include <gtest/gtest.h>

#include "tests/toolkit/smooth/smooth_scenes.h"
#include "toolkit/render/motion.h"
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

TEST(CloudSmoothHard, FrictionFollowsThePoints) {
  TorusSpec t;
  t.points = 20000;
  SceneInput scene = cloud_of(torus_points(t));
  auto values = std::make_shared<surface::PointProperties>();
  const cloud::Cloud& cloud = *scene.models[0].cloud;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    values->static_friction.push_back(cloud.point_mm(i).x() > 0.0 ? 0.7f : 0.0f);
    values->dynamic_friction.push_back(cloud.point_mm(i).x() > 0.0 ? 0.5f : 0.0f);
  }
  scene.models[0].surface.per_point = values;
  test::Stepped renderer = prepared(scene, "cloud-smooth");
  for (const double x : {-kRing, kRing}) {
    const Vec3 above(x, 0.0, kTube + 0.5);
    renderer->restart(above);
    for (int k = 0; k <= 100; ++k) (void)renderer->step(above - Vec3(0, 0, 0.01 * k), 0.001);
    const Frame frame = renderer->step(above + Vec3(0, 0.1, -1.0), 0.001);
    // Without friction the god object goes along; the ring turns it by 0.1 in 15.
    EXPECT_NEAR(frame.force_n.y(), x > 0.0 ? -0.1 * kTestStiffness : 0.0, 5e-3) << x;
  }
}

TEST(CloudSmoothHard, TextureIsFeltInItsWaves) {
  TorusSpec t;
  t.points = 20000;
  SceneInput scene = cloud_of(torus_points(t));
  surface::Texture& texture = scene.models[0].surface.texture;
  texture.kind = surface::TextureKind::kGrating;
  texture.depth_mm = 0.1;
  texture.wavelength_mm = 2.0;
  texture.axis = Vec3(0, 1, 0);
  test::Stepped renderer = prepared(scene, "cloud-smooth");
  const auto at = [](double angle, double lift) {
    return Vec3(kRing * std::cos(angle), kRing * std::sin(angle), kTube + lift);
  };
  renderer->restart(at(0.0, 0.5));
  for (int k = 0; k <= 100; ++k) (void)renderer->step(at(0.0, 0.5 - 0.01 * k), 0.001);
  // Along the ring over three waves: the depth of the relief as force, and as many turns.
  std::vector<double> force;
  for (int k = 0; k <= 400; ++k) force.push_back(renderer->step(at(0.001 * k, -0.5), 0.001).force_n.z());
  const auto [least, most] = std::minmax_element(force.begin(), force.end());
  EXPECT_NEAR(*most - *least, 0.1 * kTestStiffness, 0.01);
  const double middle = 0.5 * (*most + *least);
  int crossed = 0;
  for (std::size_t k = 1; k < force.size(); ++k) crossed += (force[k] > middle) != (force[k - 1] > middle);
  // y goes to 15 sin 0.4 = 5.8 mm: 2.9 waves.
  EXPECT_GE(crossed, 5);
  EXPECT_LE(crossed, 6);
}

TEST(CloudSmoothHard, AMovingModelIsFeltAsAMovingProbe) {
  TorusSpec t;
  t.points = 20000;
  SceneInput scene = cloud_of(torus_points(t));
  test::Stepped resting = prepared(scene, "cloud-smooth");
  const Vec3 velocity(3.0, -2.0, 10.0), above(kRing, 0.0, kTube + 0.5);
  PoseState start;
  start.velocity_mm_s = velocity;
  scene.models[0].motion = std::make_shared<MovingModel>(start);
  test::Stepped moving = prepared(scene, "cloud-smooth");
  resting->restart(above);
  moving->restart(above);
  int touched = 0;
  for (int k = 1; k <= 100; ++k) {
    const Frame frame = moving->step(above, 0.001);
    const Frame other = resting->step(above - velocity * (0.001 * k), 0.001);
    ASSERT_EQ(frame.contact, other.contact) << k;
    EXPECT_LT((frame.force_n - other.force_n).norm(), 1e-6) << k;
    touched += frame.contact;
  }
  EXPECT_GT(touched, 20);
}

}  // namespace
}  // namespace palpate::render
