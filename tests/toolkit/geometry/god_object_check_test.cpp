// The place held agrees with the HIP's own surroundings.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/geometry/god_object_check.h"
#include "toolkit/geometry/half_space_projection.h"

namespace palpate::geometry {
namespace {

const Vec3 kUp = Vec3::UnitZ();
/// The HIP at the origin, the place held above it.
GodObjectVerdict judged(double far, double signed_distance, const Vec3& outward, double spacing = 1.0,
                        double much_nearer = kMuchNearerShare) {
  const NearestSurface at_hip{true, signed_distance, outward.normalized()};
  const auto look = [&](const Vec3& place) -> NearestSurface {
    return place == Vec3::Zero() ? at_hip : NearestSurface{true, -spacing, kUp};
  };
  return check_god_object(look(Vec3::Zero()), Vec3::Zero(), far * kUp, kUp, kUp, spacing, much_nearer, look);
}

TEST(GodObjectCheck, AHipOutOfASurfaceThatFacesAboutTheSameWayIsFree) {
  EXPECT_EQ(judged(3.0, 0.5, kUp), GodObjectVerdict::kFree);
  EXPECT_EQ(judged(3.0, 0.5, Vec3(1, 0, 0)), GodObjectVerdict::kFree) << "beside an edge";
  EXPECT_EQ(judged(3.0, 0.5, -kUp), GodObjectVerdict::kKeep)
      << "the far side of a thin plate: no pop-through";
  EXPECT_EQ(judged(3.0, 2.0, kUp), GodObjectVerdict::kKeep) << "no nearer than the place held";
  EXPECT_EQ(judged(3.0, 2.0, kUp, 1.0, kMuchNearerShareRounded), GodObjectVerdict::kFree);
  EXPECT_EQ(judged(3.0, 2.2, kUp, 1.0, kMuchNearerShareRounded), GodObjectVerdict::kKeep);
}

TEST(GodObjectCheck, AHipBehindAMuchNearerSurfaceIsHeldThere) {
  EXPECT_EQ(judged(3.0, -0.5, kUp), GodObjectVerdict::kMove);
  EXPECT_EQ(judged(3.0, -0.5, -kUp), GodObjectVerdict::kKeep) << "that one is held from its other side";
  EXPECT_EQ(judged(3.0, -2.0, kUp), GodObjectVerdict::kKeep);
  EXPECT_EQ(judged(1.0, -0.2, kUp), GodObjectVerdict::kKeep) << "next to an edge either face may be nearer";
}

TEST(GodObjectCheck, WhatIsNotKnownOrNextToItStays) {
  EXPECT_EQ(judged(0.4, 0.1, kUp), GodObjectVerdict::kKeep);
  const auto nothing = [](const Vec3&) { return NearestSurface{}; };
  EXPECT_EQ(check_god_object({}, Vec3::Zero(), 3.0 * kUp, kUp, kUp, 1.0, kMuchNearerShare, nothing),
            GodObjectVerdict::kKeep);
}

// A wall with a floor below it: the HIP is through both sides of the wall, and above the floor.
TEST(GodObjectCheck, APlateHoldsThoughAnotherSurfaceIsNearBeyondIt) {
  for (const bool wall : {false, true})
    for (const double floor : {-0.5, 0.5}) {
      const auto look = [&](const Vec3& place) -> NearestSurface {
        if (place == Vec3::Zero()) return {true, -floor, kUp};
        if (wall && place.z() < 2.0) return {true, 2.0 - place.z(), -kUp};
        return {true, -0.5, kUp};
      };
      const GodObjectVerdict without = floor < 0.0 ? GodObjectVerdict::kFree : GodObjectVerdict::kMove;
      EXPECT_EQ(check_god_object(look(Vec3::Zero()), Vec3::Zero(), 3.0 * kUp, kUp, kUp, 1.0, kMuchNearerShare,
                                 look),
                wall ? GodObjectVerdict::kKeep : without);
    }
}

// Where a surface ends a god object waits, pulling aslant: its pull says what is a far side, not its normal.
TEST(GodObjectCheck, APlaceThatOnlyWaitsIsComparedByItsPull) {
  const Vec3 aslant = Vec3(std::sin(0.6), 0.0, std::cos(0.6));
  for (const double signed_distance : {-0.5, 0.5})
    for (const Vec3& normal : {kUp, aslant})
      for (const Vec3& outward : {Vec3(Vec3::UnitX()), Vec3(-Vec3::UnitX()), Vec3(-kUp)}) {
        const auto look = [&](const Vec3& place) -> NearestSurface {
          return {true, place == Vec3::Zero() ? signed_distance : -1.0, outward};
        };
        const GodObjectVerdict freed =
            signed_distance > 0.0 ? GodObjectVerdict::kFree : GodObjectVerdict::kMove;
        EXPECT_EQ(check_god_object(look(Vec3::Zero()), Vec3::Zero(), 3.0 * kUp, normal, normal, 1.0,
                                   kMuchNearerShare, look),
                  outward.dot(kUp) < -0.5 ? GodObjectVerdict::kKeep : freed);
      }
}

// A ball within a ball, felt from outside: between them the outer one says inside, the inner one outside.
TEST(GodObjectCheck, APieceWithinTheOneThatHoldsTellsNothing) {
  constexpr double kGap = 2.0;
  for (const bool one_piece : {false, true})
    for (const double depth : {1.5, 2.5}) {
      const Vec3 held = depth * kUp;
      const auto look = [&](const Vec3& place) -> NearestSurface {
        const double below = (held - place).norm(), above_inner = kGap - below;
        if (below < std::abs(above_inner)) return {true, -below, kUp, 1};
        return {true, above_inner, kUp, one_piece ? 1u : 2u};
      };
      const GodObjectVerdict else_done = depth < kGap ? GodObjectVerdict::kFree : GodObjectVerdict::kMove;
      EXPECT_EQ(
          check_god_object(look(Vec3::Zero()), Vec3::Zero(), held, kUp, kUp, 1.0, kMuchNearerShare, look),
          one_piece ? else_done : GodObjectVerdict::kKeep);
    }
}

// Around a tip the way of the nearest surface turns bit by bit; through a plate it turns over at once.
TEST(GodObjectCheck, ASurfaceFollowedAroundATipHoldsOnItsFarSide) {
  for (const bool around : {false, true}) {
    Vec3 followed = kUp;
    Vec3 outward = kUp;
    const auto look = [&](const Vec3&) -> NearestSurface { return {true, -0.5, outward}; };
    GodObjectVerdict verdict = GodObjectVerdict::kKeep;
    for (const double turn : {0.0, 1.0, 2.0, 3.0}) {
      if (!around && turn > 0.0 && turn < 3.0) continue;
      outward = Vec3(std::sin(turn), 0.0, std::cos(turn));
      followed = follow_outward(look(Vec3::Zero()), followed, kUp);
      verdict = check_god_object(look(Vec3::Zero()), Vec3::Zero(), 3.0 * kUp, kUp, followed, 1.0,
                                 kMuchNearerShare, look);
    }
    EXPECT_EQ(verdict, around ? GodObjectVerdict::kMove : GodObjectVerdict::kKeep);
  }
}

TEST(GodObjectCheck, IsTheSameAtEveryScale) {
  for (const double scale : {1e-3, 1.0, 1e6})
    for (const double far : {0.4, 1.0, 3.0})
      for (const double distance : {-2.0, -0.5, -0.01, 0.01, 0.5, 2.0})
        for (const Vec3& outward : {kUp, Vec3(-kUp), Vec3(1, 0, 0.1)})
          EXPECT_EQ(judged(scale * far, scale * distance, outward, scale), judged(far, distance, outward));
}

Vec3 unit(Random& random) {
  return Vec3(random.normal(), random.normal(), random.normal()).normalized();
}

TEST(HalfSpaces, OptimalAgainstRandomAllowedPoints) {
  Random random(7);
  for (int trial = 0; trial < 300; ++trial) {
    std::vector<HalfSpace> planes;
    const std::size_t n = 1 + random.below(kMaxEnumeratedHalfSpaces);
    // All contain the origin, so there is room.
    for (std::size_t i = 0; i < n; ++i) planes.push_back({unit(random), -random.uniform()});
    const Vec3 p = 3.0 * unit(random);
    const NearestFeasible found = nearest_feasible(planes, p, 1e-9);
    ASSERT_TRUE(found.feasible) << trial;
    Vec3 sum = p;
    for (std::size_t i = 0; i < n; ++i) {
      EXPECT_GE(planes[i].normal.dot(found.point), planes[i].offset - 1e-8);
      EXPECT_GE(found.multiplier_of(i), 0.0);
      sum += found.multiplier_of(i) * planes[i].normal;
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
NearestFeasible by_trying_all(const std::vector<HalfSpace>& planes, const Vec3& p) {
  NearestFeasible best;
  double least = HUGE_VAL;
  const auto consider = [&](const std::vector<HalfSpace>& few) {
    const NearestFeasible one = nearest_feasible(few, p, 1e-12, 1e-6);
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
  const NearestFeasible found = nearest_feasible(planes, Vec3::Zero(), 1e-12);
  EXPECT_TRUE(found.feasible);
  EXPECT_LT((found.point - Vec3(1, 2, 3)).norm(), 1e-12);
  EXPECT_EQ(found.active, 3u);
}

TEST(HalfSpaces, ManyPlanesAgainstEveryCase) {
  Random random(8);
  for (int trial = 0; trial < 15; ++trial) {
    std::vector<HalfSpace> planes;
    const std::size_t n = kMaxEnumeratedHalfSpaces + 1 + random.below(16);
    for (std::size_t i = 0; i < n; ++i) {
      planes.push_back({unit(random), -random.uniform()});
      if (random.below(4) == 0) planes.push_back(planes[random.below(planes.size())]);
    }
    const Vec3 p = 3.0 * unit(random);
    const NearestFeasible found = nearest_feasible(planes, p, 1e-12, 1e-6), all = by_trying_all(planes, p);
    ASSERT_TRUE(found.feasible) << trial;
    EXPECT_LT((found.point - all.point).norm(), 1e-9) << trial;
    Vec3 sum = p;
    for (std::size_t i = 0; i < planes.size(); ++i) sum += found.multiplier_of(i) * planes[i].normal;
    EXPECT_LT((sum - found.point).norm(), 1e-9);
  }
}

TEST(HalfSpaces, ManyPlanesWithoutRoomEnd) {
  Random random(9);
  for (int trial = 0; trial < 100; ++trial) {
    std::vector<HalfSpace> planes;
    for (std::size_t i = 0; i < 40; ++i) planes.push_back({unit(random), random.uniform() - 0.2});
    const NearestFeasible found = nearest_feasible(planes, Vec3::Zero(), 1e-12);
    EXPECT_TRUE(found.point.allFinite());
    EXPECT_EQ(found.feasible, detail::violation(planes, found.point) <= 1e-12);
  }
  // Nearly one plane: solved for one at a time.
  std::vector<HalfSpace> bowl;
  for (int i = 0; i < 20; ++i)
    bowl.push_back({Vec3(1e-3 * std::cos(i), 1e-3 * std::sin(i), 1.0).normalized(), 0.0});
  EXPECT_LT((nearest_feasible(bowl, Vec3(0, 0, -1), 1e-12).point).norm(), 3e-3);
}

TEST(HalfSpaces, NoRoomIsSaidAndNothingIsNotANumber) {
  const std::vector<HalfSpace> facing{{Vec3::UnitZ(), 1}, {-Vec3::UnitZ(), 1}};
  const NearestFeasible found = nearest_feasible(facing, Vec3::Zero(), 1e-9);
  EXPECT_FALSE(found.feasible);
  EXPECT_TRUE(found.point.allFinite());
  const std::vector<HalfSpace> same(5, {Vec3::UnitZ(), 1});
  EXPECT_LT((nearest_feasible(same, Vec3::Zero(), 1e-9).point - Vec3::UnitZ()).norm(), 1e-12);
}

// Round bodies, open sheets and nested ones: ellipsoid, rounded box, bowl, shells.

constexpr std::uint64_t kSheetSeed = 20260102;
constexpr double kScales[] = {1e-3, 1.0, 1e6};

TEST(Sheets, KnownPoints) {
  const auto ellipsoid = make_ellipsoid({4, 2, 1});
  EXPECT_DOUBLE_EQ(ellipsoid->signed_distance_mm({7, 0, 0}), 3.0);
  EXPECT_DOUBLE_EQ(ellipsoid->signed_distance_mm({0, 0, 0.25}), -0.75);
  EXPECT_DOUBLE_EQ(ellipsoid->signed_distance_mm({0, 0, 0}), -1.0);
  // Where the long way is closed in by the short one: x < a - c^2 / a, the closest is off the axis.
  EXPECT_LT(ellipsoid->closest({1, 0, 0}).point_mm.x(), 2.0);
  EXPECT_NEAR(ellipsoid->closest({1, 0, 0}).point_mm.x(), 16.0 / 15.0, 1e-14);
  EXPECT_NEAR(ellipsoid->signed_distance_mm({4 * 0.6, 2 * 0.8, 0}), 0.0, 1e-15) << "in a plane of symmetry";
  const auto ball = make_ellipsoid({3, 3, 3});
  EXPECT_DOUBLE_EQ(ball->signed_distance_mm({0, 5, 0}), 2.0);
  EXPECT_DOUBLE_EQ(ball->signed_distance_mm({0, 0, 0}), -3.0);

  const auto box = make_rounded_box({10, 6, 8}, 1);
  EXPECT_DOUBLE_EQ(box->signed_distance_mm({7, 0, 0}), 2.0);
  EXPECT_DOUBLE_EQ(box->signed_distance_mm({0, 2.5, 0}), -0.5);
  EXPECT_NEAR(box->signed_distance_mm({7, 5, 0}), 3 * std::sqrt(2.0) - 1, 1e-14);
  EXPECT_NEAR(box->signed_distance_mm({5, 3, 4}), std::sqrt(3.0) - 1, 1e-14) << "the corner is cut";
  // Equal ways: from the middle of the face over its flat 4 mm and the quarter turn to the next face's.
  EXPECT_NEAR((rounded_box_point(*box, {1, 0, 1}) - Vec3(4 + std::sqrt(0.5), 0, 3 + std::sqrt(0.5))).norm(),
              0.0, 1e-14);
  EXPECT_NEAR(rounded_box_half_arcs({10, 6, 8}, 1).x(), 4 + std::numbers::pi / 4, 1e-14);

  const auto shells = make_shells(10, 1);
  EXPECT_DOUBLE_EQ(shells->signed_distance_mm({0, 9.75, 0}), -0.25);
  EXPECT_DOUBLE_EQ(shells->signed_distance_mm({0, 8, 0}), 1.0);
  EXPECT_EQ(shells->closest({0, 8, 0}).normal, Vec3(0, -1, 0)) << "towards the hollow";

  const auto bowl = make_bowl(10, 90, Felt::kInside);
  EXPECT_EQ(bowl->closest({0, 0, -9}).normal, Vec3(0, 0, 1));
  EXPECT_DOUBLE_EQ(bowl->signed_distance_mm({0, 0, -9}), 1.0);
  EXPECT_DOUBLE_EQ(bowl->signed_distance_mm({0, 0, -12}), 2.0) << "a sheet has no inside";
  EXPECT_NEAR(bowl->signed_distance_mm({10, 0, 3}), 3.0, 1e-14) << "to the rim";
  EXPECT_EQ(bowl->box_mm().high_mm.z(), bowl->at(0.5, 0).point_mm.z());
}

TEST(Sheets, ARoundedBoxHoldsOnTheEntryFaceAndSlidesOverItsEdge) {
  for (const double k : kScales) {
    const auto box = make_rounded_box(k * Vec3(20, 20, 4), 1 * k);
    SurfacePoint g = box->first_entry(k * Vec3(3, 4, 3), k * Vec3(3, 4, 1.9)).value();
    EXPECT_NEAR((g.point_mm - k * Vec3(3, 4, 2)).norm(), 0.0, 1e-12 * k);
    // Through the middle and out below: still the upper face.
    for (int i = 0; i < 100; ++i) g = box->track(g, k * Vec3(3, 4, 1.9 - 0.05 * i));
    EXPECT_NEAR((g.point_mm - k * Vec3(3, 4, 2)).norm(), 0.0, 1e-12 * k);
    // Onto the edge: at 45 degrees from its middle line, while the HIP is above the core.
    g = box->track(g, k * Vec3(9.25, 4, 1.25));
    EXPECT_NEAR((g.point_mm - k * Vec3(9 + std::sqrt(0.5), 4, 1 + std::sqrt(0.5))).norm(), 0.0, 1e-12 * k);
    // Deeper than the edge's middle line and beyond it: down the side.
    g = box->track(g, k * Vec3(9.5, 4, 0.5));
    EXPECT_NEAR((g.point_mm - k * Vec3(10, 4, 0.5)).norm(), 0.0, 1e-12 * k);
  }
}

TEST(Sheets, AnEllipsoidHoldsTheSheetThatWasEntered) {
  // A lens of 2 mm: pressed through to the other side.
  const auto lens = make_ellipsoid({20, 20, 1});
  SurfacePoint g = lens->first_entry({1, 2, 3}, {1, 2, 0.5}).value();
  EXPECT_GT(g.normal.z(), 0.99);
  for (int i = 0; i < 60; ++i) g = lens->track(g, {1, 2, 0.9 - 0.05 * i});
  EXPECT_GT(g.point_mm.z(), 0.9);
  EXPECT_LT(lens->closest({1, 2, -2}).point_mm.z(), 0.0);
}

TEST(Sheets, ShellsKeepTheSheetThatWasEntered) {
  for (const double k : kScales) {
    const auto shells = make_shells(10 * k, 0.5 * k);
    SurfacePoint g = shells->first_entry({11 * k, 0, 0}, {9.8 * k, 0, 0}).value();
    for (int i = 0; i < 40; ++i) g = shells->track(g, {(9.8 - 0.05 * i) * k, 0, 0});  // into the hollow
    EXPECT_NEAR(g.point_mm.x(), 10 * k, 1e-12 * k);
    EXPECT_EQ(g.normal, Vec3(1, 0, 0));
    // From the hollow outwards: the inner sheet, and a segment through the whole ball enters the outer one.
    const auto inner = shells->first_entry({0, 0, 0}, {0, 9.8 * k, 0});
    ASSERT_TRUE(inner);
    EXPECT_NEAR(inner->point_mm.y(), 9.5 * k, 1e-12 * k);
    EXPECT_EQ(inner->normal, Vec3(0, -1, 0));
    EXPECT_NEAR(shells->first_entry({0, -20 * k, 0}, {0, 20 * k, 0})->point_mm.y(), -10 * k, 1e-12 * k);
    // From within the wall: out into the hollow, and in again on the far side.
    const auto far = shells->first_entry({0, 0, 9.7 * k}, {0, 0, -20 * k});
    ASSERT_TRUE(far);
    EXPECT_NEAR(far->point_mm.z(), -9.5 * k, 1e-12 * k);
    EXPECT_FALSE(shells->first_entry({0, 0, 9.7 * k}, {0, 0, 20 * k}));
  }
}

/// What metrics/reference.cpp does after each step: whether the HIP is let go.
bool release_contact(const SurfacePoint& g, const Vec3& hip) {
  return (hip - g.point_mm).dot(g.normal) >= 0.0;
}

TEST(Sheets, ABowlEndsAtItsRim) {
  for (const double k : kScales)
    for (const Felt felt : {Felt::kInside, Felt::kOutside}) {
      const double out = felt == Felt::kOutside ? 1.0 : -1.0;
      const auto bowl = make_bowl(10 * k, 60, felt);
      const auto at = [&](double deg, double radius) {
        const double angle = deg * std::numbers::pi / 180.0;
        return Vec3(radius * k * std::sin(angle), 0.0, -radius * k * std::cos(angle));
      };
      // Entered at 50 degrees and slid towards the rim 0.5 mm behind the sheet.
      const auto entry = bowl->first_entry(at(50, 10 + out), at(50, 10 - 0.5 * out));
      ASSERT_TRUE(entry);
      SurfacePoint g = *entry;
      double last = 0.0;
      for (double deg = 50; deg < 70; deg += 0.25) {
        const Vec3 hip = at(deg, 10 - 0.5 * out);
        g = bowl->track(g, hip);
        if (release_contact(g, hip)) break;
        EXPECT_NEAR((g.point_mm - hip).norm(), 0.5 * k, 1e-9 * k);
        last = deg;
      }
      EXPECT_NEAR(last, 60.0, 0.26) << "neither before the rim nor after it";
      // Beyond the rim there is nothing, and from behind nothing is felt.
      EXPECT_FALSE(bowl->first_entry(at(61, 10 + out), at(61, 10 - out)));
      EXPECT_TRUE(bowl->first_entry(at(59, 10 + out), at(59, 10 - out)));
      EXPECT_FALSE(bowl->first_entry(at(30, 10 - out), at(30, 10 + out)));
      const Vec3 on = at(20, 10);
      const SurfacePoint s = bowl->closest(on);
      EXPECT_TRUE(bowl->first_entry(s.point_mm, s.point_mm - 0.01 * k * s.normal));
      EXPECT_FALSE(bowl->first_entry(s.point_mm, s.point_mm + 0.01 * k * s.normal));
      EXPECT_FALSE(bowl->first_entry(s.point_mm - 0.01 * k * s.normal, s.point_mm - 0.02 * k * s.normal));
    }
  // The mouth: felt from outside, in through the hole, and nothing there.
  const auto mouth = make_bowl(10, 150, Felt::kOutside);
  EXPECT_TRUE(mouth->first_entry({11, 0, 0}, {9, 0, 0}));
  EXPECT_FALSE(mouth->first_entry({0, 0, 12}, {0, 0, 0}));
  EXPECT_FALSE(mouth->first_entry({0, 0, 0}, {-12, 0, 0})) << "the wall from within";
  EXPECT_TRUE(release_contact(mouth->track({{10, 0, 0}, {1, 0, 0}}, {0.5, 0, 9}), {0.5, 0, 9}));
}

TEST(Sheets, PlacesOfParametersLieOnTheSurfaceWithTheirNormals) {
  Random random(kSheetSeed);
  for (const double k : kScales)
    for (const auto& surface :
         {make_ellipsoid(k * Vec3(30, 18, 22)), make_rounded_box(k * Vec3(40, 20, 30), 2 * k),
          make_bowl(25 * k, 110, Felt::kInside), make_bowl(25 * k, 150, Felt::kOutside),
          make_shells(25 * k, 0.6 * k)})
      for (int n = 0; n < 200; ++n) {
        const SurfacePoint s = surface->at(random.uniform(), random.uniform());
        ASSERT_NEAR(surface->signed_distance_mm(s.point_mm), 0.0, 1e-13 * k * 100) << surface->formula();
        ASSERT_NEAR((surface->closest(s.point_mm + 0.01 * k * s.normal).point_mm - s.point_mm).norm(), 0.0,
                    1e-10 * k)
            << surface->formula();
        ASSERT_TRUE(surface->box_mm().grown(1e-12 * k).contains(s.point_mm)) << surface->formula();
      }
}

}  // namespace
}  // namespace palpate::geometry
