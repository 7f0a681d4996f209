// Coulomb's law, by hand.
#include <gtest/gtest.h>

#include "tests/toolkit/metrics/tiny.h"
#include "toolkit/metrics/score_io.h"

namespace palpate::metrics {
namespace {

AccuracyOptions with_friction(double mu_s, double mu_d) {
  AccuracyOptions options;
  options.static_friction = mu_s;
  options.dynamic_friction = mu_d;
  return options;
}

/// The HIP goes along x, 1 mm deep, 0.1 mm a frame; the god object trails by `trail` x depth.
Tiny dragged(const std::vector<double>& trails) {
  Tiny t;
  t.add(1.0);
  double x = 0.0;
  for (const double trail : trails) {
    x += 0.1;
    render::Frame& frame = t.add(-1.0, 0.1, x);
    frame.god_object_mm = {x - trail, 0.0, 0.0};
    frame.force_n = kStiffness * (frame.god_object_mm - Vec3(x, 0.0, -1.0));
  }
  return t;
}

Accuracy scored(const Tiny& t, const AccuracyOptions& options) {
  const Result<Accuracy> a = score(t.path, t.trace, t.reference, &Tiny::half_space, options);
  EXPECT_TRUE(a) << (a ? "" : a.error().message());
  return a ? *a : Accuracy{};
}

TEST(Friction, StickThenSlipByTheLaw) {
  // Stuck at x = 0.1 while the trail grows to the cone, then along at the dynamic coefficient.
  const Accuracy a = scored(dragged({0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.5, 0.5}), with_friction(0.5, 0.5));
  EXPECT_EQ(a.friction_cone_percent, 0.0);
  EXPECT_NEAR(*a.friction_slip_error_percent, 0.0, 1e-9);
  EXPECT_EQ(a.stick_slip_percent, 100.0);
  EXPECT_NEAR(*a.stick_drift_mm_s, 0.0, 1e-9);
}

TEST(Friction, OutsideTheConeIsSeen) {
  const Accuracy a = scored(dragged({0.0, 0.1, 0.8, 0.8}), with_friction(0.5, 0.5));
  EXPECT_DOUBLE_EQ(*a.friction_cone_percent, 50.0);
  EXPECT_NEAR(*a.friction_slip_error_percent, 60.0, 1e-9);  // 0.8 for 0.5
}

TEST(Friction, CreepInsideTheConeIsNoStick) {
  // Carried along with the HIP at a trail of 0.2 where it should be held: 100 mm/s of drift.
  const Accuracy a = scored(dragged({0.2, 0.2, 0.2, 0.2, 0.2}), with_friction(0.5, 0.5));
  EXPECT_EQ(a.friction_cone_percent, 0.0);
  EXPECT_EQ(a.stick_slip_percent, 0.0);
  EXPECT_NEAR(*a.stick_drift_mm_s, 100.0, 1e-9);
  EXPECT_NEAR(*a.friction_slip_error_percent, 60.0, 1e-9);
}

TEST(Friction, AForceThatPullsIsOutsideTheCone) {
  Tiny t = dragged({0.1, 0.1});
  t.trace.frames[2].force_n = {0.0, 0.0, -0.4};
  EXPECT_DOUBLE_EQ(*scored(t, with_friction(0.5, 0.5)).friction_cone_percent, 50.0);
}

TEST(Friction, IsNothingWithoutFrictionOrSurface) {
  const Tiny t = dragged({0.1, 0.1});
  EXPECT_FALSE(scored(t, {}).friction_cone_percent);
  const Result<Accuracy> a = score(t.path, t.trace, t.reference, nullptr, with_friction(0.5, 0.4));
  ASSERT_TRUE(a);
  EXPECT_FALSE(a->friction_cone_percent || a->stick_drift_mm_s);
}

TEST(Friction, StaysWhereForcesAreNotCompared) {
  const Tiny t = dragged({0.0, 0.1, 0.8, 0.8});
  AccuracyFrames frames;
  Result<Accuracy> a =
      score(t.path, t.trace, t.reference, &Tiny::half_space, with_friction(0.5, 0.5), &frames);
  ASSERT_TRUE(a);
  keep_contact_scores(*a, frames);
  EXPECT_FALSE(a->force_rms_percent);
  EXPECT_DOUBLE_EQ(*a->friction_cone_percent, 50.0);
  ASSERT_EQ(frames.surface->friction_ratio.size(), t.path.size());
  EXPECT_EQ(frames.surface->friction_ratio[0], 0.0);
  EXPECT_NEAR(frames.surface->friction_ratio[3], 0.8, 1e-12);
  // Scored again from what was kept: the same.
  const Result<Accuracy> again =
      score_again(t.path, t.trace, t.reference, frames.surface, with_friction(0.5, 0.5));
  ASSERT_TRUE(again);
  EXPECT_EQ(again->friction_cone_percent, a->friction_cone_percent);
  EXPECT_EQ(again->stick_drift_mm_s, a->stick_drift_mm_s);
  SurfaceAnswers of_another = *frames.surface;
  of_another.friction_ratio.pop_back();
  EXPECT_FALSE(score_again(t.path, t.trace, t.reference, of_another, with_friction(0.5, 0.5)));
}

}  // namespace
}  // namespace palpate::metrics
