#include "toolkit/smooth/fit_sums.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/smooth/surround.h"

namespace palpate::render {
namespace {

Vec3 vector_within(Random& random, double most) {
  const auto one = [&] { return random.uniform(-most, most); };
  return Vec3{one(), one(), one()};
}

TEST(FitSums, MomentsAndMediansAreThoseOfPlainLoops) {
  Random random(13);
  for (std::size_t count = 1; count < 90; ++count) {
    std::vector<Vec3> away;
    for (std::size_t i = 0; i < count; ++i) away.push_back(vector_within(random, 0.8));
    const FitFrame frame{vector_within(random, 0.1), Vec3::UnitX(), Vec3::UnitY(), Vec3::UnitZ()};
    const FitHeight height{0.01, 0.1, -0.2, 0.3, 0.1, -0.1};
    FitPoints points;
    points.take(away);
    FitMoments sums;
    points.moments(frame, height, 2.0, sums);
    double m0 = 0.0, m13 = 0.0, r4 = 0.0, weights = 0.0;
    std::vector<double> off;
    for (const Vec3& p : away) {
      const Vec3 d = p - frame.shift;
      const double a = d.x(), b = d.y();
      const double residual = d.z() - (height[0] + a * (height[1] + height[3] * a + height[4] * b) +
                                       b * (height[2] + height[5] * b));
      off.push_back(std::abs(residual));
      const double robust = 1.0 / std::pow(1.0 + 4.0 * residual * residual, 2);
      const double k = std::max(1.0 - a * a - b * b, 0.0) * robust;
      m0 += k;
      m13 += k * a * b * b * b;
      r4 += k * d.z() * a * b;
      weights += robust;
    }
    const auto middle = off.begin() + static_cast<std::ptrdiff_t>(count / 2);
    std::nth_element(off.begin(), middle, off.end());
    EXPECT_NEAR(sums.m[0], m0, 1e-12) << count;
    EXPECT_NEAR(sums.m[13], m13, 1e-12) << count;
    EXPECT_NEAR(sums.r[4], r4, 1e-12) << count;
    EXPECT_NEAR(points.weights(frame, height, 2.0), weights, 1e-12) << count;
    EXPECT_NEAR(points.median_residual(height), *middle, 1e-15) << count;
  }
}

TEST(Surround, OpenIsWhereAWideAngleIsEmpty) {
  constexpr int kSectors = 48, kOpenFrom = 22;
  Random random(14);
  int open = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    Surround seen;
    std::array<bool, kSectors> filled{};
    const auto points = random.below(9);
    for (std::uint64_t i = 0; i < points; ++i) {
      const double a = random.uniform(-1.0, 1.0), b = random.uniform(-1.0, 1.0);
      seen.add(a, b);
      filled[std::min(static_cast<std::size_t>(turn_of(a, b) * kSectors), std::size_t{kSectors - 1})] = true;
    }
    int run = 0, most = 0;
    for (std::size_t i = 0; i < 2 * std::size_t{kSectors}; ++i) {
      run = filled[i % kSectors] ? 0 : run + 1;
      most = std::max(most, run);
    }
    EXPECT_EQ(seen.open(), most >= kOpenFrom) << trial;
    open += seen.open() ? 1 : 0;
  }
  EXPECT_GT(open, 200);
  EXPECT_LT(open, 1800);
}

}  // namespace
}  // namespace palpate::render
