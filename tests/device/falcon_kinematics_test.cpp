// The Falcon's arm against published and computed numbers, against itself, and against finite differences.
#include "device/falcon/falcon_device.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "toolkit/core/random.h"

namespace palpate::device {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
const Vec3 kCentre{0.0, 0.0, kFalconCentreMm};

Vec3 in_sphere(Random& random, double radius_mm) {
  for (;;) {
    const Vec3 place{2.0 * random.uniform() - 1.0, 2.0 * random.uniform() - 1.0,
                     2.0 * random.uniform() - 1.0};
    if (place.norm() <= 1.0) return kCentre + radius_mm * place;
  }
}

struct Known {
  Vec3 place_mm, angles_degrees, counts;
};

TEST(FalconKinematics, KnownPoses) {
  const std::array<Known, 3> known = {
      Known{{0, 0, 130}, {31.494, 31.494, 31.494}, {-96.2, -96.2, -96.2}},
      Known{{20, -30, 130}, {54.982, 20.707, 32.814}, {548.4, -392.3, -60.0}},
      Known{{-25, 15, 105}, {-0.064, 34.838, 12.046}, {-962.4, -4.5, -630.0}}};
  for (const Known& one : known) {
    const auto angles = falcon_angles(one.place_mm);
    ASSERT_TRUE(angles);
    EXPECT_LT((kDegrees * *angles - one.angles_degrees).cwiseAbs().maxCoeff(), 0.0006);
    EXPECT_LT((falcon_counts_of_angles(*angles) - one.counts).cwiseAbs().maxCoeff(), 0.06);
    const FalconPose pose = falcon_position(*angles, kCentre);
    EXPECT_TRUE(pose.converged);
    EXPECT_LT((pose.position_mm - one.place_mm).norm(), 1e-6);
  }
  EXPECT_NEAR(kDegrees * falcon_angles_of_counts(Vec3{1, 0, 0}).x(), 35.036435, 1e-6);
}

TEST(FalconKinematics, JacobianAndTorquesAtTheCentre) {
  const Vec3 angles = falcon_angles(kCentre).value();
  const Mat3 jacobian = falcon_jacobian(kCentre, angles).value();
  Mat3 known;
  known << 0.002967, -0.009864, 0.013238, -0.010026, 0.002363, 0.013238, 0.007059, 0.007501, 0.013238;
  EXPECT_LT((jacobian - known).cwiseAbs().maxCoeff(), 6e-7);
  EXPECT_LT((falcon_torques(jacobian, Vec3{1, 0, 0}).value() - Vec3(18.64, -62.99, 44.35)).norm(), 0.02);
  EXPECT_LT((falcon_torques(jacobian, Vec3{0, 0, 1}).value() - Vec3(25.18, 25.18, 25.18)).norm(), 0.02);
}

TEST(FalconKinematics, ThereAndBackOverTheWorkspace) {
  Random random(41);
  double worst_rad = 0.0, worst_mm = 0.0;
  int most_steps = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Vec3 place = in_sphere(random, 50.0);
    const Vec3 angles = falcon_angles(place).value();
    const FalconPose pose = falcon_position(angles, kCentre);
    ASSERT_TRUE(pose.converged) << "seed 41, case " << i;
    worst_rad = std::max(worst_rad, (falcon_angles(pose.position_mm).value() - angles).cwiseAbs().maxCoeff());
    worst_mm = std::max(worst_mm, (pose.position_mm - place).norm());
    most_steps = std::max(most_steps, pose.steps);
    // From where it was a frame ago.
    const FalconPose near = falcon_position(angles, place + 0.9 * (in_sphere(random, 1.0) - kCentre));
    ASSERT_TRUE(near.converged && near.steps <= 4) << "seed 41, case " << i;
  }
  EXPECT_LT(worst_rad, 1e-9);
  EXPECT_LT(worst_mm, 2e-7);
  EXPECT_LE(most_steps, kFalconNewtonSteps / 2);
  RecordProperty("worst_angle_rad", std::to_string(worst_rad));
  std::printf("worst after there and back: %.1e rad, %.1e mm; at most %d steps\n", worst_rad, worst_mm,
              most_steps);
}

TEST(FalconKinematics, JacobianIsTheDerivative) {
  Random random(43);
  constexpr double kStep = 1e-4;  // mm: the error of central differences, and that of rounding, below 1e-10
  double worst = 0.0;
  for (int i = 0; i < 2000; ++i) {
    const Vec3 place = in_sphere(random, 50.0);
    const Mat3 jacobian = falcon_jacobian(place, falcon_angles(place).value()).value();
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3 step = kStep * Vec3::Unit(axis);
      const Vec3 slope =
          (falcon_angles(place + step).value() - falcon_angles(place - step).value()) / (2.0 * kStep);
      worst = std::max(worst, (slope - jacobian.col(axis)).cwiseAbs().maxCoeff());
    }
  }
  EXPECT_LT(worst, 1e-10) << "rad/mm, seed 43";
  std::printf("worst difference to finite differences: %.1e rad/mm\n", worst);
}

TEST(FalconKinematics, TorquesDoTheWorkOfTheForce) {
  Random random(47);
  for (int i = 0; i < 1000; ++i) {
    const Vec3 place = in_sphere(random, 40.0);
    const Mat3 jacobian = falcon_jacobian(place, falcon_angles(place).value()).value();
    const Vec3 force = in_sphere(random, 5.0) - kCentre, motion = in_sphere(random, 1.0) - kCentre;
    const Vec3 torques = falcon_torques(jacobian, force).value();
    ASSERT_NEAR(torques.dot(jacobian * motion), force.dot(motion), 1e-9) << "seed 47, case " << i;
  }
}

TEST(FalconKinematics, OutOfReachIsSaidAndBounded) {
  EXPECT_FALSE(falcon_angles(Vec3{0, 0, 400}));
  EXPECT_FALSE(falcon_angles(Vec3{200, 0, 130}));
  EXPECT_FALSE(falcon_angles(Vec3::Constant(std::nan(""))));
  EXPECT_FALSE(falcon_position(Vec3::Constant(std::nan("")), kCentre).converged);
  EXPECT_FALSE(falcon_position(Vec3::Zero(), Vec3{0, 0, 400}).converged);
  EXPECT_FALSE(falcon_torques(Mat3::Zero(), Vec3{1, 0, 0}));
  // Any counts that a packet can hold: a place whose angles these are, or none. Never anything else.
  Random random(53);
  int found = 0;
  for (int i = 0; i < 20'000; ++i) {
    const double most = i % 2 == 0 ? 32768.0 : 3000.0;
    const Vec3 counts{most * (2.0 * random.uniform() - 1.0), most * (2.0 * random.uniform() - 1.0),
                      most * (2.0 * random.uniform() - 1.0)};
    const Vec3 angles = falcon_angles_of_counts(counts);
    const FalconPose pose = falcon_position(angles, kCentre);
    ASSERT_LE(pose.steps, kFalconNewtonSteps);
    ASSERT_TRUE(is_finite(pose.position_mm));
    if (!pose.converged) continue;
    ++found;
    ASSERT_LT((falcon_angles(pose.position_mm).value() - angles).cwiseAbs().maxCoeff(), 1e-9);
    ASSERT_GT(pose.position_mm.z(), 0.0);
  }
  EXPECT_GT(found, 1000);
  EXPECT_LT(found, 19'000);
}

}  // namespace
}  // namespace palpate::device
