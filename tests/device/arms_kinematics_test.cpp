// Chains and five-bar linkages: by the published formulas, by their own constraints, by finite differences.

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "device/arms/arm_description.h"
#include "toolkit/core/random.h"

namespace palpate::device {
namespace {

constexpr double kDeg = std::numbers::pi / 180.0;

ArmGeometry wood() {
  return {ArmLinkage::kChain, {80, 205, 245, 0, 0, 0}, Vec3(220, 0, 80)};
}
ArmGeometry third_polhem() {
  return {ArmLinkage::kFiveBar, {34, 165, 25, 190, 34, 130.8}, Vec3(204.5, 0, 32.5)};
}
ArmAngles any_angles(Random& random) {
  return {random.uniform(-3, 3), random.uniform(-3, 3), random.uniform(-3, 3)};
}

TEST(ArmKinematics, TheRestPoseOfWoodIsAsMeasuredWithARuler) {
  // Upper arm upright, forearm level: 245 in front of the axis, 80 + 205 above the table.
  const auto pose = arm_pose(wood(), {0, 0, 90 * kDeg});
  ASSERT_TRUE(pose);
  EXPECT_NEAR((pose->position_mm - Vec3(25, 0, 205)).norm(), 0.0, 1e-12);
  // Both level, turned left by a right angle.
  EXPECT_NEAR((arm_pose(wood(), {90 * kDeg, 90 * kDeg, 90 * kDeg})->position_mm - Vec3(-220, 450, 0)).norm(),
              0.0, 1e-12);
}

TEST(ArmKinematics, AChainShowsForcesAsItsMakersPublished) {
  Random random(31);
  const ArmGeometry arm = wood();
  for (int i = 0; i < 2000; ++i) {
    const ArmAngles q = any_angles(random);
    const Vec3 f = Vec3{random.normal(), random.normal(), random.normal()};
    const double upper = 205, fore = 245, rho = upper * std::sin(q[1]) + fore * std::sin(q[2]);
    const double radial = f.x() * std::cos(q[0]) + f.y() * std::sin(q[0]);
    const Vec3 published(rho * (f.y() * std::cos(q[0]) - f.x() * std::sin(q[0])),
                         upper * (radial * std::cos(q[1]) - f.z() * std::sin(q[1])),
                         fore * (radial * std::cos(q[2]) + f.z() * std::sin(q[2])));
    ASSERT_NEAR((torques_n_mm(*arm_pose(arm, q), f) - published).norm(), 0.0, 1e-10) << "seed 31, " << i;
  }
}

TEST(ArmKinematics, AFiveBarKeepsItsRodsLength) {
  Random random(32);
  const ArmGeometry arm = third_polhem();
  int found = 0;
  for (int i = 0; i < 20000; ++i) {
    const ArmAngles q = any_angles(random);
    const auto pose = arm_pose(arm, q);
    if (!pose) continue;
    ++found;
    // Back from the grip: the plane, the elbow, the forearm's direction, the rod's end behind the elbow.
    const Vec3 base = pose->position_mm + arm.origin_mm;
    const double rho = base.x() * std::cos(q[0]) + base.y() * std::sin(q[0]);
    const Eigen::Vector2d grip(rho, base.z());
    const Eigen::Vector2d elbow(17 + 165 * std::cos(q[1]), 165 * std::sin(q[1]));
    const Eigen::Vector2d crank(-17 + 25 * std::cos(q[2]), 25 * std::sin(q[2]));
    ASSERT_NEAR((grip - elbow).norm(), 130.8, 1e-9);
    const Eigen::Vector2d behind = elbow - (grip - elbow) * (34 / 130.8);
    ASSERT_NEAR((behind - crank).norm(), 190.0, 1e-9) << "seed 32, " << i;
    ASSERT_NEAR(-base.x() * std::sin(q[0]) + base.y() * std::cos(q[0]), 0.0, 1e-9);
  }
  EXPECT_GT(found, 1000);
}

TEST(ArmKinematics, JacobiansAgreeWithFiniteDifferences) {
  Random random(33);
  for (const ArmGeometry& arm : {wood(), third_polhem()}) {
    int checked = 0;
    double worst = 0.0;
    for (int i = 0; i < 20000; ++i) {
      const ArmAngles q = any_angles(random);
      const auto pose = arm_pose(arm, q);
      // Near where the rod is in line the differences are no longer small.
      if (!pose || pose->mm_per_rad.cwiseAbs().maxCoeff() > 500) continue;
      const double h = 1e-5;
      bool whole = true;
      Mat3 differences;
      for (int k = 0; k < 3 && whole; ++k) {
        ArmAngles more = q, less = q;
        more[static_cast<std::size_t>(k)] += h;
        less[static_cast<std::size_t>(k)] -= h;
        const auto above = arm_pose(arm, more), below = arm_pose(arm, less);
        whole = above && below;
        if (whole) differences.col(k) = (above->position_mm - below->position_mm) / (2 * h);
      }
      if (!whole) continue;
      ++checked;
      worst = std::max(worst, (differences - pose->mm_per_rad).cwiseAbs().maxCoeff());
    }
    EXPECT_GT(checked, 1000);
    // h^2 / 6 times a third derivative, which in a linkage grows as the square of the Jacobian.
    EXPECT_LT(worst, arm.linkage == ArmLinkage::kChain ? 1e-6 : 1e-3) << "seed 33";
    std::printf("%s: differs from finite differences by %.1e mm/rad at most, of %d poses\n",
                arm.linkage == ArmLinkage::kChain ? "chain" : "five-bar", worst, checked);
  }
}

TEST(ArmKinematics, LinkagesThatCannotBeAreRefused) {
  const ArmGeometry arm = third_polhem();
  // Both cranks level to the right: the rod would have to be 190 and is 216 at most.
  EXPECT_FALSE(arm_pose(arm, {0, 0, 0}));
  // The other form: the mirror of a good pose.
  const double b = 2.178, c = 4.162;
  ASSERT_TRUE(arm_pose(arm, {0, b, c}));
  EXPECT_FALSE(arm_pose(arm, {0, -b, -c}));
  const double nan = std::nan("");
  EXPECT_FALSE(arm_pose(arm, {0, nan, c}));
  EXPECT_FALSE(arm_pose(wood(), {nan, 0, 0}));
  EXPECT_FALSE(arm_pose(wood(), {0, std::numeric_limits<double>::infinity(), 0}));
}

TEST(ArmKinematics, TheWeightIsHeldByTheGradientOfItsHeight) {
  Random random(34);
  const ArmGeometry arm = wood();
  const ArmMasses masses{0.170, 51, 0.110, 91};
  const auto energy = [&](const ArmAngles& q) {  // N*mm
    const double upper = 80 + 51 * std::cos(q[1]), fore = 80 + 205 * std::cos(q[1]) - 91 * std::cos(q[2]);
    return 9.81 * (0.170 * upper + 0.110 * fore);
  };
  for (int i = 0; i < 500; ++i) {
    const ArmAngles q = any_angles(random);
    const Vec3 torques = weight_torques_n_mm(arm, masses, q);
    for (std::size_t k = 0; k < 3; ++k) {
      ArmAngles more = q, less = q;
      more[k] += 1e-4;
      less[k] -= 1e-4;
      ASSERT_NEAR(torques[static_cast<int>(k)], (energy(more) - energy(less)) / 2e-4, 1e-5)
          << "seed 34, " << i;
    }
  }
  EXPECT_EQ(weight_torques_n_mm(third_polhem(), masses, {0, 2, 4}), Vec3(0, 0, 0));
}

/// Angles for a place, from ones near it; nothing where Newton does not get there.
std::optional<ArmAngles> angles_of(const ArmGeometry& arm, const Vec3& place_mm, ArmAngles q) {
  for (int i = 0; i < 60; ++i) {
    const auto pose = arm_pose(arm, q);
    if (!pose) return std::nullopt;
    const Vec3 left = place_mm - pose->position_mm;
    if (left.norm() < 1e-8) return q;
    const Vec3 step = pose->mm_per_rad.inverse() * left;
    const double share = std::min(1.0, 0.05 / step.norm());
    for (int k = 0; k < 3; ++k) q[static_cast<std::size_t>(k)] += share * step[k];
  }
  return std::nullopt;
}

// Poses with the grip at the origin, found by hand.
ArmAngles at_origin(const ArmDescription& arm) {
  if (arm.geometry.linkage == ArmLinkage::kFiveBar) return {0.0, 52 * kDeg, 135 * kDeg};
  return {0.0, 20 * kDeg, 60 * kDeg};
}

TEST(ArmKinematics, KnownArmsReachTheirWholeWorkspace) {
  Random random(35);
  for (const KnownArm& known : built_in_arms()) {
    const ArmDescription arm = find_arm(known.name).value();
    auto q = angles_of(arm.geometry, Vec3::Zero(), at_origin(arm));
    ASSERT_TRUE(q) << known.name << " cannot be at its origin";
    const Vec3 half = arm.limits.workspace_mm.high_mm;
    double least = 1e300;
    for (int i = 0; i < 400; ++i) {
      Vec3 way = Vec3{random.normal(), random.normal(), random.normal()};
      way *= std::cbrt(random.uniform()) / way.norm();
      const Vec3 place = way.cwiseProduct(half);
      ArmAngles now = *q;
      for (int step = 1; step <= 10; ++step) {
        const auto next = angles_of(arm.geometry, place * (step / 10.0), now);
        ASSERT_TRUE(next) << known.name << " does not reach " << place.transpose() << ", seed 35";
        now = *next;
      }
      // The weakest force that the cap of current leaves, in any direction.
      Mat3 ma_per_n = arm_pose(arm.geometry, now)->mm_per_rad.transpose();
      for (int k = 0; k < 3; ++k) ma_per_n.row(k) *= arm.ma_per_n_mm(static_cast<std::size_t>(k));
      least = std::min(least, 1e3 * arm.current_cap_a / ma_per_n.rowwise().norm().maxCoeff());
    }
    RecordProperty(known.name + "_weakest_n", std::to_string(least));
    std::printf("%s: %.2f N in every direction in its workspace\n", known.name.c_str(), least);
    EXPECT_GE(least, arm.limits.force_max_n) << known.name << ": what it declares, it must be able to show";
  }
}

}  // namespace
}  // namespace palpate::device
