// `stream-proxy`, `mls-penalty` and `mls-proxy` against formulas, and their parts against brute force.
#include <algorithm>

#include "baselines/points/mls_proxy.h"
#include "baselines/points/sphere_tree.h"
#include "tests/baselines/small_models.h"

namespace palpate::test {
namespace {

const std::vector<std::string> kSmooth = {"stream-proxy", "mls-penalty", "mls-penalty:normals=covariance",
                                          "mls-proxy", "mls-proxy:weight=wendland"};

class Smooth : public testing::TestWithParam<std::string> {};

TEST_P(Smooth, PlaneIsExact) {
  const double spacing = 0.2;
  const Probe rival = prepare(model_of(flat_points(101, spacing)), GetParam());
  for (const double side : {1.0, -1.0}) {
    EXPECT_FALSE(rival.press({-5, -5, 3.0 * side}, {-5, -5, 0.1 * side}, 0.02).contact);
    rival.glide({-5, -5, 0.1 * side}, {-5, -5, -1.0 * side}, 0.02);
    for (int i = 0; i < 200; ++i) {
      const render::Frame frame = rival.to({-5 + 0.05 * i, -5 + 0.031 * i, -1.0 * side});
      ASSERT_TRUE(frame.contact) << i;
      // The tilt that the rest's tolerance, and points entering the kernel one by one, leave.
      ASSERT_NEAR(frame.force_n.z(), kStiffness * side, 0.01 * kStiffness) << i;
      ASSERT_LT(std::hypot(frame.force_n.x(), frame.force_n.y()), 0.02 * kStiffness) << i;
    }
    EXPECT_FALSE(rival.glide({5, 1.2, -1.0 * side}, {5, 1.2, 0.1 * side}, 0.05).contact);
  }
}

TEST_P(Smooth, ErrorFallsWithTheSquareOfTheSpacing) {
  const std::string model = "sinusoid:amplitude_mm=2:wavelength_mm=20:extent_mm=40:points=";
  const Score few = score(sampled(model + "10201", 0.5), GetParam(), 0.05),
              many = score(sampled(model + "40401", 0.5), GetParam(), 0.05);
  EXPECT_EQ(few.missed + many.missed, 0);
  // A fitted surface is off by curvature x kernel^2 / 4, and the kernel is in spacings.
  EXPECT_LT(few.relative, 0.08);
  EXPECT_LT(many.relative, 0.025);
  EXPECT_LT(many.relative, few.relative / 2.5) << few.relative << " to " << many.relative;
}

TEST_P(Smooth, ClosedSurfacesAreFeltFromOutside) {
  EXPECT_LT(score(sampled("sphere:extent_mm=20:points=40000", 1.0), GetParam(), 0.1).relative, 0.03);
}

INSTANTIATE_TEST_SUITE_P(Points, Smooth, testing::ValuesIn(kSmooth),
                         [](const auto& rival) { return test_name(rival.param); });

TEST(SphereTree, FindsWhatBruteForceFinds) {
  for (const std::size_t n : {1u, 7u, 8u, 9u, 1000u}) {
    Random random(n);
    std::vector<Vec3> places;
    for (std::size_t i = 0; i < n; ++i)
      places.push_back({random.uniform(-5, 5), random.uniform(-5, 5), random.uniform(-1, 1)});
    const cloud::Cloud cloud = cloud_of(places);
    const baselines::PointGrid grid = baselines::build_point_grid(cloud, 1.0, 1);
    baselines::SphereTree tree, parallel;
    tree.build(grid.points, 1);
    parallel.build(grid.points, 0);
    for (int i = 0; i < 300; ++i) {
      const Vec3 at(random.uniform(-7, 7), random.uniform(-7, 7), random.uniform(-3, 3));
      const double radius = random.uniform(0.0, 4.0);
      std::vector<std::uint32_t> expected, found, found_in_grid;
      std::uint32_t nearest = baselines::kNoPlace;
      for (std::uint32_t k = 0; k < n; ++k) {
        const double sq = (grid.points[k].at() - at).squaredNorm();
        if (sq <= radius * radius) expected.push_back(k);
        if (sq <= radius * radius &&
            (nearest == baselines::kNoPlace || sq < (grid.points[nearest].at() - at).squaredNorm()))
          nearest = k;
      }
      tree.within(at, radius, [&](std::uint32_t place, double) { found.push_back(place); });
      grid.within(at, radius, [&](std::uint32_t place, double) { found_in_grid.push_back(place); });
      std::sort(found_in_grid.begin(), found_in_grid.end());
      ASSERT_EQ(found, expected);
      ASSERT_EQ(found_in_grid, expected);
      ASSERT_EQ(tree.nearest(at, radius), nearest);
      ASSERT_EQ(parallel.nearest(at, radius), nearest);
    }
  }
}

TEST(MlsPenalty, WiderKernelsSmoothNoise) {
  Random random(4);
  const double noise = 0.1;
  const auto points = height_points(81, 0.25, [&](double, double) { return noise * random.normal(); });
  const auto error_of = [&](const std::string& options) {
    const Probe rival = prepare(model_of(points), options);
    rival.renderer->restart({0, 0, 3});
    EXPECT_FALSE(rival.to({0, 0, 3}).contact);  // the side it comes from
    double sum = 0.0;
    Random place(8);
    for (int i = 0; i < 400; ++i) {
      const render::Frame frame = rival.to({place.uniform(-7, 7), place.uniform(-7, 7), -1.0});
      sum += std::pow(frame.force_n.z() / kStiffness - 1.0, 2);
    }
    return std::sqrt(sum / 400);
  };
  // A mean over the kernel's points, 2 pi width^2 of them effectively: 1 / sqrt(25) of the noise at width 2.
  EXPECT_LT(error_of("mls-penalty:width=2"), 0.4 * noise);
  EXPECT_LT(error_of("mls-penalty:width=2"), 0.7 * error_of("mls-penalty:width=0.7"));
}

TEST(MlsPenalty, PopsThroughThinPlatesAsPenaltiesDo) {
  auto points = height_points(61, 0.25, [](double, double) { return 0.5; });
  const auto lower = height_points(61, 0.25, [](double, double) { return -0.5; });
  points.insert(points.end(), lower.begin(), lower.end());
  const Probe penalty = prepare(model_of(points), "mls-penalty");
  const Probe proxy = prepare(model_of(points), "stream-proxy");
  for (const Probe* rival : {&penalty, &proxy}) {
    EXPECT_GT(rival->press({0.1, 0, 2}, {0.1, 0, 0.2}, 0.02).force_n.z(), 0.1);
  }
  EXPECT_GE(proxy.glide({0.1, 0, 0.2}, {0.1, 0, -0.3}, 0.02).force_n.z(), 0.39);
  EXPECT_LT(penalty.glide({0.1, 0, 0.2}, {0.1, 0, -0.3}, 0.02).force_n.z(), 0.2)
      << "the other face is nearer";
}

TEST(MlsProxy, MetaballsAreASkinFeltFromBothSides) {
  const auto points = flat_points(41, 0.25);
  const Probe rival = prepare(model_of(points), "mls-proxy:surface=metaball");
  for (const double side : {1.0, -1.0}) {
    const render::Frame frame = rival.press({0, 0, 3.0 * side}, {0.3, 0.2, -0.4 * side}, 0.02);
    ASSERT_TRUE(frame.contact);
    // Points' radii are 3 spacings, and the level 0.5 lies within them.
    EXPECT_GT(frame.god_object_mm.z() * side, 0.25);
    EXPECT_LT(frame.god_object_mm.z() * side, 0.75);
  }
}

TEST(MlsProxy, LosesTheSurfaceWhereTheHipOutrunsItsNeighbourhood) {
  const auto points = flat_points(41, 0.25);
  const Probe rival = prepare(model_of(points), "mls-proxy");
  EXPECT_FALSE(rival.press({0, 0, 5}, {0, 0, -5}, 5.0).contact) << "no frame saw the points: a pop-through";
  EXPECT_TRUE(rival.press({0, 0, 5}, {0, 0, -5}, 0.1).contact);
}

TEST(StreamProxy, FollowsPointsThatMoveAndGetsThemBack) {
  const auto points = flat_points(21, 0.5);
  render::ModelInput model = model_of(points);
  model.moves = std::make_shared<render::MoveQueue>();
  ASSERT_LE(points.size(), render::kMaxBatch);
  const Probe rival = prepare(model, "stream-proxy");
  const Vec3 hip(0.1, 0.05, -0.5);
  const auto press = [&] { return rival.press({0.1, 0.05, 3}, hip, 0.05); };
  const render::Frame before = press();
  EXPECT_NEAR(before.force_n.z(), kStiffness * 0.5, 0.01);
  // The plane rises under the resting HIP, a fiftieth of a spacing a batch.
  double height = 0.0;
  for (int k = 0; k < 100; ++k) {
    height += 0.01;
    render::MoveBatch* batch = model.moves->begin();
    ASSERT_NE(batch, nullptr);
    for (std::uint32_t i = 0; i < points.size(); ++i) {
      batch->point[i] = i;
      batch->to_mm[i] = (model.cloud->local_mm(i) + Vec3(0, 0, height)).cast<float>();
    }
    batch->count = static_cast<std::uint32_t>(points.size());
    model.moves->publish();
    const render::Frame frame = rival.to(hip);
    ASSERT_NEAR(frame.force_n.z(), kStiffness * (0.5 + height), 0.02) << k;
  }
  const render::Frame after = press();
  EXPECT_EQ(after.force_n, before.force_n) << "reset gives the prepared shape back";
}

TEST(StreamProxy, ShellsMustLieInOrder) {
  EXPECT_NE(refusal("stream-proxy:r1=2:r2=1", scene_of(model_of(cloud_of({{0, 0, 0}, {1, 0, 0}})))).what, "");
}

TEST(ProxiesOfPoints, ThinSlabsHoldAtAnySpeed) {
  const auto points = flat_points(41, 0.25);
  for (const auto& [name, off] : {std::pair("sphere-proxy:radius=2", 0.2), std::pair("stream-proxy", 0.05)}) {
    const Probe rival = prepare(model_of(points), name);
    for (const double step : {0.01, 0.5, 5.0, 50.0}) {
      const render::Frame frame = rival.press({0.1, 0.2, 60}, {0.3, -0.1, -40}, step);
      ASSERT_TRUE(frame.contact) << name << " " << step;
      EXPECT_NEAR(frame.god_object_mm.z(), 0.0, off) << name << " " << step;
      EXPECT_GT(frame.force_n.z(), 10.0);
    }
  }
}

}  // namespace
}  // namespace palpate::test
