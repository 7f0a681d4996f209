// The swept sphere against a search along the segment.
#include "toolkit/geometry/swept_sphere.h"

#include <gtest/gtest.h>

#include "toolkit/core/random.h"

namespace palpate::geometry {
namespace {

double distance_at(const Vec3& p, const Vec3& centre, const Vec3& half) {
  const Vec3 q = (p - centre).cwiseAbs() - half;
  return q.cwiseMax(0.0).norm();
}

/// The distance is convex along the segment: thirds are cut off until nothing is left.
double searched(const Vec3& a, const Vec3& b, const Vec3& centre, const Vec3& half) {
  double low = 0.0, high = 1.0;
  for (int i = 0; i < 300; ++i) {
    const double s = low + (high - low) / 3.0, t = high - (high - low) / 3.0;
    if (distance_at(a + s * (b - a), centre, half) <= distance_at(a + t * (b - a), centre, half))
      high = t;
    else
      low = s;
  }
  return distance_at(a + 0.5 * (low + high) * (b - a), centre, half);
}

Vec3 some(Random& random, double size) {
  return {size * random.uniform(-1, 1), size * random.uniform(-1, 1), size * random.uniform(-1, 1)};
}

TEST(SweptSphere, MeasuresTheDistanceOfSegmentAndBox) {
  Random random(51);
  int apart = 0;
  for (int k = 0; k < 20000; ++k) {
    const double scale = std::pow(10.0, random.uniform(-6, 6));
    const Vec3 centre = some(random, k % 7 == 0 ? 100.0 * scale : scale);
    const Vec3 half = scale * Vec3(random.uniform(), random.uniform(), random.uniform());
    Vec3 a = centre + some(random, 2.0 * scale), b = centre + some(random, 2.0 * scale);
    if (k % 5 == 0) b = a;
    if (k % 5 == 1) b.y() = a.y();
    if (k % 5 == 2) b.tail<2>() = a.tail<2>();
    const SegmentProbe probe(a, b);
    const double expected = searched(a, b, centre, half);
    const double found = std::sqrt(segment_box_distance_sq(probe, centre, half));
    ASSERT_NEAR(found, expected, 1e-7 * scale) << k;
    apart += found > 0.0;
    // A hair on either side of the true distance.
    EXPECT_TRUE(swept_sphere_touches_box(probe, expected + 1e-6 * scale, centre, half)) << k;
    if (expected > 1e-5 * scale) {
      EXPECT_FALSE(swept_sphere_touches_box(probe, expected - 1e-6 * scale, centre, half)) << k;
    }
    if (segment_touches_box(probe, centre, half)) {
      EXPECT_TRUE(swept_sphere_touches_box(probe, 0.0, centre, half)) << k;
    }
  }
  EXPECT_GT(apart, 5000);
  EXPECT_LT(apart, 19000);
}

TEST(SweptSphere, RoundsTheCornersOfTheGrownBox) {
  const Vec3 half = Vec3::Ones();
  const Vec3 corner(1.7, 1.7, 1.7);  // 1.21 from the box's corner
  const SegmentProbe at(corner, corner);
  EXPECT_TRUE(segment_touches_box(at, Vec3::Zero(), half + Vec3::Ones()));
  EXPECT_FALSE(swept_sphere_touches_box(at, 1.0, Vec3::Zero(), half));
  EXPECT_TRUE(swept_sphere_touches_box(at, 1.2125, Vec3::Zero(), half));
}

}  // namespace
}  // namespace palpate::geometry
