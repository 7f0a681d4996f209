// The governor alone, on times given by hand.
#include <palpate/device/force_governor.h>

#include <limits>
#include <type_traits>

#include "tests/device/governor_rig.h"
#include "tests/device/helpers.h"
#include "toolkit/core/random.h"

namespace palpate::device {
namespace {

// No path around the governor: nothing else can make, copy or assign a governed force.
static_assert(!std::is_default_constructible_v<GovernedForce>);
static_assert(!std::is_constructible_v<GovernedForce, Vec3>);
static_assert(!std::is_convertible_v<Vec3, GovernedForce>);
static_assert(!std::is_copy_constructible_v<GovernedForce>);
static_assert(!std::is_copy_assignable_v<GovernedForce> && !std::is_move_assignable_v<GovernedForce>);
static_assert(!std::is_invocable_v<decltype(&Device::send), Device&, Vec3>);
static_assert(!std::is_aggregate_v<GovernedForce>);
static_assert(!std::is_constructible_v<ForceGovernor, double, GovernorOptions>);

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

TEST(Governor, RefusesLimitsThatAreNone) {
  for (const double bad : {0.0, -1.0, kNan, kInf}) {
    DeviceLimits limits = arm_limits();
    limits.force_max_n = bad;
    EXPECT_FALSE(ForceGovernor::create(limits, {})) << bad;
    for (double GovernorOptions::*member :
         {&GovernorOptions::slew_n_per_s, &GovernorOptions::soft_start_s, &GovernorOptions::period_s,
          &GovernorOptions::late_zero_s, &GovernorOptions::late_ramp_s, &GovernorOptions::latch_late_s,
          &GovernorOptions::silence_s, &GovernorOptions::jump_mm_per_s}) {
      GovernorOptions options;
      options.*member = bad;
      EXPECT_FALSE(ForceGovernor::create(arm_limits(), options)) << bad;
    }
  }
  GovernorOptions options{.user_limit_n = -1.0};
  EXPECT_TRUE(refused(ForceGovernor::create(arm_limits(), options), "user's force limit"));
}

TEST(Governor, TheLesserLimitHolds) {
  GovernorOptions options;
  EXPECT_DOUBLE_EQ(governor(options).limit_n(), 0.7 * 3.3) << "new users";
  options.user_limit_n = 1.0;
  EXPECT_DOUBLE_EQ(governor(options).limit_n(), 1.0);
  options.user_limit_n = 100.0;
  EXPECT_DOUBLE_EQ(governor(options).limit_n(), 3.3);
}

TEST(Governor, ZeroUntilArmed) {
  ForceGovernor g = governor();
  EXPECT_EQ(g.govern(0.0, at(Vec3::Zero()), {1, 0, 0}).newtons(), Vec3::Zero());
  EXPECT_FALSE(g.armed());
}

TEST(Governor, SoftStartRisesLinearly) {
  GovernorOptions options{.slew_n_per_s = 1e6};
  ForceGovernor g = governor(options);
  g.arm(10.0);
  EXPECT_EQ(g.govern(10.0, at(Vec3::Zero()), {1, 0, 0}).newtons(), Vec3::Zero());
  for (int i = 1; i <= 600; ++i) {
    const double x = g.govern(10.0 + i * kMs, at(Vec3::Zero()), {1, 0, 0}).newtons().x();
    EXPECT_NEAR(x, std::min(1.0, i / 500.0), 1e-9) << i;
  }
}

TEST(Governor, ClampKeepsTheDirection) {
  GovernorOptions options{.user_limit_n = 2.0, .slew_n_per_s = 1e6};
  ForceGovernor g = governor(options);
  const double t = rest(g, Vec3::Zero(), Vec3::Zero());
  const Vec3 out = g.govern(t + kMs, at(Vec3::Zero()), {30, 40, 0}).newtons();
  EXPECT_NEAR((out - Vec3(1.2, 1.6, 0.0)).norm(), 0.0, 1e-12);
  const Vec3 huge = g.govern(t + 2 * kMs, at(Vec3::Zero()), {-1.7e308, 1.7e308, 0}).newtons();
  EXPECT_NEAR((huge - Vec3(-1, 1, 0).normalized() * 2.0).norm(), 0.0, 1e-12);
  EXPECT_EQ(g.counters().clamped, 2u);
}

TEST(Governor, SlewLimitsEachStep) {
  GovernorOptions options{.slew_n_per_s = 500.0};
  ForceGovernor g = governor(options);
  const double t = rest(g, Vec3::Zero(), Vec3::Zero());
  EXPECT_NEAR(g.govern(t + kMs, at(Vec3::Zero()), {2, 0, 0}).newtons().x(), 0.5, 1e-12);
  EXPECT_NEAR(g.govern(t + 2 * kMs, at(Vec3::Zero()), {2, 0, 0}).newtons().x(), 1.0, 1e-12);
  // Four periods late, which is not yet too late: still one period's step.
  EXPECT_NEAR(g.govern(t + 6 * kMs, at(Vec3::Zero()), {2, 0, 0}).newtons().x(), 1.5, 1e-12);
  EXPECT_EQ(g.counters().slewed, 3u);
}

// Every fault, in one table: zero in the frame it is seen in, latched until armed again, then a soft start.
struct Broken {
  const char* name;
  Fault fault;
  double after_s;  // since the last good frame
  DeviceState state;
  Vec3 wanted_n;
};

class EveryFault : public testing::TestWithParam<Broken> {};

TEST_P(EveryFault, IsZeroAtOnceAndLatches) {
  const Broken& broken = GetParam();
  ForceGovernor g = governor();
  const Vec3 wanted(0.9, -1.2, 0.5);
  const double t = rest(g, Vec3::Zero(), wanted);
  ASSERT_EQ(g.govern(t + kMs, at(Vec3::Zero()), wanted).newtons(), wanted);
  const double bad_s = t + kMs + broken.after_s;
  EXPECT_EQ(g.govern(bad_s, broken.state, broken.wanted_n).newtons(), Vec3::Zero());
  EXPECT_EQ(g.fault(), broken.fault) << fault_name(g.fault());
  EXPECT_FALSE(g.armed());
  EXPECT_EQ(g.counters().faults, 1u);
  for (int i = 1; i < 100; ++i)
    EXPECT_EQ(g.govern(t + i, at(Vec3::Zero()), wanted).newtons(), Vec3::Zero()) << "no re-arming by itself";
  g.arm(1000.0);
  EXPECT_EQ(g.fault(), Fault::kNone);
  EXPECT_LT(g.govern(1000.0 + kMs, at({40, 0, 0}), wanted).newtons().norm(), 0.01) << "soft start";
}

INSTANTIATE_TEST_SUITE_P(
    Faults, EveryFault,
    testing::Values(
        Broken{"nan_force", Fault::kNonFiniteForce, kMs, at(Vec3::Zero()), {kNan, 0, 0}},
        Broken{"infinite_force", Fault::kNonFiniteForce, kMs, at(Vec3::Zero()), {0, 0, -kInf}},
        Broken{"nan_position", Fault::kNonFinitePosition, kMs, at({0, kNan, 0}), {1.5, 0, 0}},
        Broken{"jump", Fault::kJump, kMs, at({5.1, 0, 0}), {1.5, 0, 0}},
        Broken{"endless_jump", Fault::kJump, kMs, at({1e308, 1e308, 1e308}), {1.5, 0, 0}},
        Broken{"lost", Fault::kLost, kMs, at(Vec3::Zero(), ReadStatus::kLost), {1.5, 0, 0}},
        Broken{"late", Fault::kLate, 0.0512, at(Vec3::Zero()), {1.5, 0, 0}},
        Broken{"garbled", Fault::kGarbled, kMs, at(Vec3::Zero(), ReadStatus::kGarbled), {1.5, 0, 0}},
        Broken{"silent", Fault::kSilence, 0.0201, at(Vec3::Zero(), ReadStatus::kNothingNew), {1.5, 0, 0}},
        Broken{"clock_back", Fault::kClock, -kMs, at(Vec3::Zero()), {1.5, 0, 0}},
        Broken{"clock_nan", Fault::kClock, kNan, at(Vec3::Zero()), {1.5, 0, 0}}),
    [](const auto& instance) { return std::string(instance.param.name); });

TEST(Governor, LateByOverFivePeriodsIsZeroNowAndRampsBack) {
  ForceGovernor g = governor();
  const Vec3 wanted(1.0, 0, 0);
  const double t = rest(g, Vec3::Zero(), wanted);
  EXPECT_EQ(g.govern(t + 6 * kMs, at(Vec3::Zero()), wanted).newtons(), wanted) << "exactly five late";
  const double late_s = t + 13 * kMs;
  EXPECT_EQ(g.govern(late_s, at(Vec3::Zero()), wanted).newtons(), Vec3::Zero()) << "six late";
  EXPECT_TRUE(g.armed()) << "no fault";
  EXPECT_EQ(g.counters().late_zeroed, 1u);
  for (int i = 1; i <= 120; ++i) {
    const double x = g.govern(late_s + i * kMs, at(Vec3::Zero()), wanted).newtons().x();
    EXPECT_NEAR(x, std::min(1.0, i / 100.0), 1e-9) << i;
  }
}

TEST(Governor, LatenessDoesNotShortenASoftStart) {
  ForceGovernor g = governor();
  g.arm(0.0);
  (void)g.govern(0.0, at(Vec3::Zero()), {1, 0, 0});
  (void)g.govern(0.010, at(Vec3::Zero()), {1, 0, 0});  // late
  for (int i = 1; i <= 200; ++i)
    EXPECT_LE(g.govern(0.010 + i * kMs, at(Vec3::Zero()), {1, 0, 0}).newtons().x(), i / 500.0 + 1e-9);
}

TEST(Governor, ShortSilenceIsNoFault) {
  ForceGovernor g = governor();
  const Vec3 wanted(1.0, 0, 0);
  const double t = rest(g, Vec3::Zero(), wanted);
  for (int i = 1; i <= 20; ++i) {
    EXPECT_EQ(g.govern(t + i * kMs, at(Vec3::Zero(), ReadStatus::kNothingNew), wanted).newtons(), wanted)
        << i;
  }
  // After 21 periods the hand may be 21 times as far.
  EXPECT_EQ(g.govern(t + 21 * kMs, at({-100, 0, 0}), wanted).newtons(), wanted);
  EXPECT_EQ(g.govern(t + 22 * kMs, at(Vec3::Zero(), ReadStatus::kNothingNew), wanted).newtons(), wanted);
}

TEST(Governor, MovedFromForceIsZero) {
  ForceGovernor g = governor();
  const double t = rest(g, Vec3::Zero(), {1, 0, 0});
  GovernedForce first = g.govern(t + kMs, at(Vec3::Zero()), {1, 0, 0});
  const GovernedForce second(std::move(first));
  EXPECT_EQ(second.newtons(), Vec3(1, 0, 0));
  EXPECT_EQ(first.newtons(), Vec3::Zero());  // NOLINT: the promise under test
}

// Whatever comes in, what goes out is finite, within the limit, within the slew (plus what the ramp of the
// gain adds), and zero while a fault is latched.
TEST(GovernorProperty, HoldsForAnyInput) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    Random random(seed);
    GovernorOptions options{.user_limit_n = random.uniform(0.1, 5.0),
                            .slew_n_per_s = random.uniform(100.0, 1000.0)};
    ForceGovernor g = governor(options);
    const double step_n = options.slew_n_per_s * options.period_s;
    double t_s = random.uniform(0.0, 100.0);
    g.arm(t_s);
    Vec3 position_mm = Vec3::Zero(), last_n = Vec3::Zero();
    const auto any = [&] {
      switch (random.below(40)) {
        case 0:
          return kNan;
        case 1:
          return kInf;
        case 2:
          return 1e308;
        case 3:
          return -1e-320;
        default:
          return random.normal() * 3.0;
      }
    };
    for (int i = 0; i < 2000; ++i) {
      const double elapsed_s = random.below(200) == 0 ? random.uniform(0.0, 0.08) : options.period_s;
      t_s += elapsed_s;
      position_mm += Vec3(random.normal(), random.normal(), random.normal());
      DeviceState state = at(position_mm);
      if (random.below(300) == 0) state.position_mm.x() = any();
      if (random.below(50) == 0) state.status = ReadStatus::kNothingNew;
      const Vec3 wanted = random.below(4) == 0 ? Vec3(any(), any(), any()) : Vec3(last_n * 1.01);
      const Vec3 out = g.govern(t_s, state, wanted).newtons();
      ASSERT_TRUE(is_finite(out));
      ASSERT_LE(out.norm(), g.limit_n() * (1.0 + 1e-9));
      if (g.fault() != Fault::kNone) {
        ASSERT_EQ(out, Vec3::Zero());
        if (random.below(3) == 0) {
          g.arm(t_s);
          position_mm.setZero();
        }
      } else if (out != Vec3::Zero()) {
        ASSERT_LE((out - last_n).norm(), step_n + g.limit_n() * elapsed_s / options.late_ramp_s + 1e-12);
      }
      last_n = out;
    }
  }
}

}  // namespace
}  // namespace palpate::device
