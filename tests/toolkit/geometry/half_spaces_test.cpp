#include "toolkit/geometry/half_spaces.h"

#include <gtest/gtest.h>

#include <vector>

#include "toolkit/core/random.h"

namespace palpate::geometry {
namespace {

Vec3 unit(Random& random) {
  return Vec3(random.normal(), random.normal(), random.normal()).normalized();
}

TEST(HalfSpaces, NoneHoldsThePointBack) {
  const Vec3 p(1, 2, 3);
  EXPECT_EQ(nearest_allowed({}, p, 0).point, p);
  const std::vector<HalfSpace> away{{Vec3::UnitZ(), -5}};
  EXPECT_EQ(nearest_allowed(away, p, 0).point, p);
}

TEST(HalfSpaces, OneTwoThreeByHand) {
  const std::vector<HalfSpace> planes{{Vec3::UnitX(), 1}, {Vec3::UnitY(), 2}, {Vec3::UnitZ(), 3}};
  const NearestAllowed all = nearest_allowed(planes, Vec3::Zero(), 1e-12);
  EXPECT_LT((all.point - Vec3(1, 2, 3)).norm(), 1e-12);
  EXPECT_NEAR(all.push[2], 3, 1e-12);
  const NearestAllowed two = nearest_allowed(std::span(planes).first(2), Vec3(0, 0, 9), 1e-12);
  EXPECT_LT((two.point - Vec3(1, 2, 9)).norm(), 1e-12);
  EXPECT_TRUE(two.all_hold);
}

TEST(HalfSpaces, OptimalAgainstRandomAllowedPoints) {
  Random random(7);
  for (int trial = 0; trial < 300; ++trial) {
    std::vector<HalfSpace> planes;
    const std::size_t n = 1 + random.below(kMaxHalfSpaces);
    // All contain the origin, so there is room.
    for (std::size_t i = 0; i < n; ++i) planes.push_back({unit(random), -random.uniform()});
    const Vec3 p = 3.0 * unit(random);
    const NearestAllowed found = nearest_allowed(planes, p, 1e-9);
    ASSERT_TRUE(found.all_hold) << trial;
    Vec3 sum = p;
    for (std::size_t i = 0; i < n; ++i) {
      EXPECT_GE(planes[i].normal.dot(found.point), planes[i].offset - 1e-8);
      EXPECT_GE(found.push[i], 0.0);
      sum += found.push[i] * planes[i].normal;
    }
    EXPECT_LT((sum - found.point).norm(), 1e-9);
    const double best = (found.point - p).norm();
    for (int k = 0; k < 2000; ++k) {
      const Vec3 x = found.point + unit(random) * (0.3 * random.uniform());
      bool allowed = true;
      for (const HalfSpace& plane : planes) allowed = allowed && plane.normal.dot(x) >= plane.offset;
      if (allowed) {
        ASSERT_GE((x - p).norm(), best - 1e-9) << trial;
      }
    }
  }
}

TEST(HalfSpaces, NoRoomIsSaidAndNothingIsNotANumber) {
  const std::vector<HalfSpace> facing{{Vec3::UnitZ(), 1}, {-Vec3::UnitZ(), 1}};
  const NearestAllowed found = nearest_allowed(facing, Vec3::Zero(), 1e-9);
  EXPECT_FALSE(found.all_hold);
  EXPECT_TRUE(found.point.allFinite());
  const std::vector<HalfSpace> same(5, {Vec3::UnitZ(), 1});
  EXPECT_LT((nearest_allowed(same, Vec3::Zero(), 1e-9).point - Vec3::UnitZ()).norm(), 1e-12);
}

}  // namespace
}  // namespace palpate::geometry
