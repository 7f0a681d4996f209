// The passivity observer against energies worked out by hand, and the controller against renderers that give
// energy away.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "tests/toolkit/control/wall.h"
#include "toolkit/control/passivity.h"
#include "toolkit/core/random.h"

namespace palpate::control {
namespace {

constexpr double kPassivityDt = 1e-3;
constexpr EnergyRule kRules[] = {EnergyRule::kTrapezoid, EnergyRule::kPrinted, EnergyRule::kHold};

TEST(PassivityObserver, ASpringByHand) {
  // 0.5 N/mm, in 2 mm and out again in steps of 1 mm: F = 0, 0.5, 1, 0.5, 0.
  const double in_mj[] = {1.0, 1.5, 0.5};    // trapezoid; F(n): 0.5 + 1; F(n-1): 0 + 0.5
  const double out_mj[] = {0.0, 1.0, -1.0};  // k dh^2 / 2 = 0.25 too much or too little in each of 4 steps
  for (int rule = 0; rule < 3; ++rule) {
    PassivityObserver observer(kRules[rule]);
    for (const double z : {0.0, -1.0, -2.0}) observer.observe(Vec3(0, 0, z), Vec3(0, 0, -0.5 * z));
    EXPECT_DOUBLE_EQ(observer.energy_mj(), in_mj[rule]);
    for (const double z : {-1.0, 0.0}) observer.observe(Vec3(0, 0, z), Vec3(0, 0, -0.5 * z));
    EXPECT_DOUBLE_EQ(observer.energy_mj(), out_mj[rule]);
    EXPECT_DOUBLE_EQ(observer.least_mj(), std::min(0.0, out_mj[rule]));
  }
}

TEST(PassivityObserver, TheTrapezoidIsExactOnEveryClosedPathThroughASpring) {
  Random random(41);
  for (const double scale : {1e-3, 1.0, 1e6}) {
    const Vec3 around = scale * Vec3(1000, -2000, 500);
    std::vector<Vec3> path;
    for (int i = 0; i < 500; ++i)
      path.push_back(around +
                     scale * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)));
    path.push_back(path.front());
    PassivityObserver observer;
    double most = 0.0;
    for (const Vec3& h : path) {
      observer.observe(h, -0.5 * (h - around));
      most = std::max(most, std::abs(observer.energy_mj()));
    }
    EXPECT_LE(std::abs(observer.energy_mj()), 1e-9 * most) << "seed 41";
    EXPECT_GT(most, 0.0);
  }
}

TEST(PassivityObserver, PassesOverWhatIsNotFinite) {
  PassivityObserver observer;
  observer.observe(Vec3::Zero(), Vec3(0, 0, 1));
  observer.observe(Vec3(0, 0, std::nan("")), Vec3(0, 0, 1));
  observer.observe(Vec3(0, 0, -1), Vec3(0, 0, std::numeric_limits<double>::infinity()));
  observer.observe(Vec3(0, 0, -1), Vec3(0, 0, 1));
  EXPECT_DOUBLE_EQ(observer.energy_mj(), 1.0);
  observer.forget_surplus();
  EXPECT_DOUBLE_EQ(observer.energy_mj(), 0.0);
  observer.observe(Vec3(0, 0, 0), Vec3(0, 0, 1));
  observer.forget_surplus();
  EXPECT_DOUBLE_EQ(observer.energy_mj(), -1.0) << "what is owed is never forgotten";
}

/// In 2 mm and out at 20 mm/s, ten times, resting at the bottom.
std::vector<Vec3> taps(double step_mm = 0.02) {
  std::vector<Vec3> path;
  for (int tap = 0; tap < 10; ++tap) {
    for (double z = 0.5; z > -2.0; z -= step_mm) path.emplace_back(0, 0, z);
    for (int i = 0; i < 20; ++i) path.emplace_back(0, 0, -2.0);
    for (double z = -2.0; z < 0.5; z += step_mm) path.emplace_back(0, 0, z);
  }
  return path;
}

struct Outcome {
  double least_mj = 0.0;
  double last_mj = 0.0;
  std::uint64_t damped = 0;
  double most_change_n = 0.0;  ///< of what the controller added
};
Outcome run(double out_stiffness, const PassivityOptions& options, EnergyRule judge) {
  Wall wall;
  wall.out_stiffness_n_per_mm = out_stiffness;
  PassivityController controller(options);
  PassivityObserver observer(judge);
  Outcome outcome;
  wall.restart(Vec3(0, 0, 0.5), 0.0);
  double t_s = 0.0;
  for (const Vec3& h : taps()) {
    const Vec3 wanted_n = wall.step(h, t_s += kPassivityDt).force_n;
    const Vec3 force_n = controller.control(h, wanted_n, kPassivityDt);
    observer.observe(h, force_n);
    outcome.most_change_n = std::max(outcome.most_change_n, (force_n - wanted_n).norm());
  }
  outcome.least_mj = observer.least_mj();
  outcome.last_mj = observer.energy_mj();
  outcome.damped = controller.damped_frames();
  return outcome;
}

constexpr double kPlenty = 1e6;  // a damping limit that is never reached

TEST(PassivityController, LeavesAPassiveWallAlone) {
  const Outcome o = run(0.5, {EnergyRule::kTrapezoid, kPlenty}, EnergyRule::kTrapezoid);
  EXPECT_LT(o.most_change_n, 1e-9) << "a spring: nothing but rounding";
}

TEST(PassivityController, TakesBackAllThatAnActiveWallGives) {
  // Twice as stiff on the way out: 2 mJ for 1 mJ put in, ten times.
  const Outcome off = run(1.0, {EnergyRule::kTrapezoid, 1e-30}, EnergyRule::kTrapezoid);
  EXPECT_NEAR(off.last_mj, -10.0, 0.3);
  for (const EnergyRule rule : {EnergyRule::kTrapezoid, EnergyRule::kPrinted}) {
    const Outcome on = run(1.0, {rule, kPlenty}, rule);
    EXPECT_GE(on.least_mj, -1e-12) << "by its own rule nothing is ever given away";
    EXPECT_GT(on.damped, 100u);
  }
  // The rule of the printed form counts k dh^2 / 2 too much a step: judged exactly, a little gets away.
  const Outcome printed = run(1.0, {EnergyRule::kPrinted, kPlenty}, EnergyRule::kTrapezoid);
  EXPECT_LT(printed.least_mj, -1e-3);
  EXPECT_GT(printed.least_mj, -0.5);
}

TEST(PassivityController, DampingStaysWithinItsLimit) {
  const double limit = kDampingLimitNSPerMm;
  const Outcome o = run(1.0, {EnergyRule::kTrapezoid, limit}, EnergyRule::kTrapezoid);
  EXPECT_LE(o.most_change_n, limit * 20.0 * (1 + 1e-9)) << "20 mm/s";
  EXPECT_GT(o.most_change_n, 0.9 * limit * 20.0);
  EXPECT_GT(o.last_mj, -10.0) << "it takes what it may";
}

TEST(PassivityController, WhatFrictionTookDoesNotPayForAKick) {
  PassivityController controller({EnergyRule::kTrapezoid, kPlenty});
  const auto at = [&](double z, double force) {
    return controller.control(Vec3(0, 0, z), Vec3(0, 0, force), kPassivityDt).z();
  };
  (void)at(0.0, 0.0);
  for (int i = 1; i <= 10; ++i) (void)at(-0.1 * i, 1.0);  // a mJ is dissipated ..
  (void)at(-1.0, 0.0);                                    // .. and the contact ends
  (void)at(-1.0, 1.0);
  EXPECT_LT(at(-0.9, 1.0), 0.2) << "a push out of nothing is taken back at once";
  EXPECT_NEAR(controller.observer().energy_mj(), 0.0, 1e-12);
}

TEST(PassivityController, NothingInFreeSpaceAndNothingAtRest) {
  PassivityController controller({EnergyRule::kTrapezoid, kPlenty});
  (void)controller.control(Vec3::Zero(), Vec3(0, 0, 1), kPassivityDt);
  // A force that grew at rest: nothing can be taken while nothing moves.
  EXPECT_EQ(controller.control(Vec3::Zero(), Vec3(0, 0, 2), kPassivityDt), Vec3(0, 0, 2));
  PassivityController owing({EnergyRule::kTrapezoid, 1e-12});
  (void)owing.control(Vec3::Zero(), Vec3(0, 0, 1), kPassivityDt);
  (void)owing.control(Vec3(0, 0, 1), Vec3(0, 0, 1), kPassivityDt);
  EXPECT_LT(owing.observer().energy_mj(), -0.9);
  EXPECT_EQ(owing.control(Vec3(0, 0, 2), Vec3::Zero(), kPassivityDt), Vec3::Zero());
  EXPECT_LT(owing.observer().energy_mj(), -0.9) << "the debt stays";
}

TEST(PassivityController, KeepsTheForceLimit) {
  Random random(42);
  PassivityController controller({EnergyRule::kTrapezoid, 1.0});
  for (int i = 0; i < 5000; ++i) {
    const Vec3 h(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    const Vec3 f(random.normal(), random.normal(), random.normal());
    ASSERT_LE(controller.control(h, 3.0 * f, kPassivityDt, 3.3).norm(), 3.3 * (1 + 1e-12));
  }
}

TEST(PassivityController, NeverNan) {
  Random random(43);
  const double odd[] = {0.0,         1e-300, 1e300, 5e-324, 1.7e308, std::numeric_limits<double>::infinity(),
                        std::nan("")};
  const auto pick = [&] { return random.below(2) == 0 ? odd[random.below(7)] : random.uniform(-1, 1); };
  for (const EnergyRule rule : kRules) {
    PassivityController controller({rule, 0.005});
    for (int i = 0; i < 20000; ++i) {
      const Vec3 h(pick(), pick(), pick()), f(pick(), pick(), pick());
      ASSERT_TRUE(is_finite(controller.control(h, f, pick(), 3.3))) << "seed 43, frame " << i;
      ASSERT_TRUE(std::isfinite(controller.observer().energy_mj()));
    }
  }
}

}  // namespace
}  // namespace palpate::control
