// Rivals on uneven points: how gaps are measured, that nothing falls through at the defaults, and the two
// rivals that are made for it, `sdf-godobject` and `variable-proxy`.
#include "baselines/points/gaps.h"
#include "baselines/points/sdf_grid.h"
#include "tests/baselines/small_models.h"
#include "tests/toolkit/messages.h"

namespace palpate::test {
namespace {

TEST(Gaps, AreTheEmptyCirclesOfALattice) {
  const auto points = flat_points(61, 0.5);
  const baselines::Gaps gaps = baselines::measure_gaps(cloud_of(points), 1);
  EXPECT_NEAR(gaps.gap_mm, 0.5 / std::sqrt(2.0), 1e-6);
  EXPECT_FALSE(gaps.lines);
  EXPECT_EQ(gaps.closing_mm(), gaps.spacing_mm) << "a lattice is even";
  EXPECT_EQ(gaps.neighbours(), "auto");
}

TEST(Gaps, SeeScanLinesAndNotBorders) {
  std::vector<Vec3> points;
  for (int line = 0; line < 30; ++line)
    for (int i = 0; i < 240; ++i) points.push_back({0.1 * i, 0.8 * line, 0.0});
  const baselines::Gaps gaps = baselines::measure_gaps(cloud_of(points), 1);
  // The circle through two points of a line and one of the next.
  const double circle = 0.5 * std::hypot(0.8, 0.1);
  EXPECT_NEAR(gaps.gap_mm, circle, 1e-6);
  EXPECT_TRUE(gaps.lines);
  EXPECT_EQ(gaps.neighbours(), "directional-knn");
  EXPECT_GT(gaps.closing_mm(), gaps.spacing_mm);
}

TEST(Gaps, OrderThreadsAndScaleDoNotMatter) {
  Random random(4);
  std::vector<Vec3> points;
  for (int i = 0; i < 6000; ++i) points.push_back({random.uniform(0, 40), random.uniform(0, 40), 0.0});
  const double gap = baselines::measure_gaps(cloud_of(points), 1).gap_mm;
  EXPECT_EQ(baselines::measure_gaps(cloud_of(points), 0).gap_mm, gap);
  std::vector<Vec3> other(points.rbegin(), points.rend());
  EXPECT_NEAR(baselines::measure_gaps(cloud_of(other), 0).gap_mm, gap, 1e-9 * gap);
  for (Vec3& p : other) p *= 1048576.0;
  EXPECT_NEAR(baselines::measure_gaps(cloud_of(other), 0).gap_mm, 1048576.0 * gap, 1e-3 * gap * 1048576.0);
  // Points at random: pi gap^2 / spacing^2 of 1 % of the parts is some 7.
  const double spacing = std::sqrt(40.0 * 40.0 / 6000.0);
  EXPECT_GT(gap, 1.2 * spacing);
  EXPECT_LT(gap, 1.8 * spacing);
}

class OnUneven : public testing::TestWithParam<std::string> {};

TEST_P(OnUneven, NothingFallsThroughARandomTorus) {
  const Sampled set = sampled("torus:sampling=random:points=40000:seed=7", 1.0);
  const Score found = score(set, GetParam(), 0.3);
  EXPECT_EQ(found.missed, 0);
  EXPECT_EQ(found.false_frames, 0);
  EXPECT_GT(found.contacts, 1500);
  EXPECT_LT(found.relative, 0.35);
}

TEST_P(OnUneven, NothingFallsThroughScanLines) {
  const Sampled set = sampled("sinusoid:sampling=lines:points=60000:seed=7", 1.0);
  const Score found = score(set, GetParam(), 0.5);
  EXPECT_EQ(found.missed, 0);
  EXPECT_LT(found.relative, 0.35);
}

INSTANTIATE_TEST_SUITE_P(Points, OnUneven,
                         testing::Values("sphere-proxy", "stream-proxy", "mls-penalty", "mls-proxy",
                                         "vector-field", "sdf-godobject", "variable-proxy"),
                         test_name);

TEST(SdfGodobject, HoldsAThinPlateHoweverDeepTheHip) {
  // 1 mm thick, pushed to 5: a field without a path would throw the HIP out on the other side.
  const Sampled set = sampled("slab:extent_mm=20:thickness_mm=1:sampling=random:points=40000", 0.1);
  const Probe rival = prepare(set.model, "sdf-godobject");
  const Vec3 middle = set.model.cloud->box_mm().centre_mm();
  EXPECT_FALSE(rival.press(middle + Vec3(0.3, 0.2, 5), middle + Vec3(0.3, 0.2, 0.6), 0.05).contact);
  const render::Frame deep = rival.glide(middle + Vec3(0.3, 0.2, 0.6), middle + Vec3(0.3, 0.2, -4.5), 0.05);
  ASSERT_TRUE(deep.contact);
  EXPECT_NEAR(deep.force_n.z(), 5.0 * kStiffness, 0.05);
  EXPECT_LT(std::hypot(deep.force_n.x(), deep.force_n.y()), 0.25);
  EXPECT_FALSE(rival.glide(middle + Vec3(0.3, 0.2, -4.5), middle + Vec3(0.3, 0.2, 0.6), 0.05).contact);
}

TEST(SdfGodobject, IsEnteredAtAnySpeed) {
  const Sampled set = sampled("sphere:extent_mm=20:sampling=random:points=40000", 0.1);
  const Probe rival = prepare(set.model, "sdf-godobject");
  const Vec3 middle = set.model.cloud->box_mm().centre_mm();
  for (const double from : {12.0, 30.0, 1000.0, 1e6}) {
    rival.renderer->restart(middle + Vec3(0, 0, from));
    // In one frame to the other side of the middle: the place of entry holds.
    const render::Frame frame = rival.to(middle + Vec3(0, 0, 8.0));
    ASSERT_TRUE(frame.contact) << from;
    EXPECT_NEAR(frame.force_n.z(), 2.0 * kStiffness, 0.05) << from;
  }
}

TEST(FieldsOfPoints, OpenSurfacesHaveTheSideTheyAreGiven) {
  const render::ModelInput model = model_of(flat_points(41, 0.25));
  for (const std::string name : {"vector-field", "sdf-godobject"}) {
    SCOPED_TRACE(name);
    const Probe up = prepare(model, name), down = prepare(model, name + ":flip=true");
    EXPECT_NEAR(up.press({0, 0, 1}, {0, 0, -0.5}, 0.05).force_n.z(), kStiffness * 0.5, 1e-5);
    EXPECT_FALSE(up.press({0, 0, -1}, {0, 0, 0.5}, 0.05).contact);
    EXPECT_NEAR(down.press({0, 0, -1}, {0, 0, 0.5}, 0.05).force_n.z(), -kStiffness * 0.5, 1e-5);
    EXPECT_FALSE(down.press({0, 0, 1}, {0, 0, -0.5}, 0.05).contact);
    EXPECT_FALSE(up.press({8, 0, 1}, {8, 0, -0.5}, 0.05).contact) << "beyond the border is nothing";
  }
  const Probe one = prepare(model, "sdf-godobject");
  EXPECT_EQ(one.report.warnings.size(), 1u);
  EXPECT_TRUE(test::contains(one.renderer->describe().work_bound, "one side"));
}

TEST(FieldsOfPoints, RefuseWhatTheyCannotHoldWithARemedy) {
  const struct {
    const char *fine, *limit, *uncounted;
  } fields[] = {{"vector-field:voxel=0.2:memory_mb=10", "10 MB", "vector-field:voxel_mm=0.001"},
                {"sdf-godobject:voxel=0.1:memory_mb=5", "5 MB", "sdf-godobject:voxel_mm=0.001"}};
  const render::SceneInput plate = scene_of(model_of(flat_points(101, 0.25)));
  // An extent that no directory could hold, voxels that 32 bits cannot count.
  const render::SceneInput vast =
      scene_of(model_of(cloud_of({{0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0}, {1e9, 1e9, 1e9}})));
  for (const auto& field : fields) {
    const Error refused = refusal(field.fine, plate);
    EXPECT_TRUE(contains(refused.what, field.limit));
    EXPECT_TRUE(contains(refused.remedy, "voxel"));
    EXPECT_TRUE(contains(refusal(field.uncounted, vast).remedy, "voxel"));
  }
  EXPECT_LT(prepare(plate, "vector-field:memory_mb=10").report.bytes, 10'000'000u);
  for (const char* bad : {"sdf-godobject:band=1", "sdf-godobject:voxel=0", "variable-proxy:radius=0",
                          "variable-proxy:ratio=0.5", "variable-proxy:offset=some"})
    EXPECT_FALSE(made(bad).ok()) << bad;
}

class InAClump : public testing::TestWithParam<std::string> {};

TEST_P(InAClump, NoMoreThanIsAtHandIsInReach) {
  // A plate, and 40,000 of its points within 1 mm: all of them are in a proxy's reach at once.
  std::vector<Vec3> points = flat_points(41, 0.5);
  const std::size_t even = points.size();
  Random random(11);
  for (int i = 0; i < 40000; ++i)
    points.push_back(Vec3{random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), 0.0});
  const Probe probe = prepare(model_of(points), GetParam());
  probe.press({-4, 0, 2}, {-4, 0, -0.5}, 0.05);
  // The mean direction of stream-proxy leans away from a clump beside it, so that its steps may be used up
  // there; balls know no density.
  const bool balls = GetParam().starts_with("sphere");
  render::Frame frame;
  for (int i = 0; i <= 160; ++i) {
    const Vec3 hip(-4.0 + 0.05 * i, 0.01 * i, -0.5);
    frame = probe.to(hip);
    ASSERT_TRUE(frame.contact) << hip.x();
    if (balls) {
      ASSERT_EQ(frame.status, render::FrameStatus::kOk) << hip.x();
    }
    EXPECT_NEAR(frame.force_n.z(), 0.5 * kStiffness, (balls ? 0.1 : 0.3) * kStiffness) << hip.x();
  }
  EXPECT_NEAR(frame.god_object_mm.x(), 4.0, 0.1) << "it has not stopped on the way";
  EXPECT_TRUE(any_says(probe.report.notes, "one point each"));
  points.resize(even);
  EXPECT_FALSE(any_says(prepare(model_of(points), GetParam()).report.notes, "one point each"));
}

INSTANTIATE_TEST_SUITE_P(Points, InAClump,
                         testing::Values("sphere-proxy:radius_mm=2", "stream-proxy:spacing_mm=0.5"),
                         [](const auto& rival) {
                           return rival.index == 0 ? "sphere_proxy" : "stream_proxy";
                         });

TEST(ShellWalk, StopsAtTheBoundThatIsAskedFor) {
  // One long way along a plate, in a single frame.
  const render::ModelInput plate = model_of(flat_points(81, 0.5));
  double before = -10.0;
  for (const int steps : {4, 16, 200}) {
    const Probe probe = prepare(plate, "stream-proxy:walk_steps=" + std::to_string(steps));
    probe.press({-10, 0, 2}, {-10, 0, -0.5}, 0.05);
    const render::Frame frame = probe.to({10, 0, -0.5});
    EXPECT_EQ(frame.status == render::FrameStatus::kBoundHit, steps < 200) << steps;
    EXPECT_GT(frame.god_object_mm.x(), before + 1.0) << steps;
    before = frame.god_object_mm.x();
    EXPECT_TRUE(
        contains(probe.renderer->describe().work_bound, "at most " + std::to_string(steps) + " steps"));
  }
  EXPECT_NEAR(before, 10.0, 0.1);
}

/// Rivals whose size follows the density where it changes.
class OnAStep : public testing::TestWithParam<std::string> {};

// Where each side of the step knew of itself alone, the last dense radii left a gap: 995 frames missed.
TEST_P(OnAStep, NothingFallsThrough) {
  const Sampled set = sampled("sinusoid:sampling=blue:density=40:points=40000:seed=3", 1.0);
  const Score found = score(set, GetParam(), 0.9);
  EXPECT_EQ(found.missed, 0);
  EXPECT_GT(found.contacts, 1500);
}

TEST_P(OnAStep, RadiiFollowTheDensity) {
  // One half 16 times as dense: a proxy of one radius for all must be as large as the sparse half needs.
  const Sampled set = sampled("plane:extent_mm=40:sampling=blue:density=16:points=20000:seed=3", 1.0);
  const auto ratio = [&](const std::string& name) {
    const Probe rival = prepare(set.model, name);
    const geometry::Aabb box = set.model.cloud->box_mm();
    const auto stays_off = [&](double x) {
      const Vec3 over(x, box.centre_mm().y(), box.high_mm.z() + 10.0);
      rival.renderer->restart(over);
      const Vec3 hip = over - Vec3(0, 0, 10.5);
      const render::Frame frame = rival.glide(over, hip, 0.05);
      EXPECT_TRUE(frame.contact) << x;
      return frame.force_n.norm() / kStiffness - 0.5;
    };
    return stays_off(box.low_mm.x() + 8.0) / stays_off(box.high_mm.x() - 8.0);
  };
  const double found = ratio(GetParam() + ":offset=kept");
  EXPECT_GT(found, 2.5) << "the spacings are as 4 to 1";
  EXPECT_LT(found, 6.0);
  if (GetParam() == "stream-proxy") {
    EXPECT_LT(ratio("stream-proxy:offset=kept:radii=one"), 1.3) << "one radius for all, on request";
  }
}

INSTANTIATE_TEST_SUITE_P(Points, OnAStep, testing::Values("stream-proxy", "variable-proxy"), test_name);

TEST(StreamProxy, LocalRadiiAreTakenWhereTheDensityChangesAndNowhereElse) {
  const auto choice = [](const std::string& generator, const std::string& name) {
    const Probe made = prepare(sampled(generator, 1.0).model, name);
    for (const render::ModelDecisions& model : made.report.decisions.models)
      for (const render::Decision& one : model.decisions)
        if (one.about == "radii") return one.choice;
    return std::string();
  };
  EXPECT_EQ(choice("torus:sampling=random:points=20000:seed=7", "stream-proxy"), "one");
  EXPECT_EQ(choice("sinusoid:sampling=lines:points=20000:seed=7", "stream-proxy"), "one");
  EXPECT_EQ(choice("sinusoid:points=10201", "stream-proxy"), "one");
  EXPECT_EQ(choice("sinusoid:sampling=blue:density=16:points=20000:seed=3", "stream-proxy"), "local");
  EXPECT_EQ(choice("sinusoid:points=10201", "stream-proxy:radii=local"), "local");
}

}  // namespace
}  // namespace palpate::test
