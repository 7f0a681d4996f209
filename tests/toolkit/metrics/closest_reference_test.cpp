// The reference without history, and the frames that history decides.
#include "toolkit/metrics/closest_reference.h"

#include <gtest/gtest.h>

#include "tests/toolkit/metrics/tiny.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/metrics/reference.h"

namespace palpate::metrics {
namespace {

/// A plate of 1 mm, z from -1 to 0.
class Plate final : public TruthSurface {
 public:
  double signed_distance_mm(const Vec3& p) const override { return std::abs(p.z() + 0.5) - 0.5; }
  geometry::SurfacePoint closest(const Vec3& p) const override {
    const bool above = p.z() >= -0.5;
    return {{p.x(), p.y(), above ? 0.0 : -1.0}, above ? Vec3(Vec3::UnitZ()) : Vec3(-Vec3::UnitZ())};
  }
};

TEST(History, DecidesWhereAThinPartIsCrossed) {
  Tiny t;  // held by the upper sheet, down to 2 mm
  for (const double z : {0.5, -0.2, -0.4, -0.7, -1.5, -2.0, -0.3, 0.5}) t.add(z);
  const auto second = closest_reference(Plate(), t.path, kStiffness, 0.0, no_progress());
  ASSERT_TRUE(second) << second.error().message();
  EXPECT_EQ(second->name, "closest-point");
  const auto tally = compare_references(t.reference, *second, t.path);
  ASSERT_TRUE(tally) << tally.error().message();
  EXPECT_TRUE(t.reference.compared);
  EXPECT_EQ(tally->contact, 6u);
  EXPECT_EQ(tally->place, 1u);  // -0.7: the lower side is nearer
  EXPECT_EQ(tally->state, 2u);  // -1.5, -2.0: beyond it
  EXPECT_DOUBLE_EQ(tally->share_percent, 50.0);
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
  const auto second = closest_reference(Plate(), wrong.path, kStiffness, 0.0, no_progress());
  ASSERT_TRUE(second);
  const auto before = wrong.scored();
  ASSERT_TRUE(before);
  EXPECT_EQ(before->missed_contact_frames, 2u);
  EXPECT_FALSE(before->history_frames) << "nobody compared";
  EXPECT_FALSE(before->force_rms_whole_percent);
  for (Tiny* t : {&right, &wrong}) ASSERT_TRUE(compare_references(t->reference, *second, t->path));
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
  EXPECT_NEAR(*a->force_rms_whole_percent, *before->force_rms_percent, 1e-12);
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
      auto first = analytic_reference(*ball, path, kStiffness, 0.0, pose);
      ASSERT_TRUE(first) << first.error().message();
      const auto second = closest_reference(AnalyticTruth(*ball, pose), path, kStiffness, 0.0, no_progress());
      ASSERT_TRUE(second);
      const auto tally = compare_references(*first, *second, path);
      ASSERT_TRUE(tally);
      EXPECT_GT(tally->contact, 500u);
      EXPECT_EQ(tally->state + tally->place, 0u) << scale << " " << away << " " << first->exactness;
    }
}

TEST(History, RefusesWhatDoesNotFit) {
  Tiny t;
  t.add(-0.5);
  EXPECT_FALSE(closest_reference(Plate(), t.path, kStiffness, 0.0, no_progress())) << "starts inside";
  Tiny u;
  u.add(0.5);
  EXPECT_FALSE(closest_reference(Plate(), u.path, 0.0, 0.0, no_progress()));
  EXPECT_FALSE(compare_references(u.reference, {}, u.path));
  EXPECT_FALSE(u.reference.compared);
}

}  // namespace
}  // namespace palpate::metrics
