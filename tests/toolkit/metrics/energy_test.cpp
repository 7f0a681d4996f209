// The passivity observer over replays.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "tests/toolkit/metrics/tiny.h"

namespace palpate::metrics {
namespace {

TEST(Energy, ASpringStoresHalfKD2AndGivesItBack) {
  Tiny t;
  for (const double z : {0.0, -1.0, -2.0, -1.0, 0.0}) t.add(z);
  const Result<Energy> e = observe_energy(t.path, t.trace, kStiffness);
  ASSERT_TRUE(e);
  EXPECT_DOUBLE_EQ(e->max_stored_mj, 1.0);  // 0.5 x 0.5 N/mm x (2 mm)^2
  EXPECT_DOUBLE_EQ(e->final_mj, 0.0);
  EXPECT_DOUBLE_EQ(e->generated_mj, 0.0);
  EXPECT_DOUBLE_EQ(*e->generated_percent, 0.0);
}

TEST(Energy, AKickIsFound) {
  Tiny t;
  for (const double z : {0.0, -1.0, -2.0, -2.0, -1.0, 0.0}) t.add(z);
  // After resting at 2 mm the force is twice what it was: on the way out 2 mJ for the 1 mJ put in.
  for (const std::size_t i : {3u, 4u}) t.trace.frames[i].force_n *= 2.0;
  const Result<Energy> e = observe_energy(t.path, t.trace, kStiffness);
  ASSERT_TRUE(e);
  // In: 0.25 + 0.75. Out: (2 + 1) / 2 + (1 + 0) / 2 = 2. E ends at -1; stored at most 2^2 / (2 x 0.5) = 4.
  EXPECT_DOUBLE_EQ(e->final_mj, -1.0);
  EXPECT_DOUBLE_EQ(e->generated_mj, 1.0);
  EXPECT_DOUBLE_EQ(e->max_stored_mj, 4.0);
  EXPECT_DOUBLE_EQ(*e->generated_percent, 25.0);
}

TEST(Energy, KnowsWhatIsNoMoreThanRounding) {
  // A spring on a closed path far from the origin: what it seems to generate is rounding.
  constexpr double kFarMm = 1e5;
  Tiny t;
  for (int turn = 0; turn < 300; ++turn)
    for (const double z : {0.1, -0.3, -1.7, -0.9, 0.1}) t.add(z, 0.1, kFarMm + 0.1 * turn);
  const Result<Energy> e = observe_energy(t.path, t.trace, kStiffness);
  ASSERT_TRUE(e);
  EXPECT_LT(e->rounding_mj, 1e-4 * e->max_stored_mj) << "0.01 % of what was stored is no rounding";
  EXPECT_GT(e->rounding_mj, 0.0);
  for (std::size_t i = 0; i < t.path.size(); ++i) t.path.hip_mm[i] += Vec3(0.1, 0.7, 1e4 / 3.0);
  const Result<Energy> moved = observe_energy(t.path, t.trace, kStiffness);
  ASSERT_TRUE(moved);
  EXPECT_NE(moved->final_mj, e->final_mj) << "moving it changes the last digits";
  EXPECT_LE(std::abs(moved->final_mj - e->final_mj), moved->rounding_mj + e->rounding_mj);
}

TEST(Energy, FrictionOnlyTakes) {
  Tiny t;
  t.add(-1.0, 0.1, 0.0).force_n.x() = -0.1;
  t.add(-1.0, 0.1, 1.0).force_n.x() = -0.1;  // moving along +x against -0.1 N
  const Result<Energy> e = observe_energy(t.path, t.trace, kStiffness);
  ASSERT_TRUE(e);
  EXPECT_DOUBLE_EQ(e->final_mj, 0.1);
  EXPECT_DOUBLE_EQ(*e->generated_percent, 0.0);
}

TEST(Energy, EachModelStoresWithItsOwnStiffness) {
  Tiny t;
  for (const double z : {0.0, -1.0, 0.0}) t.add(z);
  t.trace.frames[1].model = 1;
  // 0.5 N in a spring of 0.25 N/mm: 0.5 mJ. Of the first model's 0.5 N/mm it would be half of that.
  const std::array<double, 2> stiffness = {0.5, 0.25};
  EXPECT_DOUBLE_EQ(observe_energy(t.path, t.trace, stiffness)->max_stored_mj, 0.5);
  t.trace.frames[1].model = 7;
  EXPECT_DOUBLE_EQ(observe_energy(t.path, t.trace, stiffness)->max_stored_mj, 0.25) << "unknown: the first";
  EXPECT_FALSE(observe_energy(t.path, t.trace, std::array<double, 2>{0.5, 0.0}));
  EXPECT_FALSE(observe_energy(t.path, t.trace, std::span<const double>{}));
}

TEST(Energy, TheKickAtABorderOfStiffness) {
  // In 2 mm at 0.25 N/mm (soft), aside to 0.5 N/mm (rigid), and out: the step of section 3.3.2.3. In
  // 0.5 mJ; aside nothing, the force stands across; out 1 mJ. So 0.5 mJ from nowhere, of 1 mJ stored at most.
  Tiny t;
  for (const double z : {0.0, -2.0}) t.add(z);
  t.trace.frames[1].force_n *= 0.5;
  t.add(-2.0, 0.1, 1.0);
  t.add(0.0, 0.1, 1.0);
  const Result<Energy> e = observe_energy(t.path, t.trace, kStiffness);
  ASSERT_TRUE(e);
  EXPECT_DOUBLE_EQ(e->final_mj, -0.5);
  EXPECT_DOUBLE_EQ(e->max_stored_mj, 1.0);
  EXPECT_DOUBLE_EQ(*e->generated_percent, 50.0);
}

TEST(Energy, NothingWithoutContact) {
  Tiny t;
  t.add(1.0);
  const Result<Energy> e = observe_energy(t.path, t.trace, kStiffness);
  ASSERT_TRUE(e);
  EXPECT_FALSE(e->generated_percent.has_value());
  EXPECT_EQ(e->generated_mj, 0.0);
}

TEST(Energy, RefusesNonsense) {
  Tiny t;
  t.add(1.0);
  EXPECT_FALSE(observe_energy(t.path, t.trace, 0.0));
  t.trace.frames[0].force_n.x() = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(observe_energy(t.path, t.trace, kStiffness));
  t.trace.frames.clear();
  EXPECT_FALSE(observe_energy(t.path, t.trace, kStiffness));
}

}  // namespace
}  // namespace palpate::metrics
