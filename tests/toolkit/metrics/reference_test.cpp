// The analytic reference, and the local resolution of a cloud.
#include <gtest/gtest.h>

#include <cmath>

#include <palpate/accuracy.h>
#include "tests/toolkit/messages.h"
#include "tests/toolkit/metrics/small_traces.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/metrics/closest_point.h"
#include "toolkit/metrics/scores.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::metrics {
namespace {

trace::ProbePath path_through(const std::vector<Vec3>& corners_mm, int frames_a_leg) {
  trace::ProbePath path;
  path.name = "test";
  for (std::size_t c = 0; c + 1 < corners_mm.size(); ++c) {
    for (int i = 0; i < frames_a_leg; ++i) {
      const double t = static_cast<double>(i) / frames_a_leg;
      path.hip_mm.push_back((1.0 - t) * corners_mm[c] + t * corners_mm[c + 1]);
      path.t_s.push_back(0.001 * static_cast<double>(path.t_s.size()));
    }
  }
  return path;
}

geometry::RigidTransform some_pose() {
  geometry::RigidTransform pose;
  pose.rotation = Eigen::AngleAxisd(0.7, Vec3(1.0, 2.0, 3.0).normalized());
  pose.translation_mm = {100.0, -50.0, 20.0};
  return pose;
}

TEST(AnalyticReference, SphereUnderAPose) {
  const auto sphere = geometry::make_sphere(10.0);
  const geometry::RigidTransform pose = some_pose();
  trace::ProbePath path = path_through({{0, 0, 11}, {0, 0, 9}, {8, 0, 3}, {11, 0, 0}}, 50);
  std::vector<Vec3> model_mm = path.hip_mm;
  for (Vec3& h : path.hip_mm) h = pose * h;
  const auto r = test::value_of(analytic_reference(*sphere, path, kStiffness, 0.0, pose));
  const AnalyticTruth truth(*sphere, pose);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const double d = model_mm[i].norm() - 10.0;
    EXPECT_NEAR(r.frames[i].signed_distance_mm, d, 1e-12);
    EXPECT_NEAR(truth.signed_distance_mm(path.hip_mm[i]), d, 1e-12);
    const Vec3 normal = pose.rotate(model_mm[i].normalized());
    EXPECT_NEAR((r.frames[i].normal - normal).norm(), 0.0, 1e-9);
    EXPECT_NEAR((truth.closest(path.hip_mm[i]).normal - normal).norm(), 0.0, 1e-9);
    if (d < 0.0) {
      EXPECT_NEAR((r.frames[i].frame.force_n + kStiffness * d * normal).norm(), 0.0, 1e-9);
    }
  }
}

TEST(AnalyticReference, ScoresPerfectlyAgainstItself) {
  const auto sinusoid = geometry::make_sinusoid(10.0, 50.0, 100.0);
  const trace::ProbePath path = path_through({{20, 12, 25}, {2, 1, 18.5}, {6, 9, 10}, {1, 3, 25}}, 200);
  auto r = test::value_of(analytic_reference(*sinusoid, path, kStiffness, 0.0, {}));
  for (trace::TruthFrame& frame : r.frames) frame.local_resolution_mm = 0.2;
  const AnalyticTruth truth(*sinusoid, {});
  const auto a = test::value_of(score(path, as_trace(r), r, &truth, {}));
  EXPECT_GT(a.contact_frames, 50u);
  EXPECT_EQ(a.force_rms_n, 0.0);
  EXPECT_EQ(a.pop_throughs, 0u);
  EXPECT_LT(*a.god_object_surface_max_mm, 1e-9);
  const auto e = test::value_of(observe_energy(path, as_trace(r), kStiffness));
  EXPECT_LT(*e.generated_percent, 1.0) << "only sampling at entry and exit";
}

TEST(AnalyticReference, RefusesBadPaths) {
  const auto plane = geometry::make_plane(100.0);
  const auto inside =
      analytic_reference(*plane, path_through({{0, 0, -1}, {0, 0, 1}}, 5), kStiffness, 0.0, {});
  ASSERT_FALSE(inside);
  EXPECT_EQ(inside.error().line, 2);
  EXPECT_FALSE(analytic_reference(*plane, {}, kStiffness, 0.0, {}));
  trace::ProbePath bad = path_through({{0, 0, 1}, {0, 0, 2}}, 3);
  EXPECT_FALSE(analytic_reference(*plane, bad, 0.0, 0.0, {}));
  bad.hip_mm[2].x() = std::nan("");
  EXPECT_EQ(analytic_reference(*plane, bad, kStiffness, 0.0, {}).error().line, 4);
}

TEST(LocalResolution, DistanceToTheLastNeighbourThere) {
  // A 5 x 5 grid of 1 mm: an inner point's eighth neighbour is a diagonal away.
  std::vector<Vec3> points;
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 5; ++x) points.emplace_back(x - 2, y - 2, 0.0);
  }
  const cloud::Cloud cloud = cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
  search::NeighbourTable table;
  table.of.resize(25);
  for (std::uint32_t i = 0; i < 25; ++i) table.of[i].fill(i);
  table.of[12] = {7, 11, 13, 17, 6, 8, 16, 18};  // the middle
  table.of[13] = {12, 13, 13, 13, 13, 13, 13, 13};
  const geometry::RigidTransform pose = some_pose();
  const auto plane = geometry::make_plane(5.0);
  trace::ProbePath path = path_through({{0.1, 0.2, 3}, {0.1, 0.2, -0.5}, {1.1, 0, -0.5}, {1.1, 0, 0}}, 2);
  for (Vec3& h : path.hip_mm) h = pose * h;
  auto r = test::value_of(analytic_reference(*plane, path, kStiffness, 0.0, pose));
  ASSERT_TRUE(fill_local_resolution(r, path, cloud, table, pose));
  EXPECT_NEAR(r.frames[0].local_resolution_mm, std::sqrt(2.0), 1e-12) << "free, above the middle";
  EXPECT_NEAR(r.frames[2].local_resolution_mm, std::sqrt(2.0), 1e-12) << "in contact at the middle";
  EXPECT_NEAR(r.frames[4].local_resolution_mm, 1.0, 1e-12) << "a point with one neighbour";
  table.of.pop_back();
  EXPECT_FALSE(fill_local_resolution(r, path, cloud, table, pose));
  // Without a table: by the eight nearest,.
  ASSERT_TRUE(fill_local_resolution(r, path, cloud, pose, 1));
  EXPECT_NEAR(r.frames[2].local_resolution_mm, std::sqrt(2.0), 1e-12);
}

// The reference without history, and the frames that history decides.

TEST(History, DecidesWhereAThinPartIsCrossed) {
  Tiny t;  // held by the upper sheet of a plate, down to 2 mm
  for (const double z : {0.5, -0.2, -0.4, -0.7, -1.5, -2.0, -0.3, 0.5}) t.add(z);
  const auto second =
      test::value_of(closest_point_reference(Slab(1.0), t.path, kStiffness, 0.0, no_progress()));
  EXPECT_EQ(second.name, "closest-point");
  const auto tally = test::value_of(compare_references(t.reference, second, t.path));
  EXPECT_TRUE(t.reference.compared);
  EXPECT_EQ(tally.contact, 6u);
  EXPECT_EQ(tally.place, 1u);  // -0.7: the lower side is nearer
  EXPECT_EQ(tally.state, 2u);  // -1.5, -2.0: beyond it
  EXPECT_DOUBLE_EQ(tally.share_percent, 50.0);
  const std::vector<bool> wanted = {false, false, false, true, true, true, false, false};
  for (std::size_t i = 0; i < wanted.size(); ++i)
    EXPECT_EQ(t.reference.frames[i].history_decides, wanted[i]) << i;
}

TEST(History, IsScoredApartAndNowhereElse) {
  Tiny right, wrong;
  for (Tiny* t : {&right, &wrong})
    for (const double z : {0.5, -0.2, -0.4, -0.7, -1.5, -0.3, 0.5}) t->add(z);
  // Free beyond the plate, as a renderer that is let through: wrong by 0.35 N and 0.75 N there.
  for (const std::size_t i : {std::size_t{3}, std::size_t{4}}) {
    wrong.trace.frames[i] = {};
    wrong.trace.frames[i].god_object_mm = wrong.path.hip_mm[i];
  }
  const auto second =
      test::value_of(closest_point_reference(Slab(1.0), wrong.path, kStiffness, 0.0, no_progress()));
  const auto before = test::value_of(wrong.scored());
  EXPECT_EQ(before.missed_contact_frames, 2u);
  EXPECT_FALSE(before.history_frames) << "nobody compared";
  EXPECT_FALSE(before.force_rms_whole_percent);
  for (Tiny* t : {&right, &wrong}) ASSERT_TRUE(compare_references(t->reference, second, t->path));
  const auto a = wrong.scored(), b = right.scored();
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->force_rms_percent, 0.0);
  EXPECT_EQ(a->contact_frames, 3u);
  EXPECT_EQ(a->missed_contact_frames, 0u);
  EXPECT_EQ(a->missed_tenth_mm_frames, 0u);
  EXPECT_EQ(a->jump_errors, 0u);
  EXPECT_EQ(a->pop_throughs, 0u);
  EXPECT_EQ(a->fall_throughs, 0u);
  EXPECT_EQ(a->indistinguishable_percent, 100.0);
  EXPECT_EQ(a->lag_ms, 0.0);
  EXPECT_EQ(a->history_frames, 2u);
  EXPECT_DOUBLE_EQ(*a->history_percent, 40.0);
  EXPECT_NEAR(*a->history_force_rms_n, std::sqrt((0.35 * 0.35 + 0.75 * 0.75) / 2.0), 1e-12);
  EXPECT_NEAR(*a->force_rms_whole_percent, *before.force_rms_percent, 1e-12);
  EXPECT_EQ(b->history_force_rms_n, 0.0);
  EXPECT_EQ(b->force_rms_whole_percent, 0.0);
}

TEST(History, IsNoneOnASmoothSurfaceAtAnyScaleAndPlace) {
  for (const double scale : {1e-3, 1.0, 1e6})
    for (const double away : {0.0, 1e3}) {
      geometry::RigidTransform pose;
      pose.rotation = Eigen::AngleAxisd(0.7, Vec3(1.0, 2.0, 3.0).normalized());
      pose.translation_mm = Vec3::Constant(away * scale);
      const auto ball = geometry::make_sphere(10.0 * scale);
      trace::ProbePath path;
      path.name = "round the ball";
      for (int i = 0; i < 2000; ++i) {
        const double turn = 0.01 * i, off = scale * (10.0 + 0.5 + std::cos(0.05 * i) - 1.0);
        path.t_s.push_back(1e-3 * i);
        path.hip_mm.push_back(
            pose * Vec3(off * std::cos(turn), off * std::sin(turn) * 0.8, off * std::sin(turn) * 0.6));
      }
      auto first = test::value_of(analytic_reference(*ball, path, kStiffness, 0.0, pose));
      const auto second = test::value_of(
          closest_point_reference(AnalyticTruth(*ball, pose), path, kStiffness, 0.0, no_progress()));
      const auto tally = test::value_of(compare_references(first, second, path));
      EXPECT_GT(tally.contact, 500u);
      EXPECT_EQ(tally.state + tally.place, 0u) << scale << " " << away << " " << first.exactness;
    }
}

TEST(History, RefusesWhatDoesNotFit) {
  Tiny t({-0.5});
  EXPECT_FALSE(closest_point_reference(Slab(1.0), t.path, kStiffness, 0.0, no_progress())) << "starts inside";
  Tiny u({0.5});
  EXPECT_FALSE(closest_point_reference(Slab(1.0), u.path, 0.0, 0.0, no_progress()));
  EXPECT_FALSE(compare_references(u.reference, {}, u.path));
  EXPECT_FALSE(u.reference.compared);
}

// Coulomb's law, by hand.

AccuracyOptions with_friction(double mu_s, double mu_d) {
  AccuracyOptions options;
  options.static_friction = mu_s;
  options.dynamic_friction = mu_d;
  return options;
}

/// The HIP goes along x, 1 mm deep, 0.1 mm a frame; the god object trails by `trail` x depth.
Tiny dragged(const std::vector<double>& trails) {
  Tiny t({1.0});
  double x = 0.0;
  for (const double trail : trails) {
    x += 0.1;
    render::Frame& frame = t.add(-1.0, 0.1, x);
    frame.god_object_mm = {x - trail, 0.0, 0.0};
    frame.force_n = kStiffness * (frame.god_object_mm - Vec3(x, 0.0, -1.0));
  }
  return t;
}

TEST(Friction, StickThenSlipByTheLaw) {
  // Stuck at x = 0.1 while the trail grows to the cone, then along at the dynamic coefficient.
  const Accuracy a =
      dragged({0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.5, 0.5}).scores(nullptr, with_friction(0.5, 0.5));
  EXPECT_EQ(a.friction_cone_percent, 0.0);
  EXPECT_NEAR(*a.friction_slip_error_percent, 0.0, 1e-9);
  EXPECT_EQ(a.stick_slip_percent, 100.0);
  EXPECT_NEAR(*a.stick_drift_mm_s, 0.0, 1e-9);
}

TEST(Friction, OutsideTheConeIsSeen) {
  const Accuracy a = dragged({0.0, 0.1, 0.8, 0.8}).scores(nullptr, with_friction(0.5, 0.5));
  EXPECT_DOUBLE_EQ(*a.friction_cone_percent, 50.0);
  EXPECT_NEAR(*a.friction_slip_error_percent, 60.0, 1e-9);  // 0.8 for 0.5
}

TEST(Friction, CreepInsideTheConeIsNoStick) {
  // Carried along with the HIP at a trail of 0.2 where it should be held: 100 mm/s of drift.
  const Accuracy a = dragged({0.2, 0.2, 0.2, 0.2, 0.2}).scores(nullptr, with_friction(0.5, 0.5));
  EXPECT_EQ(a.friction_cone_percent, 0.0);
  EXPECT_EQ(a.stick_slip_percent, 0.0);
  EXPECT_NEAR(*a.stick_drift_mm_s, 100.0, 1e-9);
  EXPECT_NEAR(*a.friction_slip_error_percent, 60.0, 1e-9);
}

TEST(Friction, AForceThatPullsIsOutsideTheCone) {
  Tiny t = dragged({0.1, 0.1});
  t.trace.frames[2].force_n = {0.0, 0.0, -0.4};
  EXPECT_DOUBLE_EQ(*t.scores(nullptr, with_friction(0.5, 0.5)).friction_cone_percent, 50.0);
}

TEST(Friction, IsNothingWithoutFrictionOrSurface) {
  const Tiny t = dragged({0.1, 0.1});
  EXPECT_FALSE(t.scores().friction_cone_percent);
  const auto a = test::value_of(score(t.path, t.trace, t.reference, nullptr, with_friction(0.5, 0.4)));
  EXPECT_FALSE(a.friction_cone_percent || a.stick_drift_mm_s);
}

TEST(Friction, StaysWhereForcesAreNotCompared) {
  const Tiny t = dragged({0.0, 0.1, 0.8, 0.8});
  AccuracyFrames frames;
  auto a = test::value_of(t.scored(&frames, with_friction(0.5, 0.5)));
  keep_contact_scores(a, frames);
  EXPECT_FALSE(a.force_rms_percent);
  EXPECT_DOUBLE_EQ(*a.friction_cone_percent, 50.0);
  ASSERT_EQ(frames.surface->friction_ratio.size(), t.path.size());
  EXPECT_EQ(frames.surface->friction_ratio[0], 0.0);
  EXPECT_NEAR(frames.surface->friction_ratio[3], 0.8, 1e-12);
  // Scored again from what was kept: the same.
  const auto again =
      test::value_of(rescore(t.path, t.trace, t.reference, frames.surface, with_friction(0.5, 0.5)));
  EXPECT_EQ(again.friction_cone_percent, a.friction_cone_percent);
  EXPECT_EQ(again.stick_drift_mm_s, a.stick_drift_mm_s);
  TruthSamples of_another = *frames.surface;
  of_another.friction_ratio.pop_back();
  EXPECT_FALSE(rescore(t.path, t.trace, t.reference, of_another, with_friction(0.5, 0.5)));
}

}  // namespace
}  // namespace palpate::metrics
