// The renderer of docs/tutorials/your-renderer.md works, and the page prints it as it is.
#include "tests/house/example_renderer.h"
#include "tests/stepped.h"

#include <gtest/gtest.h>

#include <limits>

#include <palpate/cloud.h>
#include "tests/house/source_tree.h"

namespace palpate::example {
namespace {

std::shared_ptr<const cloud::Cloud> corners_of_a_cube() {
  std::vector<Vec3> points;
  for (int i = 0; i < 8; ++i)
    points.emplace_back(i & 1 ? 10.0 : -10.0, i & 2 ? 10.0 : -10.0, i & 4 ? 10.0 : -10.0);
  auto built = cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  return std::make_shared<const cloud::Cloud>(std::move(built).value());
}

test::Stepped ball(double size, const Vec3& at_mm) {
  render::Registry registry;
  register_ball(registry);
  Options options;
  options.set("size", std::to_string(size));
  auto made = registry.make("ball", options);
  EXPECT_TRUE(made.ok());
  render::SceneInput scene;
  scene.force_limit_n = 3.0;
  scene.models.resize(1);
  scene.models[0].cloud = corners_of_a_cube();
  scene.models[0].surface.stiffness_n_per_mm = 0.5;
  scene.models[0].world_from_model.translation_mm = at_mm;
  EXPECT_TRUE((*made)->prepare(scene, {}).ok());
  return test::Stepped(std::move(made).value());
}

TEST(ExampleRenderer, PushesOutOfTheBall) {
  const Vec3 at_mm(100.0, 0.0, 0.0);
  auto renderer = ball(1.0, at_mm);  // radius 10
  renderer->restart(at_mm + Vec3(0.0, 0.0, 20.0));

  const render::Frame free = renderer->step(at_mm + Vec3(0.0, 0.0, 10.5), 1e-3);
  EXPECT_FALSE(free.contact);
  EXPECT_EQ(free.force_n, Vec3(Vec3::Zero()));

  const render::Frame in = renderer->step(at_mm + Vec3(0.0, 0.0, 8.0), 1e-3);
  EXPECT_TRUE(in.contact);
  EXPECT_EQ(in.model, 0);
  EXPECT_NEAR(in.force_n.z(), 1.0, 1e-12);  // 2 mm deep at 0.5 N/mm
  EXPECT_NEAR((in.god_object_mm - at_mm).z(), 10.0, 1e-12);

  const render::Frame deep = renderer->step(at_mm + Vec3(0.0, 0.0, 1.0), 1e-3);
  EXPECT_NEAR(deep.force_n.norm(), 3.0, 1e-12) << "the scene's force limit";
  EXPECT_EQ(renderer->counters().frames, 3u);
}

TEST(ExampleRenderer, AnswersNonsenseWithoutForce) {
  auto renderer = ball(1.0, Vec3::Zero());
  const render::Frame frame = renderer->step(Vec3(std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0), 1e-3);
  EXPECT_EQ(frame.status, render::FrameStatus::kNonFinite);
  EXPECT_EQ(frame.force_n, Vec3(Vec3::Zero()));
}

TEST(ExampleRenderer, OptionsAreChecked) {
  render::Registry registry;
  register_ball(registry);
  Options wrong;
  wrong.set("sise", "2");
  EXPECT_FALSE(registry.make("ball", wrong).ok());
  EXPECT_FALSE(registry.make("bal", {}).ok());
}

TEST(Examples, PagesPrintTheirCodeAsItIs) {
  for (const auto& [page, file] : {std::pair{"your-renderer.md", "tests/house/example_renderer.cpp"},
                                   std::pair{"your-device.md", "device/simulated/packet_device.h"},
                                   std::pair{"your-device.md", "device/simulated/packet_device.cpp"}}) {
    const std::string code = house::text_of(file);
    ASSERT_FALSE(code.empty());
    EXPECT_NE(house::text_of(std::string("docs/tutorials/") + page).find("```cpp\n" + code + "```\n"),
              std::string::npos)
        << "docs/tutorials/" << page << " must print " << file;
  }
}

}  // namespace
}  // namespace palpate::example
