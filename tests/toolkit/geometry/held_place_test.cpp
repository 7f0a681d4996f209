// The place held agrees with the HIP's own surroundings.
#include "toolkit/geometry/held_place.h"

#include <gtest/gtest.h>

namespace palpate::geometry {
namespace {

const Vec3 kUp = Vec3::UnitZ();
/// The HIP at the origin, the place held above it.
HeldPlace judged(double far, double signed_distance, const Vec3& outward, double spacing = 1.0) {
  return judge_held_place(Vec3::Zero(), far * kUp, kUp, {true, signed_distance, outward.normalized()},
                          spacing);
}

TEST(HeldPlace, AHipOutOfASurfaceThatFacesAboutTheSameWayIsFree) {
  EXPECT_EQ(judged(3.0, 0.5, kUp), HeldPlace::kFree);
  EXPECT_EQ(judged(3.0, 0.5, Vec3(1, 0, 0)), HeldPlace::kFree) << "beside an edge";
  EXPECT_EQ(judged(3.0, 0.5, -kUp), HeldPlace::kKeep) << "the far side of a thin plate: no pop-through";
  EXPECT_EQ(judged(3.0, 2.0, kUp), HeldPlace::kKeep) << "no nearer than the place held";
}

TEST(HeldPlace, AHipBehindAMuchNearerSurfaceIsHeldThere) {
  EXPECT_EQ(judged(3.0, -0.5, kUp), HeldPlace::kMove);
  EXPECT_EQ(judged(3.0, -0.5, -kUp), HeldPlace::kKeep) << "that one is held from its other side";
  EXPECT_EQ(judged(3.0, -2.0, kUp), HeldPlace::kKeep);
  EXPECT_EQ(judged(1.0, -0.2, kUp), HeldPlace::kKeep) << "next to an edge either face may be nearer";
}

TEST(HeldPlace, WhatIsNotKnownOrNextToItStays) {
  EXPECT_EQ(judged(0.4, 0.1, kUp), HeldPlace::kKeep);
  EXPECT_EQ(judge_held_place(Vec3::Zero(), 3.0 * kUp, kUp, {}, 1.0), HeldPlace::kKeep);
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
