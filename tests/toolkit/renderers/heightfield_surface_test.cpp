// Friction, deformation and texture on height fields: the shared stage, read from the posts.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "tests/stepped.h"
#include "toolkit/render/registry.h"
#include "toolkit/renderers/toolkit_renderers.h"

namespace palpate::render {
namespace {

constexpr std::size_t kSide = 41;
constexpr double kStiffness = 0.5;

/// A plane of the given slope in x, posts 0.25 mm apart.
SceneInput tilted(double slope) {
  std::vector<Vec3> points;
  for (std::size_t row = 0; row < kSide; ++row)
    for (std::size_t column = 0; column < kSide; ++column) {
      const double x = 0.25 * static_cast<double>(column);
      points.emplace_back(x, 0.25 * static_cast<double>(row), slope * x);
    }
  SceneInput scene;
  ModelInput input;
  input.cloud = std::make_shared<cloud::Cloud>(cloud::build_cloud(points, cloud::NonFinite::kRefuse).value());
  input.surface.stiffness_n_per_mm = kStiffness;
  scene.models.push_back(input);
  return scene;
}

test::Stepped stepped_field(const SceneInput& scene, const char* name = "heightfield") {
  Registry registry;
  register_toolkit_renderers(registry);
  auto renderer = registry.make(name, Options{}).value();
  const auto report = renderer->prepare(scene, {1, nullptr});
  EXPECT_TRUE(report) << (report ? "" : report.error().message());
  return renderer;
}

TEST(HeightFieldSurface, SlipHasTheDynamicCoefficientStickDoesNotDrift) {
  for (const double slope : {0.0, 0.75}) {
    SceneInput scene = tilted(slope);
    scene.models[0].surface.friction = {0.5, 0.3};
    const auto renderer = stepped_field(scene);
    const Vec3 normal = Vec3(-slope, 0.0, 1.0).normalized(), along = Vec3(1.0, 0.0, slope).normalized();
    const Vec3 start = Vec3(3.0, 5.0, slope * 3.0) - normal;
    renderer->restart(start + 3.0 * normal);
    for (int i = 60; i >= 0; --i) (void)renderer->step(start + 0.05 * i * normal, 1e-3);
    Frame frame;
    for (int i = 0; i < 400; ++i) frame = renderer->step(start + 0.01 * i * along, 1e-3);
    const double push = frame.force_n.dot(normal), drag = -frame.force_n.dot(along);
    EXPECT_NEAR(push, kStiffness, 1e-4);
    EXPECT_NEAR(drag / push, 0.3, 1e-4);
    // Back a little: it sticks, and stays where it is for ten minutes.
    const Vec3 rest = start + 3.8 * along;
    const Vec3 held = renderer->step(rest, 1e-3).god_object_mm;
    for (int i = 0; i < 600000; ++i) frame = renderer->step(rest, 1e-3);
    EXPECT_EQ(frame.god_object_mm, held);
  }
}

TEST(HeightFieldSurface, DeformationSoftensAndItsBorderMakesNoEnergy) {
  SceneInput scene = tilted(0.0);
  auto properties = std::make_shared<surface::PointProperties>();
  for (std::size_t i = 0; i < kSide * kSide; ++i)
    properties->deformation.push_back(i % kSide < kSide / 2 ? 0.5f : 0.0f);
  scene.models[0].surface.per_point = properties;
  const auto renderer = stepped_field(scene);
  const auto force_at = [&](double x) {
    renderer->restart({x, 5.0, 1.0});
    (void)renderer->step({x, 5.0, 1.0}, 1e-3);
    return renderer->step({x, 5.0, -1.0}, 1e-3).force_n;
  };
  EXPECT_NEAR(force_at(1.0).z(), 0.5 * kStiffness, 1e-6);
  EXPECT_NEAR(force_at(9.9).z(), kStiffness, 1e-6);
  // To and fro over the border at one depth, and round by another: the work of a closed way is none.
  Vec3 at(1.0, 5.0, -0.5);
  renderer->restart({1.0, 5.0, 1.0});
  (void)renderer->step({1.0, 5.0, 1.0}, 1e-3);
  Vec3 force = renderer->step(at, 1e-3).force_n;
  double work = 0.0, most = 0.0;
  for (const Vec3& to :
       {Vec3(9.0, 5.0, -0.5), Vec3(9.0, 5.0, -1.5), Vec3(1.0, 5.0, -1.5), Vec3(1.0, 5.0, -0.5)}) {
    constexpr int kSteps = 4000;
    const Vec3 step = (to - at) / kSteps;
    for (int i = 0; i < kSteps; ++i) {
      at += step;
      const Vec3 next = renderer->step(at, 1e-3).force_n;
      work += 0.5 * (force + next).dot(step);
      force = next;
      most = std::max(most, std::abs(work));
    }
  }
  EXPECT_GT(most, 0.1);
  EXPECT_NEAR(work, 0.0, 0.01 * most);
}

TEST(HeightFieldSurface, ALiteralGodObjectIsRolledBack) {
  SceneInput scene = tilted(0.0);
  scene.models[0].surface.friction = {1.0, 1.0};
  const auto renderer = stepped_field(scene, "heightfield-literal");
  renderer->restart({3.0, 5.0, 1.0});
  (void)renderer->step({3.0, 5.0, -1.0}, 1e-3);
  const Frame frame = renderer->step({5.0, 5.0, -1.0}, 1e-3);
  EXPECT_NEAR(frame.god_object_mm.x(), 4.0, 1e-6) << "one depth behind the HIP";
}

// Section 3.3.1: a plane that rises past a still probe is felt in every frame from then on.
TEST(HeightFieldSurface, ARisingPlaneIsNeverLost) {
  for (const double speed : {5.0, 50.0, 500.0})
    for (int run = 0; run < 20; ++run) {
      SceneInput scene = tilted(0.0);
      auto simulation = std::make_shared<ScriptedSimulation>();
      ScriptedMotion motion;
      motion.start.translation_mm = Vec3(-5.0, -5.0, -1.0);
      motion.velocity_mm_s = Vec3(0.0, 0.0, speed);
      motion.stop_s = 3.0 / speed;
      scene.models[0].world_from_model = motion.start;
      scene.models[0].motion = simulation->add(motion);
      scene.simulation = simulation;
      const auto renderer = stepped_field(scene);
      const Vec3 probe(0.037 * run, 0.021 * run, 0.0);
      simulation->reset();
      renderer->restart(probe);
      Frame frame;
      int lost = 0;
      for (int i = 1; i < 2 * static_cast<int>(3000.0 / speed) + 100; ++i) {
        simulation->advance(1e-3 * i);
        const bool before = frame.contact;
        frame = renderer->step(probe, 1e-3);
        lost += before && !frame.contact;
      }
      EXPECT_EQ(lost, 0) << speed;
      EXPECT_TRUE(frame.contact);
      EXPECT_NEAR(frame.force_n.z(), kStiffness * 2.0, 0.02 * speed * kStiffness);
    }
}

TEST(HeightFieldSurface, ValuesThatMakeNoSenseAreRefused) {
  SceneInput scene = tilted(0.0);
  auto properties = std::make_shared<surface::PointProperties>();
  properties->stiffness_n_per_mm.assign(7, 1.0f);
  scene.models[0].surface.per_point = properties;
  Registry registry;
  register_toolkit_renderers(registry);
  for (const char* name : {"heightfield", "heightfield-literal"})
    EXPECT_FALSE(registry.make(name, Options{}).value()->prepare(scene, {}));
}

}  // namespace
}  // namespace palpate::render
