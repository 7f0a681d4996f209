// The noise of points place by place.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/random.h"
#include "toolkit/smooth/noise_field.h"

namespace palpate::render {
namespace {

constexpr double kFine = 0.1, kRough = 0.3;
constexpr double kEndMm = 140.0, kWideMm = 60.0, kRoughFromMm = 100.0;

/// A point a square millimetre at random, rough beyond a line; `bend`: the slope on the far side of a ridge.
std::vector<Vec3> strip(double rough, double bend) {
  Random random(7);
  std::vector<Vec3> points;
  while (points.size() < static_cast<std::size_t>(kEndMm * kWideMm)) {
    const double x = random.uniform(0.0, kEndMm), y = random.uniform(0.0, kWideMm);
    const double noise = x > kRoughFromMm ? rough : kFine;
    const double ridge = -bend * std::max(x - 0.5 * kRoughFromMm, 0.0);
    points.push_back({x, y, ridge + noise * random.normal()});
  }
  return points;
}
SmoothPoints sorted(const std::vector<Vec3>& points) {
  return {cloud::build_cloud(points, cloud::NonFinite::kDrop).value(), 1};
}
/// The mean of the field over the points between two x, from the strip's beginning.
double mean_between(const NoiseField& field, const SmoothPoints& points, double low, double high) {
  double sum = 0.0, count = 0.0;
  const double begin = points.box_mm().low_mm.x();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double x = points[i].x() - begin;
    if (x < low || x > high) continue;
    sum += field.at(i);
    count += 1.0;
  }
  return sum / count;
}

TEST(NoiseField, TellsRoughPlacesFromFineOnes) {
  const SmoothPoints points = sorted(strip(kRough, 0.0));
  const NoiseField field(points, 2), one(points, 1), everywhere(points, 2, true);
  EXPECT_NEAR(field.median(), kFine, 0.3 * kFine);
  EXPECT_NEAR(mean_between(field, points, 20.0, 60.0), field.median(), 0.02 * kFine);
  EXPECT_NEAR(mean_between(field, points, 120.0, 139.0), kRough, 0.2 * kRough);
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_EQ(field.at(i), one.at(i)) << i;
    ASSERT_EQ(everywhere.at(i), field.median()) << i;
  }
}

// A ridge is shape: a fit over it is off by more than noise, but not those beside it.
TEST(NoiseField, ARidgeIsNoNoise) {
  const SmoothPoints points = sorted(strip(kFine, 1.0));
  const NoiseField field(points, 2);
  EXPECT_NEAR(mean_between(field, points, 45.0, 55.0), field.median(), 0.1 * kFine);
}

// What is found of points without noise is their shape: one answer everywhere.
TEST(NoiseField, CleanPointsHaveNone) {
  Random random(3);
  std::vector<Vec3> points;
  for (int i = 0; i < 6000; ++i) {
    const double x = random.uniform(0.0, 80.0), y = random.uniform(0.0, 80.0);
    points.push_back({x, y, 0.01 * x * x + (x > 40.0 ? 0.5 * (x - 40.0) : 0.0)});
  }
  const SmoothPoints all = sorted(points);
  const NoiseField field(all, 2);
  for (std::size_t i = 0; i < all.size(); ++i) ASSERT_EQ(field.at(i), field.median());
}

}  // namespace
}  // namespace palpate::render
