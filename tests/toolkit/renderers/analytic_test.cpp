// The ground-truth renderer, against closed forms and against a fine march.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <numbers>

#include <palpate/registry.h>
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/renderers/renderer_infos.h"

namespace palpate::render {
namespace {

constexpr std::uint64_t kSeed = 42;
constexpr double kDt = 1e-3;

SceneInput scene_of(std::shared_ptr<const geometry::AnalyticSurface> surface,
                    geometry::RigidTransform pose = {}) {
  ModelInput model;
  model.name = "model";
  model.analytic = std::move(surface);
  model.world_from_model = pose;
  SceneInput scene;
  scene.models.push_back(model);
  return scene;
}

std::unique_ptr<HapticRenderer> analytic() {
  return analytic_info().make({});
}

void start(HapticRenderer& renderer, const SceneInput& scene, const Vec3& hip) {
  ASSERT_TRUE(renderer.prepare(scene, {}));
  renderer.restart(hip, 0.0);
}

TEST(AnalyticRenderer, PlaneIsASpring) {
  const auto made = analytic();
  HapticRenderer& renderer = *made;
  start(renderer, scene_of(geometry::make_plane(100)), {1, 2, 3});
  Frame f = renderer.step({1, 2, 0.5}, kDt);
  EXPECT_FALSE(f.contact);
  EXPECT_EQ(f.god_object_mm, Vec3(1, 2, 0.5));
  EXPECT_EQ(f.model, -1);
  f = renderer.step({1, 3, -0.5}, kDt);
  EXPECT_TRUE(f.contact);
  EXPECT_EQ(f.model, 0);
  EXPECT_NEAR((f.force_n - Vec3(0, 0, 0.25)).norm(), 0, 1e-15);
  EXPECT_NEAR((f.god_object_mm - Vec3(1, 3, 0)).norm(), 0, 1e-15);
  f = renderer.step({1, 3, 0.001}, kDt);
  EXPECT_FALSE(f.contact);
  EXPECT_EQ(f.force_n, Vec3::Zero());
}

TEST(AnalyticRenderer, NeedsAFormula) {
  const auto made = analytic();
  HapticRenderer& renderer = *made;
  EXPECT_TRUE(test::refused(renderer.prepare(scene_of(nullptr), {}), "no formula"));
}

TEST(AnalyticRenderer, ForceIsLimitedAndTurnsWithThePose) {
  geometry::RigidTransform pose;
  pose.rotation =
      Eigen::AngleAxisd(std::numbers::pi / 2, Vec3::UnitY());  // z of the model becomes x of the world
  pose.translation_mm = {10, 0, 0};
  SceneInput scene = scene_of(geometry::make_plane(100), pose);
  scene.force_limit_n = 3.0;
  const auto made = analytic();
  HapticRenderer& renderer = *made;
  start(renderer, scene, {12, 0, 0});
  Frame f = renderer.step({9, 1, 2}, kDt);
  EXPECT_NEAR((f.force_n - Vec3(0.5, 0, 0)).norm(), 0, 1e-14);
  EXPECT_NEAR((f.god_object_mm - Vec3(10, 1, 2)).norm(), 0, 1e-14);
  f = renderer.step({-20, 1, 2}, kDt);
  EXPECT_NEAR((f.force_n - Vec3(3, 0, 0)).norm(), 0, 1e-13);
}

TEST(AnalyticRenderer, SeveralModelsAddUp) {
  SceneInput scene = scene_of(geometry::make_plane(100));
  ModelInput wall = scene.models[0];
  wall.world_from_model.rotation = Eigen::AngleAxisd(std::numbers::pi / 2, Vec3::UnitY());
  wall.surface.stiffness_n_per_mm = 1.0;
  scene.models.push_back(wall);
  const auto made = analytic();
  HapticRenderer& renderer = *made;
  start(renderer, scene, {1, 0, 1});
  const Frame f = renderer.step({-1, 0, -1}, kDt);
  EXPECT_NEAR((f.force_n - Vec3(1.0, 0, 0.5)).norm(), 0, 1e-14);
  EXPECT_EQ(f.model, 1) << "the one that pushes more";
}

TEST(AnalyticRenderer, HoldsTheEntrySheetThroughAThinSlab) {
  const auto made = analytic();
  HapticRenderer& renderer = *made;
  start(renderer, scene_of(geometry::make_slab(50, 1)), {0, 0, 5});
  for (const double z : {0.4, -0.2, -0.45, -0.6, -3.0, -8.0}) {
    const Frame f = renderer.step({0, 0, z}, kDt);
    ASSERT_TRUE(f.contact) << z;
    EXPECT_NEAR(f.force_n.z(), 0.5 * (0.5 - z), 1e-14);
  }
  EXPECT_FALSE(renderer.step({0, 0, 0.6}, kDt).contact);
  // In one frame from one side to the other and on.
  const Frame f = renderer.step({0, 0, -400}, kDt);
  EXPECT_TRUE(f.contact);
  EXPECT_EQ(f.god_object_mm, Vec3(0, 0, 0.5));
}

TEST(AnalyticRenderer, CrossesAValleyFromOneFaceToTheOther) {
  const auto made = analytic();
  HapticRenderer& renderer = *made;
  start(renderer, scene_of(geometry::make_wedge(300, 100)), {0, 0, 20});
  Frame f = renderer.step({-5, 0, 8}, kDt);  // the left face is at z = 8.66 there
  ASSERT_TRUE(f.contact);
  EXPECT_GT(f.force_n.x(), 0) << "pushed right";
  f = renderer.step({5, 0, 8}, kDt);  // across the free space of the valley into the right face
  ASSERT_TRUE(f.contact);
  EXPECT_LT(f.force_n.x(), 0) << "pushed left";
  f = renderer.step({0, 0, 8}, kDt);
  EXPECT_FALSE(f.contact);
}

TEST(AnalyticRenderer, OneLongFrameEndsWhereManyShortOnesDo) {
  for (const double scale : {1e-3, 1.0, 1e6}) {
    const auto surface = geometry::make_sinusoid(10 * scale, 50 * scale, 100 * scale);
    const auto made = analytic(), made_too = analytic();
    HapticRenderer &coarse = *made, &fine = *made_too;
    const Vec3 top(3 * scale, 4 * scale, 22 * scale);
    start(coarse, scene_of(surface), top);
    start(fine, scene_of(surface), top);
    Vec3 last = top;
    for (int k = 0; k <= 200; ++k) {
      const geometry::SurfacePoint s = surface->at(0.53 + 0.0015 * k, 0.54 + 0.001 * k);
      const Vec3 hip = s.point_mm + scale * (1.2 * std::cos(0.05 * k) - 0.8) * s.normal;
      Frame expected;
      for (int i = 1; i <= 50; ++i) expected = fine.step(last + (hip - last) * (i / 50.0), kDt);
      const Frame found = coarse.step(hip, kDt);
      ASSERT_EQ(found.contact, expected.contact) << k;
      ASSERT_LT((found.god_object_mm - expected.god_object_mm).norm(), 1e-9 * scale) << k;
      if (found.contact) {
        const Vec3 offset = found.god_object_mm - hip;
        ASSERT_LT(offset.cross(surface->closest(found.god_object_mm).normal).norm(),
                  1e-9 * offset.norm() + 1e-13 * scale)
            << k;
        ASSERT_LT((found.god_object_mm - s.point_mm).norm(), 1e-9 * scale) << k;
      }
      last = hip;
    }
  }
}

TEST(AnalyticRenderer, WorksFarFromTheOrigin) {
  geometry::RigidTransform far;
  far.translation_mm = {5e8, -4e9, 1e7};
  const auto made = analytic();
  HapticRenderer& renderer = *made;
  start(renderer, scene_of(geometry::make_sphere(25), far), far.translation_mm + Vec3(0, 0, 30));
  const Frame f = renderer.step(far.translation_mm + Vec3(0, 0, 24), kDt);
  ASSERT_TRUE(f.contact);
  EXPECT_NEAR(f.force_n.z(), 0.5, 1e-9);
}

TEST(AnalyticRenderer, ContactEqualsInsideWhileShallow) {
  // On smooth surfaces a HIP that never goes deep is in contact exactly while it is inside.
  for (const auto& surface : {geometry::make_sphere(25), geometry::make_torus(37, 13),
                              geometry::make_saddle(0.02, 100), geometry::make_sinusoid(10, 50, 100)}) {
    const auto made = analytic();
    HapticRenderer& renderer = *made;
    Random random(kSeed);
    ASSERT_TRUE(renderer.prepare(scene_of(surface), {}));
    bool first = true;
    int contacts = 0;
    for (int k = 0; k < 5000; ++k) {
      const geometry::SurfacePoint s = surface->at(0.3 + 0.00007 * k, 0.3 + 0.00005 * k);
      const double h = first ? 0.5 : 1.1 * std::cos(0.031 * k) + random.uniform(-0.2, 0.2);
      const Vec3 hip = s.point_mm + h * s.normal;
      if (first) renderer.restart(hip, 0.0);
      first = false;
      const Frame f = renderer.step(hip, kDt);
      ASSERT_EQ(f.contact, h < 0) << surface->formula() << " frame " << k << " seed " << kSeed;
      ASSERT_EQ(f.status, FrameStatus::kOk);
      if (f.contact) {
        ++contacts;
        ASSERT_NEAR(f.force_n.norm(), -0.5 * h, 1e-10);
      }
    }
    EXPECT_GT(contacts, 1000);
  }
}

TEST(AnalyticRenderer, NonFiniteHipGivesNoForceAndKeepsTheState) {
  const auto made = analytic();
  HapticRenderer& renderer = *made;
  start(renderer, scene_of(geometry::make_plane(100)), {0, 0, 1});
  (void)renderer.step({0, 0, -1}, kDt);
  const Frame bad = renderer.step({std::numeric_limits<double>::quiet_NaN(), 0, 0}, kDt);
  EXPECT_EQ(bad.status, FrameStatus::kNonFinite);
  EXPECT_EQ(bad.force_n, Vec3::Zero());
  EXPECT_NEAR(renderer.step({0, 0, -2}, kDt).force_n.z(), 1.0, 1e-14) << "still in contact from above";
}

}  // namespace
}  // namespace palpate::render
