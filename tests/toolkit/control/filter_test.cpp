// The force filter: both limits hold exactly, release is exact, delays are as computed by hand.
#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <cmath>
#include <limits>
#include <numbers>

#include "toolkit/control/force_filter.h"
#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"

namespace palpate::control {
namespace {

constexpr double kFilterDt = 1e-3;
constexpr double kDeg = std::numbers::pi / 180.0;

double angle_deg(const Vec3& a, const Vec3& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) / kDeg;
}
Vec3 random_force(Random& random) {
  return random.uniform(0.0, 3.0) * Vec3(random.normal(), random.normal(), random.normal()).normalized();
}

TEST(ForceFilter, OffIsTheIdentity) {
  Random random(31);
  ForceFilter filter;
  for (int i = 0; i < 100; ++i) {
    const Vec3 f = random_force(random);
    EXPECT_EQ(filter.filter(f, kFilterDt), f);
  }
}

TEST(ForceFilter, BothLimitsHoldInBothForms) {
  Random random(32);
  for (const FilterForm form : {FilterForm::kPerTime, FilterForm::kLiteral})
    for (const double rate : {0.0, 50.0, 1000.0})
      for (const double turn : {0.0, 500.0, 20000.0}) {
        ForceFilter filter({rate, turn, form});
        Vec3 last = Vec3::Zero();
        for (int i = 0; i < 2000; ++i) {
          const Vec3 wanted = random.below(50) == 0 ? Vec3(Vec3::Zero()) : random_force(random);
          const Vec3 f = filter.filter(wanted, kFilterDt);
          const bool released = wanted == Vec3::Zero() && form == FilterForm::kPerTime;
          const bool rated = rate > 0.0 && !released,
                     turned = turn > 0.0 && f.norm() > 1e-9 && last.norm() > 1e-9;
          ASSERT_TRUE(!rated || (f - last).norm() <= rate * kFilterDt * (1 + 1e-12))
              << "seed 32, frame " << i;
          ASSERT_TRUE(!turned || angle_deg(last, f) <= turn * kFilterDt + 1e-6) << "seed 32, frame " << i;
          last = f;
        }
      }
}

TEST(ForceFilter, RateByHand) {
  ForceFilter filter({100.0, 0.0});  // 0.1 N a millisecond
  EXPECT_NEAR(filter.filter(Vec3(1, 0, 0), kFilterDt).x(), 0.1, 1e-15);
  EXPECT_NEAR(filter.filter(Vec3(1, 0, 0), 3 * kFilterDt).x(), 0.4, 1e-15)
      << "a longer frame may change more";
  EXPECT_NEAR(filter.filter(Vec3(0.45, 0, 0), kFilterDt).x(), 0.45, 1e-15);
  EXPECT_NEAR(filter.filter(Vec3(0, 1, 0), kFilterDt).norm(),
              std::hypot(0.45 - 0.1 * 0.45 / std::hypot(0.45, 1.0), 0.1 / std::hypot(0.45, 1.0)), 1e-15);
}

TEST(ForceFilter, TurnByHand) {
  const Vec3 x(2, 0, 0), y(0, 2, 0);
  ForceFilter literal({0.0, 30000.0, FilterForm::kLiteral}),
      ours({0.0, 30000.0});  // 30 degrees a millisecond
  (void)literal.filter(x, kFilterDt);
  (void)ours.filter(x, kFilterDt);
  EXPECT_LT((literal.filter(y, kFilterDt) - 2.0 * Vec3(std::cos(30 * kDeg), 0.5, 0)).norm(), 1e-15);
  // Ours: the part of the wanted force along 30 degrees, 60 degrees short of it: half its size.
  EXPECT_LT((ours.filter(y, kFilterDt) - 1.0 * Vec3(std::cos(30 * kDeg), 0.5, 0)).norm(), 1e-15);
  for (int i = 0; i < 3; ++i) (void)ours.filter(y, kFilterDt);
  EXPECT_EQ(ours.filter(y, kFilterDt), y) << "once there nothing is changed, to the last bit";
}

TEST(ForceFilter, AReversedForceGoesThroughZeroInOursAndAroundInTheLiteralForm) {
  ForceFilter literal({0.0, 30000.0, FilterForm::kLiteral}), ours({0.0, 30000.0});
  (void)literal.filter(Vec3(1, 0, 0), kFilterDt);
  (void)ours.filter(Vec3(1, 0, 0), kFilterDt);
  const Vec3 around = literal.filter(Vec3(-1, 0, 0), kFilterDt);
  EXPECT_NEAR(angle_deg(around, Vec3(1, 0, 0)), 30.0, 1e-9);
  EXPECT_NEAR(around.norm(), 1.0, 1e-15) << "pushes aside with all of a force nobody asked for there";
  EXPECT_EQ(ours.filter(Vec3(-1, 0, 0), kFilterDt), Vec3::Zero());
  EXPECT_EQ(ours.filter(Vec3(-1, 0, 0), kFilterDt), Vec3(-1, 0, 0));
}

TEST(ForceFilter, ReleaseIsExactInOursAndFadesInTheLiteralForm) {
  ForceFilter literal({100.0, 0.0, FilterForm::kLiteral}), ours({100.0, 0.0});
  for (int i = 0; i < 3; ++i) {
    (void)literal.filter(Vec3(0.25, 0, 0), kFilterDt);
    (void)ours.filter(Vec3(0.25, 0, 0), kFilterDt);
  }
  EXPECT_EQ(ours.filter(Vec3::Zero(), kFilterDt), Vec3::Zero());
  EXPECT_NEAR(literal.filter(Vec3::Zero(), kFilterDt).x(), 0.15, 1e-15);
  EXPECT_NEAR(literal.filter(Vec3::Zero(), kFilterDt).x(), 0.05, 1e-15);
  EXPECT_EQ(literal.filter(Vec3::Zero(), kFilterDt), Vec3::Zero()) << "and ends at exactly nothing";
}

TEST(ForceFilter, TheLiteralFormCountsFramesNotTime) {
  ForceFilter fast({100.0, 0.0, FilterForm::kLiteral}), ours({100.0, 0.0});
  double literal_n = 0.0, ours_n = 0.0;
  for (int i = 0; i < 5; ++i) {
    literal_n = fast.filter(Vec3(9, 0, 0), 0.2e-3).x();
    ours_n = ours.filter(Vec3(9, 0, 0), 0.2e-3).x();
  }
  EXPECT_NEAR(literal_n, 0.5, 1e-14) << "at 5 kHz five times the change in a millisecond";
  EXPECT_NEAR(ours_n, 0.1, 1e-14);
}

TEST(ForceFilter, NeverNan) {
  Random random(33);
  const double odd[] = {0.0,         1e-300, 1e300, 5e-324, 1.7e308, std::numeric_limits<double>::infinity(),
                        std::nan("")};
  const auto pick = [&] { return random.below(2) == 0 ? odd[random.below(7)] : random.uniform(-1, 1); };
  for (const FilterForm form : {FilterForm::kPerTime, FilterForm::kLiteral}) {
    ForceFilter filter({100.0, 90.0, form});
    for (int i = 0; i < 20000; ++i)
      ASSERT_TRUE(is_finite(filter.filter(Vec3(pick(), pick(), pick()), pick()))) << "seed 33, frame " << i;
  }
}

TEST(FilterDelay, OfARateLimitByHand) {
  const Result<FilterDelay> delay = filter_delay({100.0, 0.0}, {});
  ASSERT_TRUE(delay);
  // 1 N in steps of 0.1: the 7th frame has 0.7, the 10th 1.0; the first frame is at time 0.
  EXPECT_NEAR(delay->size.to_63_percent_s, 6e-3, 1e-12);
  EXPECT_NEAR(delay->size.to_95_percent_s, 9e-3, 1e-12);
  ASSERT_TRUE(delay->size.ramp_lag_s);
  EXPECT_NEAR(*delay->size.ramp_lag_s, 0.0, 1e-12) << "10 N/s passes";
  // 10 degrees of 1 N are a change of 0.174 N, two frames.
  EXPECT_NEAR(delay->direction.to_95_percent_s, 1e-3, 1e-12);
  FilterProbe steep;
  steep.ramp_n_per_s = 101.0;
  EXPECT_FALSE(filter_delay({100.0, 0.0}, steep)->size.ramp_lag_s) << "it falls behind for ever";
}

TEST(FilterDelay, OfATurnLimitByHand) {
  for (const FilterForm form : {FilterForm::kPerTime, FilterForm::kLiteral}) {
    const Result<FilterDelay> delay = filter_delay({0.0, 1000.0, form}, {});
    ASSERT_TRUE(delay);
    EXPECT_EQ(delay->size.to_95_percent_s, 0.0) << "from nothing a force may have any direction";
    EXPECT_NEAR(delay->direction.to_63_percent_s, 6e-3, 1e-12);  // 10 degrees, one a frame
    EXPECT_NEAR(delay->direction.to_95_percent_s, 9e-3, 1e-12);
    ASSERT_TRUE(delay->direction.ramp_lag_s);
    EXPECT_NEAR(*delay->direction.ramp_lag_s, 0.0, 1e-9);
    FilterProbe quick;
    quick.ramp_deg_per_s = 1100.0;
    EXPECT_FALSE(filter_delay({0.0, 1000.0, form}, quick)->direction.ramp_lag_s);
  }
}

TEST(FilterDelay, AgreesWithTheFormulaWhateverTheLimit) {
  Random random(34);
  for (int i = 0; i < 50; ++i) {
    const double rate = std::pow(10.0, random.uniform(0.5, 3.0));
    FilterProbe probe;
    probe.step_n = random.uniform(0.1, 3.0);
    probe.dt_s = random.uniform(0.2e-3, 2e-3);
    const Result<FilterDelay> delay = filter_delay({rate, 0.0}, probe);
    ASSERT_TRUE(delay) << delay.error().message();
    const double frames = std::ceil(0.95 * probe.step_n / (rate * probe.dt_s)) - 1.0;
    EXPECT_NEAR(delay->size.to_95_percent_s, frames * probe.dt_s, 1e-9) << "seed 34, " << rate;
  }
}

TEST(FilterDelay, OffHasNone) {
  const Result<FilterDelay> delay = filter_delay({}, {});
  ASSERT_TRUE(delay);
  for (const StepDelay& d : {delay->size, delay->direction}) {
    EXPECT_EQ(d.to_63_percent_s, 0.0);
    EXPECT_EQ(d.to_95_percent_s, 0.0);
    EXPECT_NEAR(d.ramp_lag_s.value_or(1.0), 0.0, 1e-12);
  }
}

TEST(FilterDelay, RefusesWhatCannotBeMeasured) {
  EXPECT_FALSE(filter_delay({-1.0, 0.0}, {}));
  EXPECT_FALSE(filter_delay({std::nan(""), 0.0}, {}));
  EXPECT_FALSE(filter_delay({1e-6, 0.0}, {})) << "a million seconds";
  FilterProbe wide;
  wide.step_deg = 120.0;
  EXPECT_FALSE(filter_delay({1.0, 0.0}, wide));
  FilterProbe still;
  still.dt_s = 0.0;
  EXPECT_FALSE(filter_delay({1.0, 0.0}, still));
}

}  // namespace
}  // namespace palpate::control
