// What is left out beside a surface that is known.
#include <gtest/gtest.h>

#include <vector>

#include "toolkit/smooth/strays.h"

namespace palpate::render {
namespace {

constexpr double kWide = 10.0;

/// Flat, a spacing of one, and beyond doubt; with points everywhere, or only where x is less than nothing.
Patch known_patch(bool everywhere) {
  Patch p;
  p.support = p.reached = kWide;
  p.spacing = 1.0;
  p.sigma = p.noise = 0.1;
  p.points = 300;
  p.sure = true;
  p.filled = Filled(2000);
  for (int i = 0; i <= 80; ++i)
    for (int j = 0; j <= 80; ++j) {
      const double a = 0.025 * (i - 40), b = 0.025 * (j - 40);
      if (everywhere || a < 0.0) p.filled.add(a, b);
    }
  return p;
}
Patch small_patch(const Vec3& at, double spacing) {
  Patch p;
  p.quadric.at = at;
  p.support = p.reached = 1.3 * spacing;
  p.spacing = spacing;
  p.sigma = p.noise = 0.1;
  p.points = 9;
  return p;
}
std::size_t left_of(const std::vector<Patch>& given) {
  std::vector<Patch> one = given, two = given;
  drop_beside_sure(one, 1);
  drop_beside_sure(two, 2);
  EXPECT_EQ(one.size(), two.size());
  return one.size();
}

TEST(Strays, WhatLiesBesideAKnownSurfaceIsLeftOut) {
  const Patch known = known_patch(true);
  EXPECT_EQ(left_of({known, small_patch({1.0, 0.5, 2.0}, 1.0)}), 1u);
  EXPECT_EQ(left_of({small_patch({1.0, 0.5, -2.0}, 1.0), known}), 1u);
  // On it, and far from it.
  EXPECT_EQ(left_of({known, small_patch({1.0, 0.5, 0.2}, 1.0)}), 2u);
  EXPECT_EQ(left_of({known, small_patch({1.0, 0.5, 13.0}, 1.0)}), 2u);
  // On it, but of few points that are not its own.
  EXPECT_EQ(left_of({known, small_patch({1.0, 0.5, 0.2}, 2.5)}), 1u);
  // Beyond doubt itself: another sheet.
  Patch other = known;
  other.quadric.at.z() = 1.0;
  EXPECT_EQ(left_of({known, other}), 2u);
}

TEST(Strays, WhereTheKnownSurfaceEndsTheyStay) {
  const Patch known = known_patch(false);
  EXPECT_EQ(left_of({known, small_patch({1.0, 0.5, 2.0}, 1.0)}), 2u);
  EXPECT_EQ(left_of({known, small_patch({-5.0, 0.5, 2.0}, 1.0)}), 1u);
}

}  // namespace
}  // namespace palpate::render
