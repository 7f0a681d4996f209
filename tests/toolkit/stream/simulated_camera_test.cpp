#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <string>

#include <palpate/generate.h>
#include "tests/toolkit/messages.h"
#include "toolkit/render/depth_camera.h"
#include "toolkit/stream/simulated_camera.h"
#include "toolkit/stream/stream_statistics.h"

namespace palpate::stream {
namespace {

using palpate::test::contains;
using palpate::test::refused;
using palpate::test::value_of;

/// An eighth of VGA, so that a frame takes two milliseconds.
const std::string kSmall = ":width=80:height=60";

std::unique_ptr<DepthSource> opened(const std::string& spec) {
  return value_of(open_simulated_camera(spec + kSmall));
}
DepthFrame next_of(DepthSource& source) {
  DepthFrame frame;
  EXPECT_TRUE(value_of(source.next(frame)));
  return frame;
}
std::unique_ptr<SimulatedScene> scene_of(const std::string& name) {
  return value_of(SimulatedScene::make(std::move(value_of(stock_scene(name)).scene)));
}
/// Multiples of `direction` to the first hit, 0 for none: a depth where its z in the camera's frame is 1.
double depth_along(const SimulatedScene& scene, const Vec3& origin_mm, const Vec3& direction) {
  const std::optional<SceneHit> hit = scene.first_hit(origin_mm, direction);
  return hit ? hit->along : 0.0;
}
double share_of_holes(const DepthFrame& frame) {
  return static_cast<double>(std::count(frame.depth_mm.begin(), frame.depth_mm.end(), 0.0f)) /
         static_cast<double>(frame.depth_mm.size());
}

TEST(SimulatedScene, RaysMeetWhatTheFormulasSay) {
  const auto scene = scene_of("table");
  // Straight down beside everything, on the sphere's top, on the box's.
  EXPECT_NEAR(depth_along(*scene, {500.0, 0.0, 800.0}, {0.0, 0.0, -2.0}), 400.0, 1e-9);
  EXPECT_NEAR(depth_along(*scene, {-120.0, 0.0, 800.0}, {0.0, 0.0, -1.0}), 740.0, 1e-9);
  EXPECT_NEAR(depth_along(*scene, {130.0, 0.0, 800.0}, {0.0, 0.0, -1.0}), 700.0, 1e-9);
  EXPECT_EQ(depth_along(*scene, {0.0, 0.0, 800.0}, Vec3::UnitZ()), 0.0);
  const auto hit = scene->first_hit({-300.0, 0.0, 36.0}, Vec3::UnitX());
  ASSERT_TRUE(hit);
  EXPECT_NEAR(hit->along, 132.0, 1e-9);
  EXPECT_LT((hit->normal - Vec3(-0.8, 0.0, 0.6)).norm(), 1e-9);
}

TEST(SimulatedScene, ModelsStandWhereTheyAreAtATimeAlsoBackwards) {
  const auto scene = scene_of("moving-wall");
  for (const double t_s : {0.0, 0.25, 0.4004, 7.75, 0.1}) {
    scene->go_to(t_s);
    // Poses are published each millisecond; between two, the wall is off by its acceleration, 2000 mm/s^2.
    EXPECT_NEAR(1000.0 - depth_along(*scene, {0.0, 0.0, 1000.0}, -Vec3::UnitZ()),
                50.0 * std::sin(2.0 * M_PI * t_s), 1e-3)
        << t_s;
  }
}

TEST(SimulatedScene, FacesAreSeenAndPointsAreNot) {
  auto generated =
      value_of(cloud::generate(value_of(parse_named_options("sphere:points=20000:extent_mm=100"))));
  render::ModelInput model;
  model.name = "ball";
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(generated.cloud));
  render::SceneInput input;
  input.models.push_back(model);
  EXPECT_TRUE(refused(SimulatedScene::make(input), "'ball'", "faces"));
  input.models[0].original_mesh = generated.original_mesh;
  input.models[0].world_from_model.translation_mm = {0.0, 0.0, 10.0};
  const auto scene = value_of(SimulatedScene::make(input));
  // A facet's chord lies below the sphere by less than its edge squared over 8 radii.
  EXPECT_NEAR(depth_along(*scene, {3.0, 2.0, 500.0}, -Vec3::UnitZ()), 440.0 + 13.0 / 100.0, 0.02);
}

TEST(SimulatedCamera, WithoutErrorsItSeesTheTruth) {
  const std::string spec = "table:sensor=ideal";
  const auto source = opened(spec);
  const DepthFrame frame = next_of(*source);
  const auto scene = scene_of("table");
  const DepthCamera& camera = source->camera();
  for (int v = 0; v < camera.height; v += 7)
    for (int u = 0; u < camera.width; u += 7) {
      const Vec3 ray = frame.world_from_camera.rotate(render::ray_of(camera, u, v));
      EXPECT_FLOAT_EQ(frame.depth_mm[static_cast<std::size_t>(v * camera.width + u)],
                      static_cast<float>(depth_along(*scene, frame.world_from_camera.translation_mm, ray)));
    }
  EXPECT_EQ(frame.captured_s, 0.0);
  // The table below the camera, at 990 mm in the middle of the image, is nearer at its lower border.
  EXPECT_LT(frame.depth_mm[59 * 80 + 5], frame.depth_mm[5]);
}

TEST(SimulatedCamera, NoiseIsWhatTheCameraStates) {
  const auto source = opened("wall:frames=12:lateral_px=0:baseline_mm=0:flying=0:dropout=0:noise_mm=2");
  EXPECT_NEAR(source->camera().noise_at_mm(1000.0), 2.0, 1e-12);
  const StreamStatistics seen = value_of(measure_stream(*source));
  EXPECT_EQ(seen.frames, 12u);
  ASSERT_EQ(seen.noise.size(), 1u) << "the wall is a metre away everywhere";
  EXPECT_NEAR(seen.noise[0].temporal_mm, 2.0, 0.1);
  EXPECT_NEAR(seen.noise[0].spatial_mm, 2.0, 0.1);
  EXPECT_NEAR(seen.noise_mm + 1e6 * seen.noise_per_mm, 2.0, 0.1);
  EXPECT_NEAR(seen.rate_hz, 30.0, 1e-6);
  EXPECT_NEAR(seen.latency_s, 0.020, 0.001);
  EXPECT_NEAR(seen.latency_jitter_s, 0.001, 0.0005);
  EXPECT_EQ(seen.holes, 0.0);
}

TEST(SimulatedCamera, NoiseGrowsWithTheSquareOfDepth) {
  const auto source = opened("table:frames=20:lateral_px=0:baseline_mm=0:flying=0:dropout=0:noise_mm=4");
  const StreamStatistics seen = value_of(measure_stream(*source));
  ASSERT_GT(seen.noise.size(), 4u);
  EXPECT_NEAR(1e6 * seen.noise_per_mm, 4.0, 0.3);
  EXPECT_LT(seen.noise_mm, 0.3);
  EXPECT_FALSE(seen.moves);
}

TEST(SimulatedCamera, DisparitiesAreWholeSteps) {
  const auto source = opened("wall:noise_mm=2:disparity_step_px=0.125:baseline_mm=75");
  const DepthFrame frame = next_of(*source);
  std::set<float> depths(frame.depth_mm.begin(), frame.depth_mm.end());
  depths.erase(0.0f);
  const double steps = source->camera().fx_px * 75.0 / 0.125;
  for (const float z : depths) {
    const double at = steps / static_cast<double>(z);
    EXPECT_NEAR(at, std::round(at), 1e-4);
  }
  EXPECT_LT(depths.size(), 20u);
}

TEST(SimulatedCamera, EachErrorMakesItsOwnHoles) {
  const std::string none = ":noise_mm=0:lateral_px=0:disparity_step_px=0";
  const auto holes = [&](const std::string& options) { return share_of_holes(next_of(*opened(options))); };
  EXPECT_EQ(holes("table" + none + ":baseline_mm=0:flying=0:grazing_deg=0:dropout=0"), 0.0);
  EXPECT_NEAR(holes("table" + none + ":baseline_mm=0:flying=0:grazing_deg=0:dropout=0.2"), 0.2, 0.02);
  // The projector's shadow beside box and sphere is narrow: they reach into the table.
  const double shadow = holes("table" + none + ":baseline_mm=75:flying=0:grazing_deg=0:dropout=0");
  EXPECT_GT(shadow, 0.0);
  EXPECT_GT(holes("table" + none + ":baseline_mm=300:flying=0:grazing_deg=0:dropout=0"), shadow);
  // The camera looks down at 45 degrees: beyond 60 the far part of the table is gone.
  EXPECT_GT(holes("table" + none + ":baseline_mm=0:flying=0:grazing_deg=60:dropout=0"), 0.05);
}

TEST(SimulatedCamera, PixelsFlyBetweenFrontAndBackOfAnEdge) {
  const std::string none = "step:noise_mm=0:lateral_px=0:disparity_step_px=0:baseline_mm=0:dropout=0";
  const auto wide = [&none](const std::string& options) {
    return value_of(open_simulated_camera(none + options + ":width=640:height=60"));
  };
  const auto between = [](const DepthFrame& frame) {
    return std::count_if(frame.depth_mm.begin(), frame.depth_mm.end(),
                         [](float z) { return z > 960.5f && z < 999.5f; });
  };
  EXPECT_EQ(between(next_of(*wide(":flying=0"))), 0);
  const auto some = between(next_of(*wide(":flying=0.5")));
  EXPECT_GT(some, 20);
  EXPECT_LT(some, 120) << "two columns of sixty, half of them";
}

TEST(SimulatedCamera, IsTheSameForASeedAndAnyThreads) {
  const auto made = [](int threads, std::uint64_t seed) {
    StockScene stock = value_of(stock_scene("hand" + kSmall));
    stock.simulated.seed = seed;
    return make_simulated_camera(
        value_of(SimulatedScene::make(std::move(stock.scene))), stock.camera,
        [pose = stock.world_from_camera](double) { return pose; }, stock.simulated, "test", threads);
  };
  const auto one = made(1, 1), two = made(2, 1), other = made(1, 2);
  const DepthFrame first = next_of(*one);
  EXPECT_EQ(first.depth_mm, next_of(*two).depth_mm);
  EXPECT_NE(first.depth_mm, next_of(*other).depth_mm);
  const DepthFrame second = next_of(*one);
  EXPECT_NE(first.depth_mm, second.depth_mm);
  EXPECT_EQ(second.depth_mm, next_of(*two).depth_mm);
  ASSERT_TRUE(one->restart());
  const DepthFrame again = next_of(*one);
  EXPECT_EQ(again.depth_mm, first.depth_mm);
  EXPECT_EQ(again.arrived_s, first.arrived_s);
}

TEST(SimulatedCamera, FollowsAPath) {
  StockScene stock = value_of(stock_scene("wall:sensor=ideal" + kSmall));
  const auto source = make_simulated_camera(
      value_of(SimulatedScene::make(std::move(stock.scene))), stock.camera,
      [](double t_s) {
        return look_at({0.0, 0.0, 1000.0 + 300.0 * t_s}, Vec3::Zero(), Vec3::UnitY());
      },
      stock.simulated, "path");
  const DepthFrame first = next_of(*source), second = next_of(*source);
  EXPECT_NEAR(static_cast<double>(first.depth_mm[1000]), 1000.0, 1e-3);
  EXPECT_NEAR(static_cast<double>(second.depth_mm[1000]), 1010.0, 1e-3);
  EXPECT_NEAR(second.world_from_camera.translation_mm.z(), 1010.0, 1e-9);
}

TEST(SimulatedCamera, FaultsAreThoseThatWereAskedFor) {
  const auto counted = [](const std::string& options) {
    const std::string spec = "wall:sensor=ideal:frames=200:jitter_ms=0:width=16:height=12";
    return value_of(measure_stream(*value_of(open_simulated_camera(spec + options))));
  };
  const StreamStatistics none = counted("");
  EXPECT_EQ(none.out_of_order + none.other_size + none.lost, 0u);
  EXPECT_EQ(none.frames, 200u);
  const StreamStatistics repeated = counted(":repeated=0.2");
  EXPECT_NEAR(static_cast<double>(repeated.out_of_order), 40.0, 20.0);
  EXPECT_EQ(repeated.frames, 200u + repeated.out_of_order);
  const StreamStatistics unordered = counted(":unordered=0.2");
  EXPECT_GT(unordered.out_of_order, 10u);
  EXPECT_EQ(unordered.frames, 200u);
  EXPECT_NEAR(static_cast<double>(counted(":truncated=0.2").other_size), 40.0, 20.0);
  const StreamStatistics late = counted(":late=0.1");
  EXPECT_GT(late.latency_s, none.latency_s + 0.005);
  EXPECT_EQ(late.out_of_order, 0u);
}

TEST(SimulatedCamera, ArrivalsNeverFallAndFollowTheCapture) {
  const auto source = opened("wall:sensor=ideal:frames=100:latency_ms=5:jitter_ms=30:late=0.2:start_s=3");
  DepthFrame frame;
  double before_s = 0.0;
  while (value_of(source->next(frame))) {
    EXPECT_GE(frame.arrived_s, frame.captured_s);
    EXPECT_GE(frame.arrived_s, before_s);
    before_s = frame.arrived_s;
  }
  EXPECT_NEAR(frame.captured_s, 3.0 + 99.0 / 30.0, 1e-9);
  EXPECT_EQ(source->frames(), 100u);
}

TEST(StockScenes, ACameraStandsBeforeAnyScene) {
  render::SceneInput scene = value_of(stock_scene("hand")).scene;
  scene.models = {scene.models.back()};  // a ball
  scene.models.front().motion = nullptr;
  scene.simulation = nullptr;
  const StockScene seen = value_of(camera_before(scene, ":sensor=ideal" + kSmall));
  const auto source = value_of(simulated_camera_of(seen, "test"));
  const DepthFrame frame = next_of(*source);
  const auto width = static_cast<std::size_t>(seen.camera.width),
             height = static_cast<std::size_t>(seen.camera.height);
  // The sphere around its box fills the height; the ball itself has that over the root of three.
  std::size_t column = 0;
  for (std::size_t row = 0; row < height; ++row)
    if (frame.depth_mm[row * width + width / 2] > 0.0f) ++column;
  EXPECT_GT(column, height / 2);
  EXPECT_LT(column, height * 3 / 4);
  EXPECT_EQ(frame.depth_mm.front(), 0.0f);
  EXPECT_TRUE(refused(camera_before(scene, ":widht=3"), "width"));
}

TEST(StockScenes, AllAreSeenAndKnowTheirOptions) {
  for (const std::string& name : stock_scene_names()) {
    const StockScene stock = value_of(stock_scene(kSimulatedPrefix + name));
    for (const render::ModelInput& model : stock.scene.models) {
      EXPECT_NE(model.analytic, nullptr) << name;
      EXPECT_NE(model.cloud, nullptr) << name;
    }
    const DepthFrame frame = next_of(*opened(name + ":sensor=ideal"));
    EXPECT_EQ(share_of_holes(frame), 0.0) << name;
    const float middle = frame.depth_mm[30 * 80 + 40];
    EXPECT_GT(middle, 800.0f) << name;
    EXPECT_LT(middle, 1100.0f) << name;
    EXPECT_TRUE(refused(stock_scene(name + ":no_such=1"), "no_such"));
  }
  EXPECT_TRUE(refused(stock_scene("wall:sensor=ideal:noise_mm=1"), "noise_mm"));
  EXPECT_TRUE(refused(stock_scene("wall:width=0"), "width"));
}

TEST(StreamStatistics, AMovingSceneIsNotNoise) {
  const auto source = opened("moving-wall:sensor=ideal:frames=20");
  const StreamStatistics seen = value_of(measure_stream(*source));
  EXPECT_LT(seen.noise_mm + 1e6 * seen.noise_per_mm, 0.01);
  EXPECT_GT(seen.farthest_mm - seen.nearest_mm, 60.0);
}

TEST(StreamStatistics, GivesUpASourceOfErrors) {
  class Broken final : public DepthSource {
   public:
    [[nodiscard]] const DepthCamera& camera() const noexcept override { return camera_; }
    [[nodiscard]] Result<bool> next(DepthFrame&) override { return Error{"the cable is out"}; }
    [[nodiscard]] Status restart() override { return Done{}; }
    [[nodiscard]] std::string describe() const override { return "broken"; }

   private:
    DepthCamera camera_;
  } broken;
  EXPECT_TRUE(refused(measure_stream(broken), "cable"));
  const auto empty = opened("wall:frames=1");
  (void)next_of(*empty);
  EXPECT_TRUE(refused(measure_stream(*empty), "no frame"));
}

}  // namespace
}  // namespace palpate::stream
