// The detailed closed surface against its own definition and a dense sampling.
#include <gtest/gtest.h>

#include <Eigen/Geometry>  // cross products

#include <cmath>
#include <limits>

#include "toolkit/core/random.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::geometry {
namespace {

class PebbleAt : public testing::TestWithParam<double> {
 protected:
  double scale() const { return GetParam(); }
  std::shared_ptr<const AnalyticSurface> pebble() const {
    return make_pebble(20 * scale(), 3 * scale(), 0.2, 5);
  }
};

Vec3 direction(Random& random) {
  return Vec3(random.normal(), random.normal(), random.normal()).normalized();
}

TEST_P(PebbleAt, NormalsAreThoseOfTheSurface) {
  const auto surface = pebble();
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    const double u = random.uniform(0.05, 0.95), v = random.uniform(0.05, 0.95), e = 1e-5;
    const Vec3 across = surface->at(u + e, v).point_mm - surface->at(u - e, v).point_mm;
    const Vec3 along = surface->at(u, v + e).point_mm - surface->at(u, v - e).point_mm;
    const SurfacePoint here = surface->at(u, v);
    EXPECT_NEAR(here.normal.norm(), 1.0, 1e-12);
    EXPECT_LT(std::abs(here.normal.dot(across.normalized())), 1e-5);
    EXPECT_LT(std::abs(here.normal.dot(along.normalized())), 1e-5);
    EXPECT_GT(here.normal.dot(here.point_mm), 0.0);
  }
}

TEST_P(PebbleAt, ClosestIsTheClosestOfADenseSampling) {
  const auto surface = pebble();
  Random random(2);
  for (int i = 0; i < 5; ++i) {
    const SurfacePoint near = surface->at(random.uniform(), random.uniform(0.2, 0.8));
    const double height = random.uniform(-0.8, 0.8) * scale();
    const Vec3 p = near.point_mm + height * near.normal;
    const SurfacePoint found = surface->closest(p);
    EXPECT_LT((p - found.point_mm).cross(found.normal).norm(), 1e-6 * scale()) << "square to the surface";
    EXPECT_EQ(surface->signed_distance_mm(p) > 0.0, height > 0.0);
    double best = std::numeric_limits<double>::infinity();
    for (int a = 0; a < 300; ++a)
      for (int b = 0; b < 150; ++b)
        best = std::min(best, (surface->at(a / 300.0, (b + 0.5) / 150.0).point_mm - p).norm());
    EXPECT_LE((p - found.point_mm).norm(), best + 1e-9 * scale()) << i;
  }
}

TEST_P(PebbleAt, EntriesAreTheFirstOnes) {
  const auto surface = pebble();
  Random random(3);
  int entered = 0;
  for (int i = 0; i < 60; ++i) {
    const Vec3 a = direction(random) * (26 * scale());
    const Vec3 b = a + (direction(random) * (10 * scale()) - a) * 0.6;
    const auto entry = surface->first_entry(a, b);
    // By small steps: outside at a, the first place inside.
    double t = 0.0;
    while (t <= 1.0 && surface->signed_distance_mm(a + t * (b - a)) >= 0.0) t += 1e-3;
    ASSERT_EQ(entry.has_value(), t <= 1.0) << i;
    if (!entry) continue;
    ++entered;
    EXPECT_LT((entry->point_mm - (a + t * (b - a))).norm(), 3e-3 * (b - a).norm());
    EXPECT_NEAR(surface->signed_distance_mm(entry->point_mm), 0.0, 1e-9 * scale());
  }
  EXPECT_GT(entered, 20);
}

INSTANTIATE_TEST_SUITE_P(Scales, PebbleAt, testing::Values(1e-3, 1.0, 1e5));

TEST(Pebble, RefusesWhatIsNone) {
  EXPECT_EQ(make_pebble(0, 1, 0.2, 1), nullptr);
  EXPECT_EQ(make_pebble(10, 20, 0.2, 1), nullptr);
  EXPECT_EQ(make_pebble(10, 1, 2, 1), nullptr);
  EXPECT_EQ(make_pebble(std::nan(""), 1, 0.2, 1), nullptr);
}

}  // namespace
}  // namespace palpate::geometry
