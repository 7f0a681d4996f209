// What a touch tells, on traces whose truth is known.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "experiments/psychophysics/cues.h"
#include "toolkit/metrics/force_steps.h"

namespace palpate::experiments::psychophysics {
namespace {

constexpr double kStepS = 1e-3;

/// A press on a spring: in and out again as a cosine, with a ripple of `ripple_n` at `ripple_hz` while it
/// rests.
std::vector<FeltSample> pressed(double stiffness, double depth_mm, double ripple_n = 0.0,
                                double ripple_hz = 100.0) {
  std::vector<FeltSample> samples;
  constexpr int kSamples = 2500;
  for (int i = 0; i < kSamples; ++i) {
    FeltSample one;
    one.t_s = i * kStepS;
    one.interval = 1;
    // Down in half a second, a second and a half at rest, up in half a second.
    const double way = std::min({one.t_s / 0.5, 1.0, (2.5 - one.t_s) / 0.5});
    const double depth = depth_mm * 0.5 * (1.0 - std::cos(std::numbers::pi * way));
    one.at_mm = Vec3{0.0, 0.0, -depth};
    one.contact = i > 0;
    const double ripple =
        way >= 1.0 ? ripple_n * std::sin(2.0 * std::numbers::pi * ripple_hz * one.t_s) : 0.0;
    one.force_n = Vec3{0.0, 0.0, stiffness * depth + ripple};
    samples.push_back(one);
  }
  return samples;
}

TEST(Sensations, AStepIsAJustNoticeableDifference) {
  for (const double floor : {0.01, 1.0})
    for (const double weber : {0.07, 0.3}) {
      // One step from nothing is the floor, and above the knee a share of `weber`.
      EXPECT_NEAR(sensation(floor, floor, weber), 1.0, 1e-12);
      for (const double x : {2.0 * floor / weber, 50.0 * floor / weber})
        EXPECT_NEAR(sensation(x * (1.0 + weber), floor, weber) - sensation(x, floor, weber), 1.0, 1e-12);
      const double knee = floor / weber;
      EXPECT_NEAR(sensation(knee * (1.0 + 1e-9), floor, weber), sensation(knee * (1.0 - 1e-9), floor, weber),
                  1e-6);
    }
}

TEST(CuesOfATouch, StiffnessIsThatOfTheSpring) {
  for (const double stiffness : {0.2, 0.5, 2.0})
    EXPECT_NEAR(cues_of(pressed(stiffness, 2.0), {}).stiffness_n_per_mm, stiffness, 1e-6 * stiffness);
  // A ripple at rest says nothing of it.
  EXPECT_NEAR(cues_of(pressed(0.5, 2.0, 0.01), {}).stiffness_n_per_mm, 0.5, 0.005);
}

TEST(CuesOfATouch, ForceAndDirectionAreThoseOfTheContact) {
  std::vector<FeltSample> samples(10);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].t_s = static_cast<double>(i) * kStepS;
    samples[i].contact = i >= 4;
    if (samples[i].contact) samples[i].force_n = Vec3{0.3, 0.0, 0.4};
  }
  const Cues cues = cues_of(samples, {});
  EXPECT_TRUE(cues.touched);
  EXPECT_NEAR(cues.force_n, 0.5, 1e-12);
  EXPECT_NEAR((cues.direction - Vec3{0.6, 0.0, 0.8}).norm(), 0.0, 1e-12);
  const Cues none = cues_of(std::span(samples).first(4), {});
  EXPECT_FALSE(none.touched);
  EXPECT_EQ(none.vibration, 0.0);
  EXPECT_EQ(none.stiffness_n_per_mm, 0.0);
}

/// A force of F at f moves m by F / (m w^2): that amplitude over the one that is just noticed.
TEST(CuesOfATouch, VibrationIsInNoticedAmplitudes) {
  Thresholds thresholds;
  for (const double hz : {60.0, 200.0, 400.0}) {
    const double omega = 2.0 * std::numbers::pi * hz;
    const double force_n =
        5.0 * metrics::detection_threshold_um(hz) * 1e-6 * thresholds.moved_kg * omega * omega;
    // Stretches in the press and out of it rest without the ripple: more than half of it is at rest.
    const double alone = cues_of(pressed(0.5, 2.0), thresholds).vibration;
    const double found = cues_of(pressed(0.5, 2.0, force_n, hz), thresholds).vibration;
    EXPECT_GT(found, 5.0 * std::sqrt(0.5)) << hz;
    EXPECT_LT(found, 5.0 * 1.05 + alone) << hz;
    thresholds.moved_kg *= 2.0;
    EXPECT_NEAR(cues_of(pressed(0.0, 2.0, 2.0 * force_n, hz), thresholds).vibration /
                    cues_of(pressed(0.0, 2.0, force_n, hz), thresholds).vibration,
                2.0, 1e-9);
    thresholds.moved_kg *= 0.5;
  }
}

TEST(CuesOfATouch, TurnsAreInThresholds) {
  Cues cues;
  cues.touched = true;
  const double turn = 25.6 * std::numbers::pi / 180.0;
  const Vec3 from = Vec3::UnitZ(), to{std::sin(0.01), 0.0, std::cos(0.01)};
  cues.direction = Vec3{std::sin(turn), 0.0, std::cos(turn)};
  // What is counted is the sine: 3.3 % short of the angle.
  EXPECT_NEAR(scales_of(cues, {}, from, to)[3], 1.0, 0.035);
  cues.direction = from;
  EXPECT_NEAR(scales_of(cues, {}, from, to)[3], 0.0, 1e-12);
  EXPECT_EQ(scales_of(cues, {}, from, from)[3], 0.0) << "nothing is turned";
}

}  // namespace
}  // namespace palpate::experiments::psychophysics
