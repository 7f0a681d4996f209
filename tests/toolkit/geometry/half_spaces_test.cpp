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
  EXPECT_NEAR(all.push_of(2), 3, 1e-12);
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
      EXPECT_GE(found.push_of(i), 0.0);
      sum += found.push_of(i) * planes[i].normal;
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

/// Every case of up to three active planes that are given, without a bound on their number.
NearestAllowed by_trying_all(const std::vector<HalfSpace>& planes, const Vec3& p) {
  NearestAllowed best;
  double least = HUGE_VAL;
  const auto consider = [&](const std::vector<HalfSpace>& few) {
    const NearestAllowed one = nearest_allowed(few, p, 1e-12, 1e-6);
    if (detail::violation(planes, one.point) > 1e-9 || !((one.point - p).norm() < least)) return;
    least = (one.point - p).norm();
    best = one;
  };
  for (const HalfSpace& a : planes)
    for (const HalfSpace& b : planes)
      for (const HalfSpace& c : planes) consider({a, b, c});
  return best;
}

// A corner of three planes, each many times over, as facets of a mesh give them: none takes another's place.
TEST(HalfSpaces, ManyPlanesOfOneCornerHoldAllThree) {
  std::vector<HalfSpace> planes;
  for (int axis = 0; axis < 3; ++axis)
    for (int i = 0; i < 12; ++i) planes.push_back({Vec3::Unit(axis), 1.0 + axis});
  const NearestAllowed found = nearest_allowed(planes, Vec3::Zero(), 1e-12);
  EXPECT_TRUE(found.all_hold);
  EXPECT_LT((found.point - Vec3(1, 2, 3)).norm(), 1e-12);
  EXPECT_EQ(found.active, 3u);
}

TEST(HalfSpaces, ManyPlanesAgainstEveryCase) {
  Random random(8);
  for (int trial = 0; trial < 60; ++trial) {
    std::vector<HalfSpace> planes;
    const std::size_t n = kMaxHalfSpaces + 1 + random.below(16);
    for (std::size_t i = 0; i < n; ++i) {
      planes.push_back({unit(random), -random.uniform()});
      if (random.below(4) == 0) planes.push_back(planes[random.below(planes.size())]);
    }
    const Vec3 p = 3.0 * unit(random);
    const NearestAllowed found = nearest_allowed(planes, p, 1e-12, 1e-6), all = by_trying_all(planes, p);
    ASSERT_TRUE(found.all_hold) << trial;
    EXPECT_LT((found.point - all.point).norm(), 1e-9) << trial;
    Vec3 sum = p;
    for (std::size_t i = 0; i < planes.size(); ++i) sum += found.push_of(i) * planes[i].normal;
    EXPECT_LT((sum - found.point).norm(), 1e-9);
  }
}

TEST(HalfSpaces, ManyPlanesWithoutRoomEnd) {
  Random random(9);
  for (int trial = 0; trial < 100; ++trial) {
    std::vector<HalfSpace> planes;
    for (std::size_t i = 0; i < 40; ++i) planes.push_back({unit(random), random.uniform() - 0.2});
    const NearestAllowed found = nearest_allowed(planes, Vec3::Zero(), 1e-12);
    EXPECT_TRUE(found.point.allFinite());
    EXPECT_EQ(found.all_hold, detail::violation(planes, found.point) <= 1e-12);
  }
  // Nearly one plane: solved for one at a time.
  std::vector<HalfSpace> bowl;
  for (int i = 0; i < 20; ++i)
    bowl.push_back({Vec3(1e-3 * std::cos(i), 1e-3 * std::sin(i), 1.0).normalized(), 0.0});
  EXPECT_LT((nearest_allowed(bowl, Vec3(0, 0, -1), 1e-12).point).norm(), 3e-3);
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
