// What must hold for every point-based rival, whatever its method: relations between runs, data that is
// degenerate or hostile.
#include <algorithm>
#include <limits>
#include <numbers>

#include "tests/baselines/small_models.h"

namespace palpate::test {
namespace {

const std::vector<std::string> kRivals = {
    "penalty-grid",      "penalty-grid:neighbours=27:side=outward:threshold=0",
    "sphere-proxy",      "stream-proxy",
    "mls-penalty",       "mls-penalty:normals=covariance",
    "mls-proxy",         "mls-proxy:surface=metaball",
    "vector-field",      "vgraph",
    "vgraph:graph=mesh", "sdf-godobject",
    "variable-proxy",
};

bool needs_a_mesh(const std::string& rival) {
  return rival.starts_with("vgraph");
}

using Frames = std::vector<render::Frame>;

Frames run(const render::ModelInput& model, const std::string& options, const std::vector<Vec3>& path,
           int threads = 1) {
  const Probe rival = prepare(model, options, threads);
  rival.renderer->restart(path.front());
  Frames frames;
  for (const Vec3& hip : path) frames.push_back(rival.to(hip));
  return frames;
}

/// The largest difference of forces in N, of frames scaled back; contact must agree.
double largest_difference(const Frames& a, const Frames& b, double scale = 1.0) {
  double worst = 0.0;
  std::size_t contacts = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].contact, b[i].contact) << "frame " << i;
    contacts += a[i].contact;
    worst = std::max(worst, (a[i].force_n * scale - b[i].force_n).norm());
  }
  EXPECT_GT(contacts, a.size() / 10) << "the path must be felt";
  return worst;
}

struct Sample {
  std::vector<Vec3> points, path;
};
/// A jittered sinusoid and a path on it; no two points equally far from anywhere.
const Sample& sample() {
  static const Sample made = [] {
    const auto made_cloud = generated("sinusoid:points=10201:jitter=0.2:seed=3:mesh=false");
    return Sample{points_of(made_cloud.cloud), weaving(*made_cloud.surface, 1500, 1.0)};
  }();
  return made;
}

class EveryRival : public testing::TestWithParam<std::string> {};

TEST_P(EveryRival, OrderOfPointsDoesNotMatter) {
  std::vector<Vec3> shuffled = sample().points;
  Random random(11);
  for (std::size_t i = shuffled.size(); i > 1; --i)
    std::swap(shuffled[i - 1],
              shuffled[static_cast<std::size_t>(random.uniform(0.0, static_cast<double>(i)))]);
  const Frames a = run(model_of(sample().points), GetParam(), sample().path);
  const Frames b = run(model_of(shuffled), GetParam(), sample().path);
  EXPECT_LT(largest_difference(a, b), 1e-9);
}

TEST_P(EveryRival, ScaleDoesNotMatter) {
  // Powers of two scale every stored number exactly.
  const Frames a = run(model_of(sample().points), GetParam(), sample().path);
  for (const double scale : {std::ldexp(1.0, -10), std::ldexp(1.0, 20)}) {
    std::vector<Vec3> points = sample().points, path = sample().path;
    for (Vec3& p : points) p *= scale;
    for (Vec3& p : path) p *= scale;
    const Frames b = run(model_of(points), GetParam(), path);
    EXPECT_LT(largest_difference(a, b, scale), 1e-9 * scale) << scale;
  }
}

TEST_P(EveryRival, PoseAndPlaceDoNotMatter) {
  const Frames a = run(model_of(sample().points), GetParam(), sample().path);
  render::ModelInput moved = model_of(sample().points);
  moved.world_from_model.rotation = Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5);
  moved.world_from_model.translation_mm = Vec3(1024.0, -2048.0, 512.0);
  std::vector<Vec3> path = sample().path;
  for (Vec3& p : path) p = moved.world_from_model * p;
  Frames back = run(moved, GetParam(), path);
  for (render::Frame& frame : back) frame.force_n = moved.world_from_model.inverse().rotate(frame.force_n);
  EXPECT_LT(largest_difference(a, back), 1e-6);

  // Far from the origin the stored places round otherwise, by 2^-25 of the extent.
  std::vector<Vec3> far = sample().points, far_path = sample().path;
  for (Vec3& p : far) p += Vec3(1 << 20, 1 << 20, -(1 << 20));
  for (Vec3& p : far_path) p += Vec3(1 << 20, 1 << 20, -(1 << 20));
  const Frames c = run(model_of(far), GetParam(), far_path);
  std::size_t near = 0;
  for (std::size_t i = 0; i < a.size(); ++i) near += (a[i].force_n - c[i].force_n).norm() < 1e-3;
  EXPECT_GT(near, a.size() * 99 / 100);
}

TEST_P(EveryRival, ThreadsDoNotMatterAndResetRepeats) {
  const render::ModelInput model = model_of(sample().points);
  const Frames a = run(model, GetParam(), sample().path, 1);
  const Frames b = run(model, GetParam(), sample().path, 0);
  const Probe rival = prepare(model, GetParam());
  for (int round = 0; round < 2; ++round) {
    rival.renderer->restart(sample().path.front());
    for (std::size_t i = 0; i < a.size(); ++i) {
      const render::Frame frame = rival.to(sample().path[i]);
      ASSERT_EQ(frame.force_n, a[i].force_n) << i;
      ASSERT_EQ(frame.god_object_mm, a[i].god_object_mm) << i;
      ASSERT_EQ(frame.force_n, b[i].force_n) << i;
    }
  }
  EXPECT_EQ(rival.renderer->counters().frames, a.size());
}

TEST_P(EveryRival, StrangeCloudsAreFelt) {
  const std::vector<std::vector<Vec3>> clouds = {
      {{1, 2, 3}},
      std::vector<Vec3>(50, Vec3(1, 2, 3)),
      {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}},
      flat_points(9, 1.0),
      {{0, 0, 0}, {1e-6, 0, 0}, {1000, 0, 0}, {0, 1000, 0}},
  };
  for (const auto& points : clouds) {
    if (needs_a_mesh(GetParam())) {
      // No mesh can be made of these: an Error with a remedy, or a mesh.
      const auto prepared = test::rival(GetParam())->prepare(scene_of(model_of(points)), {});
      if (!prepared.ok()) {
        EXPECT_FALSE(prepared.error().remedy.empty()) << prepared.error().message();
        continue;
      }
    }
    const Probe rival = prepare(model_of(points), GetParam());
    Random random(7);
    const Vec3 centre = points[points.size() / 2];
    rival.renderer->restart(centre + Vec3(0, 0, 5));
    for (int i = 0; i < 2000; ++i) {
      const Vec3 hip = centre + 2.0 * Vec3(random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0),
                                           random.uniform(-1.0, 1.0));
      const render::Frame frame = rival.to(hip);
      ASSERT_TRUE(is_finite(frame.force_n)) << points.size() << " points, " << hip.transpose();
      ASSERT_TRUE(is_finite(frame.god_object_mm));
      ASSERT_TRUE(frame.contact || frame.force_n == Vec3::Zero());
    }
  }
}

TEST_P(EveryRival, StrangeHipsDoNoHarm) {
  const Probe rival = prepare(model_of(sample().points), GetParam());
  rival.renderer->restart(sample().path.front());
  const double nan = std::nan(""), infinite = std::numeric_limits<double>::infinity();
  for (const Vec3& bad : {Vec3(nan, 0, 0), Vec3(0, infinite, 0), Vec3(0, 0, -infinite)}) {
    const render::Frame frame = rival.to(bad);
    EXPECT_EQ(frame.status, render::FrameStatus::kNonFinite);
    EXPECT_EQ(frame.force_n, Vec3::Zero());
  }
  for (const double far : {1e3, 1e6, 1e12, 1e100, 1e300})
    for (const Vec3& way : {Vec3(1, 0, 0), Vec3(-1, 1, 1), Vec3(0, 0, -1), Vec3(0.3, 0.2, 1)}) {
      const render::Frame frame = rival.to(far * way);
      EXPECT_TRUE(is_finite(frame.god_object_mm)) << far;
      EXPECT_FALSE(std::isnan(frame.force_n.x())) << far;
    }
  // And afterwards it works as before.
  rival.renderer->restart(sample().path.front());
  std::size_t contacts = 0;
  for (const Vec3& hip : sample().path) contacts += rival.to(hip).contact;
  EXPECT_GT(contacts, sample().path.size() / 10);
}

TEST_P(EveryRival, ForceIsLimitedAndModelsAddUp) {
  render::SceneInput scene;
  scene.force_limit_n = 0.1;
  scene.models.push_back(model_of(sample().points));
  scene.models.push_back(model_of(sample().points));
  scene.models[1].world_from_model.translation_mm = Vec3(500, 0, 0);
  const Probe both = prepare(scene, GetParam());
  const Frames alone = run(scene.models[0], GetParam(), sample().path);
  both.renderer->restart(sample().path.front());
  for (std::size_t i = 0; i < alone.size(); ++i) {
    const render::Frame frame = both.to(sample().path[i]);
    ASSERT_NEAR((frame.force_n - render::limited(alone[i].force_n, 0.1)).norm(), 0.0, 1e-12);
    ASSERT_EQ(frame.model, alone[i].contact ? 0 : -1);
  }
}

INSTANTIATE_TEST_SUITE_P(Points, EveryRival, testing::ValuesIn(kRivals), test_name);

// Two planes at 10 degrees to each other: held by both together a god object is pushed hardly more than by
// one, where the sum would be twice that.
TEST(EveryRivalWithAGodObject, IsHeldByTwoModelsTogether) {
  const auto made = generated("plane:extent_mm=40:spacing_mm=0.5");
  render::ModelInput flat = model_of(made.cloud);
  flat.world_from_model.translation_mm = -made.cloud.box_mm().centre_mm();
  render::ModelInput tilted = flat;
  const Eigen::AngleAxisd turn(10.0 * std::numbers::pi / 180.0, Vec3::UnitY());
  tilted.world_from_model.rotation = turn;
  tilted.world_from_model.translation_mm = -(turn * made.cloud.box_mm().centre_mm());
  render::SceneInput scene;
  scene.models = {flat, tilted};
  for (const char* name :
       {"sphere-proxy", "stream-proxy", "mls-proxy", "vgraph", "sdf-godobject", "variable-proxy"}) {
    SCOPED_TRACE(name);
    const render::Frame frame = prepare(scene, name).press({0.1, 0.1, 2}, {0.1, 0.1, -1}, 0.01);
    ASSERT_TRUE(frame.contact);
    EXPECT_NEAR(frame.force_n.norm(), kStiffness * 1.0, 0.1 * kStiffness);
  }
}

}  // namespace
}  // namespace palpate::test
