#include "toolkit/smooth/spline.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "toolkit/core/random.h"

namespace palpate::render {
namespace {

Brick any_brick(Random& random) {
  Brick brick;
  for (std::int16_t& one : brick.distance) one = static_cast<std::int16_t>(random.below(65536));
  return brick;
}

BrickPlace any_place(Random& random) {
  BrickPlace at;
  for (std::size_t a = 0; a < 3; ++a) {
    at.cell[a] = static_cast<int>(random.below(kBrickCells));
    // Walls too, and a little beyond them.
    at.t[a] = random.below(4) == 0 ? static_cast<float>(random.below(2))
                                   : static_cast<float>(random.uniform(-0.3, 1.3));
  }
  return at;
}

/// Weight k of the cubic B-spline at t, and of its derivatives.
double weight(int k, double t, int derivative) {
  const double s = 1.0 - t;
  const double of[3][4] = {
      {s * s * s / 6, 2.0 / 3 - t * t * (1 - t / 2), 2.0 / 3 - s * s * (1 - s / 2), t * t * t / 6},
      {-s * s / 2, t * (1.5 * t - 2), s * (2 - 1.5 * s), t * t / 2},
      {s, 3 * t - 2, 1 - 3 * t, t}};
  return of[derivative][k];
}
double plain(const Brick& brick, const BrickPlace& at, int x, int y, int z) {
  double sum = 0.0;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      for (int k = 0; k < 4; ++k) {
        const int node = ((at.cell[0] + i) * kBrickNodes + at.cell[1] + j) * kBrickNodes + at.cell[2] + k;
        sum += weight(i, static_cast<double>(at.t[0]), x) * weight(j, static_cast<double>(at.t[1]), y) *
               weight(k, static_cast<double>(at.t[2]), z) *
               static_cast<double>(brick.distance[static_cast<std::size_t>(node)]);
      }
  return sum * static_cast<double>(kBrickUnit);
}

TEST(Spline, IsItsFormula) {
  Random random(61);
  // 64 products of single precision, of numbers up to the reach: weights sum to one, and to four for the
  // second derivatives.
  constexpr double kRounding = 64 * 6e-8 * kBrickReach * 4;
  for (int round = 0; round < 300; ++round) {
    const Brick brick = any_brick(random);
    const BrickPlace at = any_place(random);
    const Jet jet = spline_jet(brick, at);
    const auto near = [&](float is, int x, int y, int z) {
      EXPECT_NEAR(static_cast<double>(is), plain(brick, at, x, y, z), kRounding) << x << y << z;
    };
    near(jet.value, 0, 0, 0);
    // In the brick itself it is as near as renderers say.
    if (std::all_of(at.t.begin(), at.t.end(), [](float t) { return t >= 0.0f && t <= 1.0f; })) {
      EXPECT_NEAR(static_cast<double>(jet.value), plain(brick, at, 0, 0, 0), kReadRounding);
    }
    near(jet.gradient.x(), 1, 0, 0);
    near(jet.gradient.y(), 0, 1, 0);
    near(jet.gradient.z(), 0, 0, 1);
    near(jet.second[0], 2, 0, 0);
    near(jet.second[1], 0, 2, 0);
    near(jet.second[2], 0, 0, 2);
    near(jet.second[3], 1, 1, 0);
    near(jet.second[4], 1, 0, 1);
    near(jet.second[5], 0, 1, 1);
  }
}

TEST(Spline, HasTheSameBitsByFourAndByEight) {
  Random random(62);
  const auto bits = [](float x) { return std::bit_cast<std::uint32_t>(x); };
  for (int round = 0; round < 20'000; ++round) {
    const Brick brick = any_brick(random);
    const BrickPlace at = any_place(random);
    const Jet a = spline_jet(brick, at), b = narrow_spline_jet(brick, at);
    ASSERT_EQ(bits(a.value), bits(b.value));
    for (int i = 0; i < 3; ++i) ASSERT_EQ(bits(a.gradient[i]), bits(b.gradient[i]));
    for (std::size_t i = 0; i < 6; ++i) ASSERT_EQ(bits(a.second[i]), bits(b.second[i]));
    // The value alone is the jet's.
    ASSERT_EQ(bits(spline_value(brick, at)), bits(a.value));
    ASSERT_EQ(bits(narrow_spline_value(brick, at)), bits(a.value));
  }
}

}  // namespace
}  // namespace palpate::render
