// The place held agrees with the HIP's own surroundings.
#include "toolkit/geometry/held_place.h"

#include <gtest/gtest.h>

#include <cmath>

namespace palpate::geometry {
namespace {

const Vec3 kUp = Vec3::UnitZ();
/// The HIP at the origin, the place held above it.
HeldPlace judged(double far, double signed_distance, const Vec3& outward, double spacing = 1.0,
                 double much_nearer = kMuchNearer) {
  const Surroundings at_hip{true, signed_distance, outward.normalized()};
  const auto look = [&](const Vec3& place) -> Surroundings {
    return place == Vec3::Zero() ? at_hip : Surroundings{true, -spacing, kUp};
  };
  return judge_held_place(Vec3::Zero(), far * kUp, kUp, spacing, much_nearer, look);
}

TEST(HeldPlace, AHipOutOfASurfaceThatFacesAboutTheSameWayIsFree) {
  EXPECT_EQ(judged(3.0, 0.5, kUp), HeldPlace::kFree);
  EXPECT_EQ(judged(3.0, 0.5, Vec3(1, 0, 0)), HeldPlace::kFree) << "beside an edge";
  EXPECT_EQ(judged(3.0, 0.5, -kUp), HeldPlace::kKeep) << "the far side of a thin plate: no pop-through";
  EXPECT_EQ(judged(3.0, 2.0, kUp), HeldPlace::kKeep) << "no nearer than the place held";
  EXPECT_EQ(judged(3.0, 2.0, kUp, 1.0, kMuchNearerRounded), HeldPlace::kFree);
  EXPECT_EQ(judged(3.0, 2.2, kUp, 1.0, kMuchNearerRounded), HeldPlace::kKeep);
}

TEST(HeldPlace, AHipBehindAMuchNearerSurfaceIsHeldThere) {
  EXPECT_EQ(judged(3.0, -0.5, kUp), HeldPlace::kMove);
  EXPECT_EQ(judged(3.0, -0.5, -kUp), HeldPlace::kKeep) << "that one is held from its other side";
  EXPECT_EQ(judged(3.0, -2.0, kUp), HeldPlace::kKeep);
  EXPECT_EQ(judged(1.0, -0.2, kUp), HeldPlace::kKeep) << "next to an edge either face may be nearer";
}

TEST(HeldPlace, WhatIsNotKnownOrNextToItStays) {
  EXPECT_EQ(judged(0.4, 0.1, kUp), HeldPlace::kKeep);
  const auto nothing = [](const Vec3&) { return Surroundings{}; };
  EXPECT_EQ(judge_held_place(Vec3::Zero(), 3.0 * kUp, kUp, 1.0, kMuchNearer, nothing), HeldPlace::kKeep);
}

// A wall with a floor below it: the HIP is through both sides of the wall, and above the floor.
TEST(HeldPlace, APlateHoldsThoughAnotherSurfaceIsNearBeyondIt) {
  for (const bool wall : {false, true})
    for (const double floor : {-0.5, 0.5}) {
      const auto look = [&](const Vec3& place) -> Surroundings {
        if (place == Vec3::Zero()) return {true, -floor, kUp};
        if (wall && place.z() < 2.0) return {true, 2.0 - place.z(), -kUp};
        return {true, -0.5, kUp};
      };
      const HeldPlace without = floor < 0.0 ? HeldPlace::kFree : HeldPlace::kMove;
      EXPECT_EQ(judge_held_place(Vec3::Zero(), 3.0 * kUp, kUp, 1.0, kMuchNearer, look),
                wall ? HeldPlace::kKeep : without);
    }
}

// Where no surface goes on a god object waits, and pulls aslant: that holds nothing, whichever way the HIP
// went.
TEST(HeldPlace, APlaceThatOnlyWaitsHoldsNothing) {
  for (const double signed_distance : {-0.5, 0.5})
    for (const double aslant : {0.1, 0.6}) {
      const Vec3 normal = Vec3(std::sin(aslant), 0.0, std::cos(aslant));
      const auto look = [&](const Vec3& place) -> Surroundings {
        return {true, place == Vec3::Zero() ? signed_distance : -1.0, -normal};
      };
      const HeldPlace freed = signed_distance > 0.0 ? HeldPlace::kFree : HeldPlace::kMove;
      EXPECT_EQ(judge_held_place(Vec3::Zero(), 3.0 * kUp, normal, 1.0, kMuchNearer, look),
                aslant > 0.5 ? freed : HeldPlace::kKeep);
    }
}

TEST(HeldPlace, IsTheSameAtEveryScale) {
  for (const double scale : {1e-3, 1.0, 1e6})
    for (const double far : {0.4, 1.0, 3.0})
      for (const double distance : {-2.0, -0.5, -0.01, 0.01, 0.5, 2.0})
        for (const Vec3& outward : {kUp, Vec3(-kUp), Vec3(1, 0, 0.1)})
          EXPECT_EQ(judged(scale * far, scale * distance, outward, scale), judged(far, distance, outward));
}

}  // namespace
}  // namespace palpate::geometry
