// Tasks at their rates on a virtual clock, and the four loops of reference [77] handing candidates over.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/control/rates.h"
#include "toolkit/core/handover.h"
#include "toolkit/render/motion.h"
#include "toolkit/render/slow_phase.h"

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

/// Sixty planes of 20 x 20 mm, 30 mm apart, that slide at 100 mm/s, with the simulation that moves them.
struct SlidingRow {
  render::SceneInput scene;
  std::shared_ptr<render::ScriptedSimulation> simulation = std::make_shared<render::ScriptedSimulation>();
};
SlidingRow sliding_row() {
  SlidingRow row;
  const render::ModelInput plane = render::generated("plane:extent_mm=20:spacing_mm=1").input.models[0];
  for (int i = 0; i < 60; ++i) {
    render::ScriptedMotion motion;
    motion.start.translation_mm = Vec3(30.0 * i, 0, 0);
    motion.velocity_mm_s = Vec3(100, 0, 0);
    row.scene.models.push_back(plane);
    row.scene.models.back().world_from_model = motion.start;
    row.scene.models.back().motion = row.simulation->add(motion);
  }
  return row;
}

struct Compared {
  std::uint64_t contacts = 0, late = 0, differ = 0;
};

/// The four loops around a renderer whose broad phase runs on a loop of its own, against one that looks for
/// itself whenever it must. The HIP goes along the row the other way, in and out.
Compared with_four_rates(const FourRates& rates, double hip_mm_s) {
  SlidingRow row = sliding_row(), split_row = sliding_row();
  const auto alone = render::prepared(row.scene, "cloud");
  const auto split = render::prepared(split_row.scene, "cloud");
  auto& slow = dynamic_cast<render::SlowPhase&>(*split);
  slow.run_slow_phase_elsewhere();
  const auto hip_at = [&](double t_s) {
    return Vec3(1700.0 - hip_mm_s * t_s, 1.0, 1.0 + 2.0 * std::cos(20.0 * t_s));
  };
  Vec3 before = hip_at(0.0);
  alone->restart(before);
  split->restart(before);
  Handover<Vec3> asked(before);
  Compared result;
  RateScheduler scheduler;
  const double frame_s = 1.0 / static_cast<double>(rates.narrow_phase_hz);
  EXPECT_TRUE(add_four_rates(scheduler, rates,
                             {[&](double t_s) {
                                row.simulation->advance(t_s);
                                split_row.simulation->advance(t_s);
                              },
                              [&](double t_s) {
                                asked.acquire();
                                slow.slow_phase(t_s, before, asked.front());
                                before = asked.front();
                              },
                              [&](double t_s) {
                                const Vec3 hip = hip_at(t_s);
                                asked.publish(hip);
                                const render::Frame a = alone->step(hip, frame_s);
                                const render::Frame b = split->step(hip, frame_s);
                                result.contacts += a.contact;
                                result.late += b.status == render::FrameStatus::kBoundHit;
                                result.differ += a.contact != b.contact || a.model != b.model ||
                                                 a.force_n != b.force_n || a.god_object_mm != b.god_object_mm;
                              },
                              {}}));
  scheduler.run_until(4.0);
  return result;
}

// A list covers the HIP's way up to a sixteenth of the models' mean diagonal, 28.3 / 16 = 1.77 mm, and 20 ms.
// It is asked for every 10 ms with a HIP one frame old: at 100 mm/s the HIP goes 1.1 mm meanwhile, at
// 400 4.4.
TEST(FourRates, ABroadPhaseOnItsOwnLoopGivesTheSameFrames) {
  const Compared in_time = with_four_rates({}, 100.0);
  EXPECT_GT(in_time.contacts, 500u);
  EXPECT_EQ(in_time.differ, 0u);
  EXPECT_EQ(in_time.late, 0u);
}

TEST(FourRates, ABroadPhaseThatIsTooSlowIsNoticedAndNothingIsMissed) {
  FourRates lazy;
  lazy.broad_phase_hz = 20;  // every 50 ms
  for (const auto& [rates, hip_mm_s] : {std::pair(FourRates{}, 400.0), std::pair(lazy, 10.0)}) {
    SCOPED_TRACE(hip_mm_s);
    const Compared too_slow = with_four_rates(rates, hip_mm_s);
    EXPECT_GT(too_slow.contacts, 300u);
    EXPECT_EQ(too_slow.differ, 0u);
    EXPECT_GT(too_slow.late, 500u);
  }
}

}  // namespace
}  // namespace palpate::control
