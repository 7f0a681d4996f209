// Tasks at their rates on a virtual clock, and the four loops of reference [77] handing candidates over.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "toolkit/control/rates.h"
#include "toolkit/core/handover.h"
#include "toolkit/geometry/broad_phase.h"

namespace palpate::control {
namespace {

TEST(RateScheduler, RunsInTheOrderOfTimeAndTiesInTheOrderOfAdding) {
  RateScheduler scheduler;
  std::string order;
  ASSERT_TRUE(scheduler.add("a", 2, [&](double) { order += 'a'; }));
  ASSERT_TRUE(scheduler.add("b", 4, [&](double) { order += 'b'; }));
  ASSERT_TRUE(scheduler.add("c", 3, [&](double) { order += 'c'; }));
  scheduler.run_until(1.0);
  // 0: abc, 1/4: b, 1/3: c, 1/2: ab, 2/3: c, 3/4: b
  EXPECT_EQ(order, "abcbcabcb");
  scheduler.run_until(1.0 + 1e-9);
  EXPECT_EQ(order, "abcbcabcbabc") << "what is due at the end belongs to the next stretch";
}

TEST(RateScheduler, NoDriftInTenMinutes) {
  RateScheduler scheduler;
  constexpr std::array<std::int64_t, 5> kRates = {60, 200, 100, 1000, 7};
  std::array<std::int64_t, 5> count{};
  std::array<double, 5> worst_s{};
  for (std::size_t i = 0; i < kRates.size(); ++i)
    ASSERT_TRUE(scheduler.add("task", kRates[i], [&, i](double t_s) {
      const double exact_s = static_cast<double>(count[i]++) / static_cast<double>(kRates[i]);
      worst_s[i] = std::max(worst_s[i], std::abs(t_s - exact_s));
    }));
  scheduler.run_until(600.0);
  for (std::size_t i = 0; i < kRates.size(); ++i) {
    EXPECT_EQ(count[i], 600 * kRates[i]);
    EXPECT_LT(worst_s[i], 1.001e-9) << "a whole nanosecond at most, after ten minutes too";
  }
  EXPECT_EQ(scheduler.clock().now_ns(), 600'000'000'000);
}

TEST(RateScheduler, PiecesOfTimeMakeNoDifference) {
  const auto order_in = [](double piece_s) {
    RateScheduler scheduler;
    std::string order;
    EXPECT_TRUE(add_four_rates(scheduler, {},
                               {[&](double) { order += 's'; }, [&](double) { order += 'b'; },
                                [&](double) { order += 'n'; }, [&](double) { order += 'g'; }}));
    for (int i = 1; i * piece_s <= 0.5; ++i) scheduler.run_until(i * piece_s);
    scheduler.run_until(0.5);
    return order;
  };
  EXPECT_EQ(order_in(0.5), order_in(0.0007));
  EXPECT_EQ(order_in(0.5).substr(0, 4), "sbng");
  EXPECT_EQ(order_in(0.5).size(), 100u + 50u + 500u + 30u);
}

TEST(RateScheduler, ATaskAddedLaterJoinsAtItsNextBeat) {
  RateScheduler scheduler;
  scheduler.run_until(0.0105);
  std::vector<double> times;
  ASSERT_TRUE(scheduler.add("late", 100, [&](double t_s) { times.push_back(t_s); }));
  scheduler.run_until(0.045);
  EXPECT_EQ(times, (std::vector<double>{0.02, 0.03, 0.04}));
}

TEST(RateScheduler, RefusesRatesThatAreNone) {
  RateScheduler scheduler;
  EXPECT_FALSE(scheduler.add("still", 0, [](double) {}));
  EXPECT_FALSE(scheduler.add("too fast", RateScheduler::kMostHz + 1, [](double) {}));
  EXPECT_FALSE(scheduler.add("empty", 10, {}));
  for (std::size_t i = 0; i < RateScheduler::kMostTasks; ++i)
    ASSERT_TRUE(scheduler.add("t", 1, [](double) {}));
  EXPECT_FALSE(scheduler.add("one too many", 1, [](double) {}));
}

/// A row of cubes that slide at 100 mm/s past a HIP at 157 mm/s the other way (no whole number of cubes in a
/// period); the fast loop touches only
/// what the slow one handed over. Frames in which it should have touched and could not.
struct Missed {
  int frames = 0, missed = 0;
};
Missed missed_contacts(double reach_mm) {
  constexpr double kModel = 100.0, kHip = 157.0;
  constexpr std::size_t kCubes = 300;
  const FourRates rates;
  std::vector<geometry::Aabb> boxes(kCubes);
  const auto pose = [&](double t_s) {
    for (std::size_t i = 0; i < kCubes; ++i) {
      const Vec3 at(static_cast<double>(i) * 5.0 + kModel * t_s, 0, 0);
      boxes[i] = {at, at + Vec3(2, 2, 2)};
    }
  };
  pose(0.0);
  geometry::BroadPhase phase(boxes);
  Handover<geometry::Candidates<8>> found;
  Handover<Vec3> asked(Vec3(1000, 1, 1));
  Missed result;
  RateScheduler scheduler;
  EXPECT_TRUE(add_four_rates(scheduler, rates,
                             {[&](double t_s) { pose(t_s); },
                              [&](double) {
                                asked.acquire();
                                phase.update(boxes);
                                phase.query(asked.front(), reach_mm, found.back());
                                found.publish();
                              },
                              [&](double t_s) {
                                const Vec3 hip(1000.0 - kHip * t_s, 1, 1);
                                asked.publish(hip);
                                found.acquire();
                                for (std::uint32_t i = 0; i < kCubes; ++i) {
                                  if (!boxes[i].contains(hip)) continue;
                                  ++result.frames;
                                  bool handed = false;
                                  for (const geometry::BoxHit& hit : found.front().hits())
                                    handed = handed || hit.item == i;
                                  result.missed += handed ? 0 : 1;
                                }
                              },
                              {}}));
  scheduler.run_until(2.0);
  return result;
}

TEST(FourRates, WhatIsNeededIsHandedOverInTimeAndNotMuchLess) {
  const Missed enough = missed_contacts(needed_reach_mm({}, 157.0, 100.0));
  EXPECT_GT(enough.frames, 500);
  EXPECT_EQ(enough.missed, 0);
  EXPECT_GT(missed_contacts(needed_reach_mm({}, 157.0, 100.0) / 8.0).missed, 0) << "the reach matters";
  // (150 + 100) mm/s x 2 x (10 + 1) ms + 100 mm/s x 5 ms
  EXPECT_NEAR(needed_reach_mm({}, 150.0, 100.0), 6.0, 1e-12);
}

}  // namespace
}  // namespace palpate::control
