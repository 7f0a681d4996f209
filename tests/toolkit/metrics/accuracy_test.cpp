// Every score against a number worked out by hand.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <palpate/accuracy.h>
#include "tests/toolkit/messages.h"
#include "tests/toolkit/metrics/small_traces.h"
#include "toolkit/metrics/force_steps.h"

namespace palpate::metrics {
namespace {

TEST(Accuracy, PerfectTraceHasNoError) {
  Tiny t({0.02, 0.01, -0.01, -0.02, -0.01, 0.01});
  const Accuracy a = t.scores();
  EXPECT_EQ(a.reference, "analytic");
  EXPECT_EQ(a.frames, 6u);
  EXPECT_EQ(a.contact_frames, 3u);
  EXPECT_DOUBLE_EQ(a.floor_n, 0.0275);
  EXPECT_EQ(a.force_rms_n, 0.0);
  EXPECT_EQ(a.force_rms_percent, 0.0);
  EXPECT_EQ(a.force_max_n, 0.0);
  EXPECT_EQ(a.within_7_percent, 100.0);
  EXPECT_EQ(a.within_10_percent, 100.0);
  EXPECT_EQ(a.excess_jump_max_n, 0.0);
  EXPECT_EQ(a.excess_jumps, 0u);
  EXPECT_EQ(a.missed_contact_frames + a.false_contact_frames + a.longest_stick_frames, 0u);
  EXPECT_EQ(a.pop_throughs, 0u);
  EXPECT_EQ(a.fall_throughs, 0u);
  EXPECT_DOUBLE_EQ(*a.pop_through_rate_upper_95, 3.0);  // 3 / 1 episode: frames of one follow each other
  EXPECT_EQ(a.episodes, 1u);
  EXPECT_EQ(a.god_object_rms_mm, 0.0);
  EXPECT_EQ(a.god_object_surface_max_mm, 0.0);
  EXPECT_FALSE(a.direction_p99_deg.has_value()) << "0.01 N is below the floor";
  EXPECT_DOUBLE_EQ(*a.onset_error_mm, 0.01);
  EXPECT_DOUBLE_EQ(*a.onset_error_mean_mm, -0.01);
  EXPECT_DOUBLE_EQ(*a.release_error_mm, 0.01);
}

TEST(Accuracy, ForceErrorsSplitAlongTheNormal) {
  Tiny t({1.0});
  t.add(-2.0).force_n = {0.3, 0.0, 1.4};  // true (0, 0, 1): error (0.3, 0, 0.4), size 0.5
  t.add(-2.0);                            // right
  const Accuracy a = t.scores();
  EXPECT_NEAR(*a.force_rms_n, 0.5 / std::sqrt(2.0), 1e-15);
  EXPECT_NEAR(*a.force_rms_percent, 100.0 * 0.5 / std::sqrt(2.0), 1e-12);  // rms of the truth is 1
  EXPECT_NEAR(*a.force_normal_rms_n, 0.4 / std::sqrt(2.0), 1e-15);
  EXPECT_NEAR(*a.force_tangential_rms_n, 0.3 / std::sqrt(2.0), 1e-15);
  EXPECT_NEAR(*a.force_max_n, 0.5, 1e-15);
  EXPECT_DOUBLE_EQ(*a.within_7_percent, 50.0);
}

TEST(Accuracy, KnowsWhatIsNoMoreThanRounding) {
  // At every scale and place: an error in the last digits of the coordinates is none, a real one is.
  for (const double scale : {1e-3, 1.0, 1e6})
    for (const double away : {0.0, 1e5}) {
      Tiny t;
      t.add(1.0 * scale, 0.1, away * scale);
      for (const double wrong : {0.0, 1.0}) {
        render::Frame& frame = t.add(-2.0 * scale, 0.1, away * scale);
        const double size = scale * std::max(2.0, away);
        frame.force_n.z() += wrong * kStiffness * size * std::numeric_limits<double>::epsilon();
      }
      const Accuracy a = t.scores();
      EXPECT_GT(*a.force_max_n, 0.0);
      EXPECT_LE(*a.force_max_n, a.rounding_n) << scale << " " << away;
      EXPECT_LT(a.rounding_n, 1e-6 * scale) << "a millionth of the force is an error";
      EXPECT_DOUBLE_EQ(a.rounding_n, kStiffness * a.rounding_mm);
    }
  Tiny t({1.0});
  AccuracyOptions options;
  options.stored_rounding_mm = 0.25;
  const auto stored = test::value_of(score(t.path, t.trace, t.reference, nullptr, options));
  EXPECT_NEAR(stored.rounding_mm, 0.25, 1e-9) << "what the store lost counts";
}

TEST(Accuracy, BandsAreRelativeAboveTheFloor) {
  Tiny t({1.0});
  t.add(-2.0).force_n.z() = 1.069;    // true 1: within 7 %
  t.add(-2.0).force_n.z() = 1.08;     // within 10 % only
  t.add(-2.0).force_n.z() = 1.11;     // neither
  t.add(-0.02).force_n.z() = 0.0374;  // true 0.01: 0.0274 off, under the floor of 0.0275
  const Accuracy a = t.scores();
  EXPECT_DOUBLE_EQ(*a.within_7_percent, 50.0);
  EXPECT_DOUBLE_EQ(*a.within_10_percent, 75.0);
  AccuracyOptions stiffer;
  stiffer.stiffness_n_per_mm = 2.0;
  EXPECT_DOUBLE_EQ(stiffer.floor_n(), 0.11);
}

TEST(Accuracy, DirectionOverFramesOfTrueForceAndLostOnesCount) {
  Tiny t({1.0});
  t.add(-2.0).force_n = {1.0, 0.0, 1.0};   // 45 degrees
  t.add(-2.0);                             // 0
  t.add(-2.0).force_n = {0.02, 0.0, 0.0};  // lost: as wrong as can be, 180
  t.add(-0.01).force_n = {1.0, 0.0, 0.0};  // the truth too small
  t.add(-2.0).force_n = {0.0, 0.0, -1.0};  // 180
  const Accuracy a = t.scores();
  EXPECT_NEAR(*a.direction_mean_deg, 101.25, 1e-12);
  EXPECT_NEAR(*a.direction_p99_deg, 180.0, 1e-12);  // rank ceil(3.96) = 4
  EXPECT_NEAR(*a.direction_max_deg, 180.0, 1e-12);
}

TEST(Accuracy, ForcesAboutTheFloorAreNotLost) {
  const double floor = AccuracyOptions{}.floor_n();
  Tiny t({1.0});
  // At 0.5 N/mm the true force is a hundredth above the floor, the rendered a hundredth below.
  const double depth = 1.01 * floor / AccuracyOptions{}.stiffness_n_per_mm;
  t.add(-depth).force_n = {0.0, 0.0, 0.99 * floor};
  EXPECT_NEAR(*t.scored()->direction_max_deg, 0.0, 1e-9);
  t.add(-depth).force_n = {0.0, 0.0, 1e-9};  // what nobody feels is no direction
  EXPECT_EQ(*t.scored()->direction_max_deg, 180.0);
  Tiny slightly({1.0});
  slightly.add(-2.0).force_n = {1e-9, 0.0, 1.0};
  EXPECT_NEAR(*slightly.scored()->direction_max_deg, 57.29577951308232e-9, 1e-20);
}

TEST(Accuracy, ExcessJumpsAgainstTheTruthsOwn) {
  Tiny t;
  t.add(-1.0, 0.1, 0.0);
  t.add(-1.0, 0.1, 1.0).force_n.z() = 0.6;   // jump 0.1, truth 0
  t.add(-1.0, 0.1, 2.0).force_n.z() = 0.61;  // jump 0.01: below the floor
  t.add(-1.4, 0.1, 2.0).force_n.z() = 0.7;   // truth jumps 0.2, rendered 0.09
  AccuracyFrames frames;
  const Accuracy a = t.scores(&frames);
  EXPECT_NEAR(*a.excess_jump_max_n, 0.1, 1e-15);
  EXPECT_EQ(a.excess_jumps, 1u);
  EXPECT_NEAR(*a.excess_jumps_per_m, 1.0 / 2.4e-3, 1e-9);  // 1 + 1 + 0.4 mm
  EXPECT_FLOAT_EQ(frames.excess_jump_n[1], 0.1f);
  EXPECT_FLOAT_EQ(frames.excess_jump_n[3], 0.0f);
}

TEST(Accuracy, TrueEdgesAreNoExcessJumps) {
  Tiny t({-1.0});
  t.add(-1.0, 0.1, 0.1);
  // The truth jumps by 0.5 N on 0.1 mm of travel (0.05 N + floor): an edge; the rendered force even more.
  t.reference.frames[1].frame.force_n.x() = 0.5;
  t.trace.frames[1].force_n.x() = 2.0;
  EXPECT_FALSE(t.scored()->excess_jump_max_n.has_value());
  EXPECT_EQ(t.scored()->excess_jumps, 0u);
}

TEST(Accuracy, MissedAndFalseContactBeyondTheLocalResolution) {
  Tiny t;
  const Vec3 none = Vec3::Zero(), some(0.0, 0.0, 0.1);
  t.add(1.0);
  t.add(-0.09).force_n = none;       // shallower than 0.1: allowed
  t.add(-0.11).force_n = none;       // missed
  t.add(-0.11, 0.2).force_n = none;  // allowed where the cloud is coarser
  t.add(0.05).force_n = some;        // allowed
  t.add(0.2).force_n = some;         // false
  t.add(0.3).force_n = some;         // false
  t.add(0.3).force_n = none;
  t.add(0.3).force_n = some;  // false, a run of its own
  AccuracyFrames frames;
  const Accuracy a = t.scores(&frames);
  EXPECT_EQ(a.missed_contact_frames, 1u);
  EXPECT_EQ(a.false_contact_frames, 3u);
  EXPECT_EQ(a.longest_stick_frames, 2u);
  EXPECT_EQ(frames.missed_contact, (std::vector<std::uint8_t>{0, 0, 1, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(frames.false_contact, (std::vector<std::uint8_t>{0, 0, 0, 0, 0, 1, 1, 0, 1}));
}

TEST(Accuracy, OnsetAndReleaseOfEachContact) {
  Tiny t;
  for (const double z : {0.3, 0.1, -0.1, 0.2, 0.3, -0.4, -0.3, 0.1}) t.add(z).force_n.setZero();
  const Vec3 some(0.0, 0.0, 0.1);
  for (const std::size_t i : {1u, 2u, 3u, 5u, 6u}) t.trace.frames[i].force_n = some;
  const Accuracy a = t.scores();
  EXPECT_DOUBLE_EQ(*a.onset_error_mm, 0.4);  // +0.1 and -0.4
  EXPECT_DOUBLE_EQ(*a.onset_error_mean_mm, (0.1 - 0.4) / 2.0);
  EXPECT_DOUBLE_EQ(*a.release_error_mm, 0.3);  // +0.2 and -0.3
  EXPECT_DOUBLE_EQ(*a.release_error_mean_mm, (0.2 - 0.3) / 2.0);
  const Accuracy cut_off = Tiny({-0.1, -0.2}).scores();
  EXPECT_FALSE(cut_off.onset_error_mm || cut_off.onset_error_mean_mm || cut_off.release_error_mm ||
               cut_off.release_error_mean_mm);
}

TEST(Accuracy, GodObjectToItsTruthAndToTheSurface) {
  Tiny t({1.0});
  t.add(-1.0).god_object_mm = {0.3, 0.0, 0.4};    // 0.5 off, 0.4 above
  t.add(-1.0).god_object_mm = {0.0, 0.0, -0.05};  // 0.05 off
  render::Frame& alone = t.add(0.05);  // rendered contact only: not compared with the true god object
  alone.contact = true;
  alone.god_object_mm = {0.0, 0.0, 0.2};
  AccuracyFrames frames;
  const Accuracy a = t.scores(&frames);
  EXPECT_NEAR(*a.god_object_rms_mm, std::sqrt((0.25 + 0.0025) / 2.0), 1e-15);
  EXPECT_DOUBLE_EQ(*a.god_object_max_mm, 0.5);
  EXPECT_NEAR(*a.god_object_surface_rms_mm, std::sqrt((0.16 + 0.0025 + 0.04) / 3.0), 1e-15);
  EXPECT_DOUBLE_EQ(*a.god_object_surface_max_mm, 0.4);
  EXPECT_FLOAT_EQ(frames.god_object_error_mm[1], 0.5f);
  EXPECT_FLOAT_EQ(frames.god_object_error_mm[3], 0.0f);
}

TEST(Accuracy, PathDependenceAtExactlyTheSamePlace) {
  Tiny t({-1.0, -1.1});
  t.add(-1.0).force_n.z() = 0.52;
  t.add(-1.1).force_n.z() = 0.51;
  EXPECT_NEAR(*t.scored()->path_dependence_n, 0.04, 1e-15);  // 0.55 and 0.51
  Tiny once({-1.0, -1.1});
  EXPECT_FALSE(once.scored()->path_dependence_n.has_value());
}

TEST(PopThrough, GodObjectInsideCountsOnceUntilItIsOut) {
  Tiny t({1.0});
  t.add(-1.0).god_object_mm.z() = -0.05;  // shallower than the resolution
  t.add(-1.0).god_object_mm.z() = -0.15;  // in
  t.add(-1.0).god_object_mm.z() = -0.5;   // still in
  t.add(-1.0);                            // out
  t.add(-1.0).god_object_mm.z() = -0.15;  // in again
  const Accuracy a = t.scores();
  EXPECT_EQ(a.pop_throughs, 2u);
  EXPECT_FALSE(a.pop_through_rate_upper_95.has_value());
}

TEST(PopThrough, StepThroughAThickSlab) {
  Tiny t({1.0, -1.0});
  t.add(-1.5).god_object_mm.z() = -3.0;  // the far side
  t.add(-1.6, 0.1, 0.5).god_object_mm.z() = -3.0;
  const Slab slab(3.0);
  const auto a = test::value_of(score(t.path, t.trace, t.reference, &slab, {}));
  EXPECT_EQ(a.pop_throughs, 1u) << "the step and the stay on the far side are one event";
}

TEST(PopThrough, FarSideOfASlabThinnerThanTheResolution) {
  Tiny t;
  const Slab thin(0.05);
  t.add(1.0);
  t.add(-0.02);
  for (int i = 0; i < 5; ++i) {
    t.add(-0.04, 0.1, 0.04 * i).god_object_mm.z() = -0.05;  // 0.16 mm of travel, resolution 0.1
  }
  EXPECT_EQ(score(t.path, t.trace, t.reference, &thin, {})->pop_throughs, 1u);

  Tiny brief;  // two frames on the other side within less than a resolution of travel: lag at an edge
  brief.add(1.0);
  brief.add(-0.02);
  brief.add(-0.04).god_object_mm.z() = -0.05;
  brief.add(-0.04, 0.1, 0.04).god_object_mm.z() = -0.05;
  brief.add(-0.02, 0.1, 0.04);
  EXPECT_EQ(score(brief.path, brief.trace, brief.reference, &thin, {})->pop_throughs, 0u);
}

TEST(PopThrough, AChordOverTheSurfaceIsNone) {
  Tiny t({1.0});
  t.add(-1.0, 0.1, 0.0);
  t.add(-1.0, 0.1, 50.0);  // a long slide along the plane
  EXPECT_EQ(t.scored()->pop_throughs, 0u);
}

TEST(Accuracy, NoContactAtAll) {
  Tiny t({1.0, 0.5, 1.0});
  const Accuracy a = t.scores();
  EXPECT_EQ(a.contact_frames, 0u);
  EXPECT_FALSE(a.force_rms_n || a.force_rms_percent || a.force_max_n || a.within_7_percent ||
               a.within_10_percent || a.direction_mean_deg || a.excess_jump_max_n || a.excess_jumps_per_m ||
               a.god_object_rms_mm || a.god_object_surface_rms_mm || a.onset_error_mm || a.release_error_mm ||
               a.pop_through_rate_upper_95 || a.path_dependence_n);
  EXPECT_EQ(a.pop_throughs, 0u);
}

TEST(Accuracy, NoTrueForceLeavesThePercentageOut) {
  Tiny t({1.0});
  t.add(1.0).force_n.z() = 0.2;
  const Accuracy a = t.scores();
  EXPECT_FALSE(a.force_rms_n || a.force_rms_percent || a.within_7_percent)
      << "no frame of the truth to share it";
  EXPECT_DOUBLE_EQ(*a.force_max_n, 0.2);
  EXPECT_EQ(a.false_contact_frames, 1u);
  EXPECT_EQ(a.indistinguishable_percent, 0.0);
  EXPECT_FALSE(a.excess_jumps_per_m.has_value()) << "no travel";
  EXPECT_EQ(a.excess_jumps, 1u);
}

TEST(Accuracy, ASingleFrame) {
  const Accuracy a = Tiny({-1.0}).scores();
  EXPECT_EQ(a.contact_frames, 1u);
  EXPECT_EQ(a.force_rms_n, 0.0);
  EXPECT_FALSE(a.excess_jump_max_n || a.onset_error_mm || a.path_dependence_n);
}

TEST(Accuracy, WithoutATruthSurfaceItsScoresAreNothing) {
  Tiny t({1.0, -1.0});
  const auto a = test::value_of(score(t.path, t.trace, t.reference, nullptr, {}));
  EXPECT_FALSE(a.pop_throughs || a.pop_through_rate_upper_95 || a.god_object_surface_rms_mm);
  EXPECT_TRUE(a.god_object_rms_mm.has_value());
}

TEST(Accuracy, RefusesWhatCannotBeScored) {
  Tiny t({1.0, -1.0});
  Tiny shorter = t;
  shorter.trace.frames.pop_back();
  EXPECT_FALSE(shorter.scored());
  Tiny less = t;
  less.reference.frames.pop_back();
  EXPECT_FALSE(less.scored());
  EXPECT_FALSE(Tiny{}.scored());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Tiny force = t, distance = t, hip = t;
  force.trace.frames[1].force_n.x() = nan;
  distance.reference.frames[1].signed_distance_mm = nan;
  hip.path.hip_mm[1].x() = std::numeric_limits<double>::infinity();
  for (const Tiny* bad : {&force, &distance, &hip}) EXPECT_FALSE(bad->scored());
  EXPECT_EQ(force.scored().error().line, 3);
}

TEST(Truth, PathsStartInFreeSpace) {
  Tiny t({-1.0});
  EXPECT_TRUE(test::refused(check_starts_free(t.path, t.half_space), "tiny.csv:2: the path starts inside"));
  Tiny free({1.0});
  EXPECT_TRUE(check_starts_free(free.path, free.half_space));
}

// Steps of a force in a closed loop: which of them the HIP's move explains.

constexpr double kPressedNPerMm = 0.5, kTickS = 1e-3;

/// A HIP that falls onto a plane at `speed_mm_s` and goes on to 1 mm below it; `kick_n` once on the way.
ForceSteps pressed(double speed_mm_s, double kick_n, double at_depth_mm) {
  ForceSteps steps(kPressedNPerMm);
  for (int i = 0; i * kTickS * speed_mm_s < 2.0; ++i) {
    const double z_mm = 1.0 - i * kTickS * speed_mm_s;
    double n = kPressedNPerMm * std::max(0.0, -z_mm);
    if (-z_mm > at_depth_mm) n += kick_n;
    steps.observe(i * kTickS, {0.0, 0.0, z_mm}, {0.0, 0.0, n});
  }
  return steps;
}

TEST(ForceSteps, AHandThatHitsASurfaceMakesALargeStepWithoutExcess) {
  const ForceSteps steps = pressed(500.0, 0.0, 2.0);
  EXPECT_NEAR(steps.step().n, kPressedNPerMm * 0.5, 1e-12);
  EXPECT_LT(steps.excess().n, 1e-12);
  EXPECT_EQ(steps.over_clean(), 0u);
}

TEST(ForceSteps, AStepThatNoHandMadeIsCountedOnceWithItsTimeAndPlace) {
  const ForceSteps steps = pressed(50.0, 0.15, 0.5);
  EXPECT_NEAR(steps.excess().n, 0.15, 1e-12);
  EXPECT_NEAR(steps.excess().t_s, 0.031, 2 * kTickS);
  EXPECT_NEAR(steps.excess().hip_mm.z(), -0.5, 0.1);
  EXPECT_EQ(steps.over_clean(), 1u);
  EXPECT_EQ(steps.over_noisy(), 0u);
  EXPECT_EQ(pressed(50.0, 0.25, 0.5).over_noisy(), 1u);
}

TEST(ForceSteps, AForceAfterAnInterruptionIsNoStep) {
  ForceSteps steps(kPressedNPerMm);
  steps.observe(0.0, Vec3::Zero(), Vec3::Zero());
  steps.interrupt();
  steps.observe(kTickS, Vec3::Zero(), {0.0, 0.0, 2.0});
  EXPECT_EQ(steps.step().n, 0.0);
  EXPECT_EQ(steps.over_clean(), 0u);
}

}  // namespace
}  // namespace palpate::metrics
