// Steps of a force in a closed loop: which of them the HIP's move explains.
#include "toolkit/metrics/force_steps.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace palpate::metrics {
namespace {

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
