#include "toolkit/render/shading.h"

#include <gtest/gtest.h>

#include "toolkit/core/random.h"
#include "toolkit/surface/normals.h"

namespace palpate::render {
namespace {

const Vec3 kA(0, 0, 0), kB(1, 0, 0), kC(0, 1, 0);

TEST(Shading, ProjectedAreasAreExactInsideAFlatFacet) {
  const Vec3 v = shaded_vector(Shading::kAreaProjected, Vec3(0.3, 0.2, -2.0), kA, kB, kC);
  EXPECT_NEAR((v - Vec3(0, 0, 2)).norm(), 0.0, 1e-15);
  // Outside the facet unsigned areas pull sideways; signed ones do not.
  EXPECT_GT(
      (shaded_vector(Shading::kAreaProjected, Vec3(-0.3, -0.2, -2.0), kA, kB, kC) - Vec3(0, 0, 2)).norm(),
      0.1);
  EXPECT_NEAR((shaded_vector(Shading::kFacet, Vec3(-0.3, -0.2, -2.0), kA, kB, kC) - Vec3(0, 0, 2)).norm(),
              0.0, 1e-15);
}

TEST(Shading, RawAreasByHand) {
  // h below the corner a: |fb x fc| for h = (0,0,-1) is |(1,1,1)| ... worked by hand: sqrt 3, 1, 1.
  const Vec3 v = shaded_vector(Shading::kAreaRaw, Vec3(0, 0, -1), kA, kB, kC);
  const double sum = std::sqrt(3.0) + 2.0;
  EXPECT_NEAR((v - Vec3(1.0 / sum, 1.0 / sum, 1.0)).norm(), 0.0, 1e-15);
}

TEST(Shading, PrintedLengthsDoubleTheForceAndNormalisedOnesDoNot) {
  // Far below a small facet all three lengths are nearly equal, so the weights' sum shows.
  const Vec3 h(0.3, 0.3, -1000.0);
  EXPECT_NEAR(shaded_vector(Shading::kLengthPrinted, h, kA, kB, kC).norm(), 2000.0, 0.01);
  EXPECT_NEAR(shaded_vector(Shading::kLengthNormalised, h, kA, kB, kC).norm(), 1000.0, 0.01);
}

TEST(Shading, SliversFallBackAtEveryScale) {
  for (const double s : {1e-3, 1.0, 1e6}) {
    const Vec3 h(0.2 * s, 0.0, -s);
    for (const Shading kind : {Shading::kAreaRaw, Shading::kAreaProjected, Shading::kFacet})
      EXPECT_EQ(shaded_vector(kind, h, kA, s * kB, s * Vec3(2, 1e-3, 0)), kA - h);
  }
}

TEST(Normals, CodeIsWithinItsBound) {
  Random random(3);
  for (int i = 0; i < 20000; ++i) {
    Vec3 n(random.normal(), random.normal(), random.normal());
    n.normalize();
    EXPECT_LT(surface::decode_normal(surface::encode_normal(n)).cross(n).norm(), 1e-4);
  }
  for (const Vec3& axis : {Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, 1), Vec3(0, 0, -1)})
    EXPECT_EQ(surface::decode_normal(surface::encode_normal(axis)), axis);
}

}  // namespace
}  // namespace palpate::render
