// Mesh renderers in scenes: several models, moving ones, properties that vary, friction, thin things.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "tests/baselines/small_models.h"

namespace palpate::baselines {
namespace {

using test::expect_near;
using test::kStiffness;
using test::Probe;

constexpr double kRadius = 0.25;
constexpr const char* kPoint = "mesh-godobject:mesh=original";
constexpr const char* kSkin = "mesh-proxy:mesh=original:radius_mm=0.25";
constexpr const char* kCentre = "mesh-proxy:mesh=original:radius_mm=0.25:tip=centre";

render::ModelInput box_at(const Vec3& half, const geometry::RigidTransform& pose) {
  render::ModelInput model =
      test::model_of(test::subdivided(test::box_mesh(half.x(), half.y(), half.z()), 2));
  model.world_from_model = pose;
  return model;
}

geometry::RigidTransform shifted(const Vec3& by) {
  return {Eigen::Quaterniond::Identity(), by};
}

/// A floor z < 0, and walls x < 0 and y < 0 where asked for, as models of their own.
render::SceneInput room(int models) {
  render::SceneInput scene;
  const Vec3 half{10, 10, 10};
  scene.models.push_back(box_at(half, shifted({5.3, 5.1, -10})));
  if (models > 1) scene.models.push_back(box_at(half, shifted({-10, 5.2, 5.4})));
  if (models > 2) scene.models.push_back(box_at(half, shifted({5.5, -10, 5.6})));
  return scene;
}

TEST(MeshScene, TwoModelsHoldInTheirEdgeAndThreeInTheirCorner) {
  const Vec3 hip{-0.6, -0.8, -0.5};
  for (const int models : {1, 2, 3}) {
    const Vec3 corner{models > 1 ? 0.0 : hip.x(), models > 2 ? 0.0 : hip.y(), 0.0};
    const Vec3 start{2, models > 2 ? 2.0 : hip.y(), 2};
    for (const char* options : {kPoint, kSkin, kCentre}) {
      SCOPED_TRACE(options);
      Probe probe = test::prepare(room(models), options);
      const render::Frame frame = probe.press(start, hip, 0.05);
      Vec3 expected = corner;
      if (options != kPoint) {  // the centre, and from there a radius towards the HIP
        const Vec3 centre = corner + kRadius * Vec3(models > 1, models > 2, 1);
        expected = options == kCentre ? centre : Vec3(centre + kRadius * (hip - centre).normalized());
      }
      test::expect_held(frame, expected, 1e-9);
      expect_near(frame.force_n, kStiffness * (expected - hip), 1e-9);
    }
  }
}

// Eleven blocks, their tops one above the other: the deepest eight answer, and the frame says so.
TEST(MeshScene, OfMoreThanEightTouchedTheDeepestAnswer) {
  render::SceneInput scene;
  for (int i = 0; i < 11; ++i)
    scene.models.push_back(box_at({10, 10, 10}, shifted({0.1 * i, 0.3, -10 + 0.05 * i})));
  const Vec3 start{0.1, 0.3, 4}, hip{0.05, 0.3, -1};
  Probe probe = test::prepare(scene, kPoint);
  const render::Frame frame = probe.press(start, hip, 0.05);
  ASSERT_TRUE(frame.contact);
  expect_near(frame.force_n, Vec3(0, 0, kStiffness * 1.5), 1e-9);
  EXPECT_EQ(frame.model, 10);
  EXPECT_EQ(frame.status, render::FrameStatus::kBoundHit);
}

// Two blocks lean towards each other: the sum of their pushes is too much, jointly they hold the nearest
// place outside of both.
TEST(MeshScene, JointContactIsOutsideOfAllAndTheSumIsNot) {
  render::SceneInput scene;
  for (const double angle : {0.5, -0.5}) {  // of the top faces, towards the valley
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(-angle, Vec3::UnitY()));
    scene.models.push_back(box_at({10, 10, 10}, {turn, turn * Vec3(0, 0, -10)}));
  }
  // Both tops go through the origin; their normals are (-+ sin 0.5, 0, cos 0.5).
  const Vec3 start{0.1, 0.3, 4}, hip{0.05, 0.3, -1};
  Probe joint = test::prepare(scene, kPoint);
  const render::Frame frame = joint.press(start, hip, 0.02);
  expect_near(frame.god_object_mm, {0, 0.3, 0}, 1e-9);
  expect_near(frame.force_n, kStiffness * (Vec3(0, 0.3, 0) - hip), 1e-9);
  Probe sum = test::prepare(scene, "mesh-godobject:mesh=original:combine=sum");
  // Each pushes by its depth along its normal: together 2 cos^2(0.5) = 1.54 times upwards.
  EXPECT_NEAR(sum.press(start, hip, 0.02).force_n.z(), 2 * kStiffness * std::pow(std::cos(0.5), 2), 1e-6);
}

// Two curved models, one mesh: the joint rest is outside of both and cannot be bettered nearby.
TEST(MeshScene, CurvedModelsMeetInAValley) {
  const auto ball = test::height_mesh(200, 10.0, [](double x, double y) { return -0.05 * (x * x + y * y); });
  render::SceneInput scene;
  for (const double side : {1.0, -1.0}) {
    scene.models.push_back(test::model_of(ball));
    scene.models.back().world_from_model = {Eigen::Quaterniond(Eigen::AngleAxisd(side * -0.7, Vec3::UnitY())),
                                            Vec3(side * 3.0, 0, 0)};
  }
  for (const char* options : {kPoint, kCentre}) {
    Probe probe = test::prepare(scene, options);
    std::vector<Probe> alone;
    for (const auto& model : scene.models) alone.push_back(test::prepare(model, options));
    const Vec3 start{0.1, 0.4, 6}, hip{0.2, 0.5, -4.5};
    render::Frame frame = probe.press(start, hip, 0.02);
    for (int i = 0; i < 5; ++i) frame = probe.to(hip);
    ASSERT_TRUE(frame.contact);
    // Each model alone lets a probe at that place stay there, but for curvature's second order that is left.
    for (Probe& one : alone) {
      const Vec3 there = one.press(start, frame.god_object_mm, 0.02).god_object_mm;
      expect_near(there, frame.god_object_mm, 2e-3);
    }
    EXPECT_GT(frame.force_n.z(), 0.0);
  }
}

// A thousand models answer what the one that is touched answers alone, bit for bit.
TEST(MeshScene, FarModelsChangeNothing) {
  render::SceneInput one, many;
  one.models.push_back(box_at({5, 5, 5}, shifted({0.1, 0.2, 0.3})));
  many.models = one.models;
  for (int i = 0; i < 999; ++i) {
    many.models.push_back(one.models[0]);
    many.models.back().world_from_model.translation_mm +=
        Vec3(30.0 * (1 + i % 10), 30.0 * (i / 10 % 10), 30.0 * (i / 100));
  }
  for (const char* options : {kPoint, kSkin}) {
    Probe few = test::prepare(one, options), crowd = test::prepare(many, options);
    few.renderer->restart({0, 0, 20});
    crowd.renderer->restart({0, 0, 20});
    std::size_t touched = 0;
    for (int i = 0; i < 4000; ++i) {
      const double t = i * 1e-3;
      const Vec3 hip{7 * std::sin(3 * t), 7 * std::sin(2 * t + 1), 12 * std::cos(8 * t)};
      const render::Frame a = few.to(hip), b = crowd.to(hip);
      touched += a.contact;
      ASSERT_EQ(a.contact, b.contact) << i;
      ASSERT_LT((a.god_object_mm - b.god_object_mm).norm(), 1e-12) << i;
      ASSERT_LT((a.force_n - b.force_n).norm(), 1e-12) << i;
    }
    EXPECT_GT(touched, 500u);
    // And the neighbour is met where the HIP goes there.
    EXPECT_TRUE(crowd.press({30.1, 0, 20}, {30.1, 0, 5}, 1.0).contact);
  }
}

TEST(MeshScene, AModelThatMovesMeetsAHipThatRests) {
  for (const char* options : {kPoint, kSkin}) {
    auto simulation = std::make_shared<render::ScriptedSimulation>();
    render::SceneInput scene;
    scene.models.push_back(box_at({5, 5, 5}, shifted({0, 0, -10})));
    render::ScriptedMotion motion;
    motion.start = shifted({0, 0, -10});
    motion.velocity_mm_s = {0, 0, 20};
    scene.models[0].motion = simulation->add(motion);
    scene.simulation = simulation;
    Probe probe = test::prepare(scene, options);
    probe.renderer->drive(simulation);
    probe.renderer->restart({0.3, 0.2, 1});
    render::Frame frame;
    for (int i = 0; i < 400; ++i) frame = probe.to({0.3, 0.2, 1});
    // After 0.4 s the top is at -10 + 8 + 5 = 3.
    test::expect_held(frame, {0.3, 0.2, 3.0}, 1e-6);
  }
}

/// A plane whose stiffness and friction rise with x from point to point.
render::SceneInput graded_plane(bool friction) {
  render::SceneInput scene;
  scene.models.push_back(test::model_of(test::flat_mesh(40, 10.0)));
  auto properties = std::make_shared<surface::PointProperties>();
  for (std::size_t i = 0; i < scene.models[0].cloud->size(); ++i) {
    const double x = scene.models[0].cloud->point_mm(i).x();
    properties->stiffness_n_per_mm.push_back(static_cast<float>(0.5 + 0.02 * x));
    if (friction) properties->static_friction.push_back(static_cast<float>(0.5 + 0.03 * x));
  }
  scene.models[0].surface.per_point = properties;
  return scene;
}

TEST(MeshScene, PropertiesAreInterpolatedOverFacets) {
  for (const char* options : {kPoint, kSkin}) {
    Probe probe = test::prepare(graded_plane(false), options);
    probe.renderer->restart({-7, 0.3, 1});
    for (double x = -7; x < 7; x += 0.0371) {
      const render::Frame frame = probe.to({x, 0.3, -1});
      ASSERT_TRUE(frame.contact);
      ASSERT_NEAR(frame.force_n.z(), 0.5 + 0.02 * x, 1e-6) << x;
      // The potential's part along the surface: -d^2 / 2 of the stiffness's slope.
      ASSERT_NEAR(frame.force_n.x(), -0.5 * 0.02, 1e-6) << x;
    }
  }
}

TEST(MeshScene, FrictionFollowsItsConeAndItsPlace) {
  for (const char* options : {kPoint, kSkin}) {
    Probe probe = test::prepare(graded_plane(true), options);
    probe.press({-7, 0.3, 1}, {-7, 0.3, -1}, 0.05);
    // The coefficient is read at the frictionless contact: at every place of the slip the ratio is its own.
    for (double x = -7; x < 7; x += 0.05) {
      const render::Frame frame = probe.to({x, 0.3, -1});
      if (x < -5.5) continue;  // sticks at first
      const double gradient = -0.5 * 0.02 * (1 + std::pow(0.5 + 0.03 * x, 2));
      ASSERT_NEAR((frame.force_n.x() - gradient) / frame.force_n.z(), -(0.5 + 0.03 * x), 2e-3) << x;
    }
  }
  // Uniform friction on tilted ground: in slip exactly dynamic x normal, on a facet's plane.
  render::SceneInput tilted;
  tilted.models.push_back(
      test::model_of(test::height_mesh(30, 10.0, [](double x, double) { return 0.5 * x; })));
  tilted.models[0].surface.friction = {0.7, 0.4};
  const Vec3 n = Vec3(-0.5, 0, 1).normalized();
  for (const char* options : {kPoint, kSkin}) {
    Probe probe = test::prepare(tilted, options);
    probe.press({0, -5, 3}, {0.2, -5, -1}, 0.05);
    const render::Frame frame = probe.glide({0.2, -5, -1}, {0.2, 5, -1}, 0.05);
    const double normal = n.dot(frame.force_n);
    EXPECT_NEAR((frame.force_n - normal * n).norm(), 0.4 * normal, 1e-9);
  }
}

// Without friction a closed way over stiffness that varies gives no work.
TEST(MeshScene, VaryingStiffnessMakesNoEnergy) {
  for (const char* options : {kPoint, kSkin}) {
    Probe probe = test::prepare(graded_plane(false), options);
    probe.press({5, 0, 1}, {5, 0, -1}, 0.05);
    double work = 0.0, moved = 0.0;
    constexpr int kSteps = 20'000;
    const auto at = [](int i) {
      const double t = 2 * 3.14159265358979323846 * i / kSteps;
      return Vec3(5 * std::cos(t), 5 * std::sin(t), -1 - 0.5 * std::sin(3 * t));
    };
    Vec3 force = probe.to(at(0)).force_n;
    for (int i = 1; i <= kSteps; ++i) {
      const Vec3 next = probe.to(at(i)).force_n;
      const double part = 0.5 * (force + next).dot(at(i) - at(i - 1));
      work += part;
      moved += std::abs(part);
      force = next;
    }
    EXPECT_LT(std::abs(work), 1e-4 * moved);
  }
}

// Thin slabs at any speed and slant: the god object of a HIP beyond is on the face that it came in by.
TEST(MeshScene, NothingPassesThinSlabs) {
  constexpr std::uint64_t kSeed = 5;
  Random random(kSeed);
  for (const double thickness : {1.0, 0.3, 0.1, 0.03, 0.01}) {
    const auto slab = test::subdivided(test::box_mesh(20, 20, thickness / 2), 3);
    for (const std::string options :
         {kPoint, kSkin, "mesh-proxy:mesh=original:radius=0.01", "mesh-proxy:mesh=original:radius_mm=1e-4",
          "mesh-proxy:mesh=original:radius_mm=0.1", "mesh-proxy:mesh=original:radius_mm=1"}) {
      Probe probe = test::make(slab, options);
      for (const double step : {0.005, 0.05, 0.5, 1.0, 5.0})
        for (int i = 0; i < 20; ++i) {
          SCOPED_TRACE(testing::Message()
                       << options << ", " << thickness << ", " << step << ", seed " << kSeed);
          const double side = i % 2 == 0 ? 1.0 : -1.0;
          const Vec3 from{random.uniform(-10, 10), random.uniform(-10, 10), 3 * side};
          const Vec3 to{random.uniform(-10, 10), random.uniform(-10, 10), -2.5 * side};
          probe.press(from, to, step);
          for (int k = 0; k < 49; ++k) (void)probe.to(to);
          test::expect_held(probe.to(to), {to.x(), to.y(), side * thickness / 2}, 1e-8);
        }
    }
  }
}

}  // namespace
}  // namespace palpate::baselines
