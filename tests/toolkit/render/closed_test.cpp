// `cloud` on surfaces that enclose a volume: which side is touched, and what a hole in them may not break.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "toolkit/cloud/generate.h"
#include "toolkit/render/registry.h"

namespace palpate::render {
namespace {

constexpr double kRadius = 50.0;

std::unique_ptr<HapticRenderer> sphere(bool with_hole) {
  const auto model =
      cloud::generate(parse_named_options("sphere:points=20000:extent_mm=100").value()).value();
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < model.cloud.size(); ++i) {
    const Vec3 p = model.cloud.local_mm(i) + model.cloud.origin_mm;
    if (!with_hole || p.x() < 0.98 * kRadius) points.push_back(p);  // the hole is 20 mm wide
  }
  SceneInput scene;
  ModelInput input;
  input.cloud = std::make_shared<cloud::Cloud>(cloud::build_cloud(points, cloud::NonFinite::kRefuse).value());
  scene.models.push_back(input);
  Registry registry;
  register_toolkit_renderers(registry);
  auto renderer = registry.make("cloud", {}).value();
  EXPECT_TRUE(renderer->prepare(scene, {}));
  return renderer;
}

Frame glide(HapticRenderer& renderer, const Vec3& from, const Vec3& to) {
  constexpr int kFrames = 2000;
  Frame frame;
  for (int i = 0; i <= kFrames; ++i)
    frame = renderer.step(from + (to - from) * (static_cast<double>(i) / kFrames), 1e-3);
  return frame;
}

TEST(ClosedCloud, IsTouchedFromOutside) {
  const auto cloud = sphere(false);
  cloud->reset(Vec3(0, 0, kRadius + 5));
  const Frame frame = glide(*cloud, Vec3(0, 0, kRadius + 5), Vec3(0, 0, kRadius - 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_GT(frame.force_n.z(), 0.0);
}

TEST(ClosedCloud, IsTouchedFromInsideWhereTheHipStartsInside) {
  const auto cloud = sphere(false);
  cloud->reset(Vec3(0, 0, 10));
  Frame frame = glide(*cloud, Vec3(0, 0, 10), Vec3(0, 0, kRadius + 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_LT(frame.force_n.z(), 0.0);
  frame = glide(*cloud, Vec3(0, 0, kRadius + 1), Vec3(0, 0, 20));
  EXPECT_FALSE(frame.contact);
  EXPECT_EQ(frame.force_n, Vec3::Zero());
}

// In by the hole, out through the surface, and everything is as it was before.
TEST(ClosedCloud, AHoleDoesNotTurnItInsideOut) {
  const auto cloud = sphere(true);
  const Vec3 before(kRadius + 10, 0, 0), middle(0, 0, 0), above(0, 0.3, kRadius + 5);
  cloud->reset(before);
  Frame frame = glide(*cloud, before, middle);
  EXPECT_FALSE(frame.contact);
  frame = glide(*cloud, middle, above);
  EXPECT_FALSE(frame.contact);
  frame = glide(*cloud, above, Vec3(0, 0.3, kRadius - 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_GT(frame.force_n.z(), 0.0);
  EXPECT_NEAR(frame.force_n.norm(), 0.5, 0.02);  // 1 mm at the default 0.5 N/mm
}

}  // namespace
}  // namespace palpate::render
