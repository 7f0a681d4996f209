// What a hand feels as plainly wrong: caught, lost, kicked.
#include <gtest/gtest.h>

#include "tests/toolkit/metrics/tiny.h"
#include "toolkit/metrics/wrong_moments.h"

namespace palpate::metrics {
namespace {

constexpr double kDeep = -1.0;

/// So many frames at one depth.
void stay(Tiny& t, int frames, double z_mm = kDeep) {
  for (int i = 0; i < frames; ++i) t.add(z_mm);
}

TEST(Moments, ARightTraceHasNone) {
  Tiny t;
  t.add(0.5);
  stay(t, 50);
  const Accuracy a = t.scored().value();
  EXPECT_EQ(a.caught, 0u);
  EXPECT_EQ(a.lost, 0u);
  EXPECT_EQ(a.kicks, 0u);
  EXPECT_EQ(a.caught_frames, 0u);
  EXPECT_EQ(a.lost_frames, 0u);
  EXPECT_DOUBLE_EQ(*a.force_peak_n, 0.5);
  EXPECT_EQ(a.force_peak_excess_percent, 0.0);
}

TEST(Moments, LostIsTrueContactWithoutAForceForTwentyMilliseconds) {
  for (const int frames : {20, 21}) {
    Tiny t;
    t.add(0.5);
    stay(t, 5);
    for (int i = 0; i < frames; ++i) {
      render::Frame& frame = t.add(kDeep);
      frame.contact = false;
      frame.force_n = Vec3::Zero();
      frame.god_object_mm = t.path.hip_mm.back();
    }
    stay(t, 5);
    const Accuracy a = t.scored().value();
    EXPECT_EQ(a.lost, frames == 21 ? 1u : 0u) << frames;
    EXPECT_EQ(a.lost_frames, frames == 21 ? 21u : 0u);
    EXPECT_EQ(a.caught, 0u) << "a free god object is not caught";
  }
  Tiny shallow;
  shallow.add(0.5);
  for (int i = 0; i < 50; ++i) shallow.add(-0.05).force_n = Vec3::Zero();
  EXPECT_EQ(shallow.scored()->lost, 0u) << "a tenth of a millimetre is no depth";
}

TEST(Moments, CaughtIsAGodObjectFarFromTheTrueOne) {
  // Two spacings are 2 / 1.5 of the local resolution: of coarse points more than a millimetre.
  for (const auto& [off_mm, resolution_mm, caught] :
       {std::tuple{0.9, 0.1, 0u}, {1.1, 0.1, 1u}, {1.1, 3.0, 0u}, {4.1, 3.0, 1u}}) {
    Tiny t;
    t.add(0.5);
    for (int i = 0; i < 30; ++i) {
      render::Frame& frame = t.add(kDeep, resolution_mm);
      frame.god_object_mm.x() += off_mm;
      frame.force_n = kStiffness * (frame.god_object_mm - t.path.hip_mm.back());
    }
    const Accuracy a = t.scored().value();
    EXPECT_EQ(a.caught, caught) << off_mm << " of " << resolution_mm;
    EXPECT_EQ(a.caught_frames, 30u * caught);
  }
}

TEST(Moments, AHandThatIsHeldWhereTheTruthIsFreeIsCaughtAsWell) {
  Tiny t;
  for (int i = 0; i < 30; ++i) {
    render::Frame& frame = t.add(2.0);
    frame.contact = true;
    frame.god_object_mm.z() = 4.0;
    frame.force_n = Vec3(0, 0, 1);
  }
  EXPECT_EQ(t.scored()->caught, 1u);
  // History does not excuse it.
  for (trace::TruthFrame& frame : t.reference.frames) frame.history_decides = true;
  EXPECT_EQ(t.scored()->caught, 1u);
}

TEST(Moments, AKickIsAStepThatTheTruthHasNotNearby) {
  const auto kicks_of = [](double step_n, int true_step_after) {
    Tiny t;
    t.add(0.5);
    stay(t, 50);
    // The truth steps as well, so many frames later, from 0.5 to 1.5 N.
    for (int i = 0; i < 60; ++i) {
      const bool late = true_step_after >= 0 && i >= true_step_after;
      t.add(late ? 3.0 * kDeep : kDeep).force_n = Vec3(0, 0, 0.5 + step_n);
    }
    return t.scored()->kicks.value();
  };
  EXPECT_EQ(kicks_of(0.4, -1), 0u);
  EXPECT_EQ(kicks_of(0.6, -1), 1u);
  EXPECT_EQ(kicks_of(1.0, 10), 0u) << "the truth's own, a little earlier";
  EXPECT_EQ(kicks_of(1.0, 40), 1u);
}

TEST(Moments, TheLongestStretchAndTheLargestStepAreNamed) {
  Tiny t;
  t.add(0.5);
  stay(t, 50);
  for (const int frames : {25, 30}) {
    for (int i = 0; i < frames; ++i) t.add(kDeep).force_n = Vec3::Zero();
    stay(t, 50);
  }
  t.add(kDeep).force_n = Vec3(0, 0, 0.9);
  const WrongMoments wrong = wrong_moments(t.path, t.trace.frames, t.reference.frames);
  EXPECT_EQ(wrong.lost.episodes, 2u);
  EXPECT_EQ(wrong.lost.frames, 55u);
  EXPECT_EQ(wrong.lost.longest_at, 126u);
  EXPECT_DOUBLE_EQ(wrong.kick_max_n, 0.5) << "to 0 and back, each time; 0.4 at the end";
  EXPECT_EQ(wrong.kicks, 0u);
}

TEST(Moments, ThePeakIsComparedWithTheTruths) {
  Tiny t;
  t.add(0.5);
  stay(t, 10);
  t.add(kDeep).force_n = Vec3(0, 0, 0.8);
  const Accuracy a = t.scored().value();
  EXPECT_DOUBLE_EQ(*a.force_peak_n, 0.8);
  EXPECT_NEAR(*a.force_peak_excess_percent, 60.0, 1e-9);
}

}  // namespace
}  // namespace palpate::metrics
