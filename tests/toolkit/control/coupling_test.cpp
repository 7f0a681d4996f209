// The virtual coupling: two springs in a row, a damper that never pulls, and Colgate's condition.
#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <cmath>
#include <limits>
#include <numbers>

#include <palpate/control.h>
#include <palpate/generate.h>
#include <palpate/registry.h>
#include "tests/stepped.h"
#include "tests/toolkit/messages.h"
#include "toolkit/control/coupling_and_passivity.h"
#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"

namespace palpate::control {
namespace {

constexpr double kDt = 1e-3;
const Vec3 kUp = Vec3::UnitZ();

Vec3 resting(const Coupling& coupling, double depth_mm, double model_n) {
  VirtualCoupling c(coupling);
  Vec3 force_n;
  for (int i = 0; i < 2; ++i) force_n = c.couple(-depth_mm * kUp, Vec3::Zero(), model_n * kUp, true, kDt);
  return force_n;
}

TEST(VirtualCoupling, TwoSpringsInARow) {
  // 1 mm of a 0.5 N/mm model behind 0.5 N/mm: 0.25 N/mm. Behind 1.5: 3/8.
  EXPECT_NEAR(resting({0.5, 0.0}, 1.0, 0.5).z(), 0.25, 1e-15);
  EXPECT_NEAR(resting({1.5, 0.0}, 1.0, 0.5).z(), 0.375, 1e-15);
  EXPECT_NEAR(resting({1.5, 0.01}, 1.0, 0.5).z(), 0.375, 1e-15) << "a damper at rest does nothing";
}

TEST(VirtualCoupling, NothingIsStifferThanTheCoupling) {
  for (const double scale : {1e-3, 1.0, 1e6}) {
    EXPECT_NEAR(resting({0.7, 0.0}, 2.0 * scale, 1e12 * scale).z() / scale, 1.4, 1e-9) << "rigid";
    EXPECT_NEAR(resting({0.7, 0.0}, 2.0 * scale, 2e-9 * scale).z() / scale, 2e-9, 1e-16) << "soft";
  }
}

TEST(VirtualCoupling, TheRenderersDirectionStays) {
  VirtualCoupling c({0.5, 0.0});
  const Vec3 shaded(0.1, -0.05, 0.4);
  const Vec3 f = c.couple(Vec3(0, 0, -1), Vec3::Zero(), shaded, true, kDt);
  EXPECT_LT(f.cross(shaded).norm(), 1e-16);
  EXPECT_GT(f.dot(shaded), 0.0);
}

TEST(VirtualCoupling, TheDamperResistsGoingInAndNeverPullsBack) {
  VirtualCoupling c({1.0, 0.002});
  const auto at = [&](double z) {
    return c.couple(Vec3(0, 0, z), Vec3::Zero(), Vec3(0, 0, -1e9 * z), true, kDt).z();
  };
  EXPECT_NEAR(at(-0.1), 0.1 + 0.002 * 100.0, 1e-8);  // 0.1 mm in 1 ms
  EXPECT_NEAR(at(-0.2), 0.2 + 0.2, 1e-8);
  EXPECT_NEAR(at(-0.19), 0.19 - 0.02, 1e-8);  // out at 10 mm/s
  EXPECT_EQ(at(-0.05), 0.0) << "out at 140 mm/s the damper would pull with 0.28 N";
}

TEST(VirtualCoupling, AtDepthZeroThereIsNothingToPullAlong) {
  // A god object that a carved surface leaves at the HIP: contact, and no depth.
  VirtualCoupling c({1.0, 0.002});
  (void)c.couple(Vec3(0, 0, -0.01), Vec3::Zero(), Vec3(0, 0, 1e9), true, kDt);
  EXPECT_EQ(c.couple(Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), true, kDt), Vec3::Zero());
}

TEST(VirtualCoupling, NeverPullsToTheSurfaceWhateverTheSurfaceDoes) {
  // A plane around z = 0 under a hand that moves at random: the force may never point down.
  const auto model =
      cloud::generate(parse_named_options("plane:extent_mm=20:spacing_mm=0.5").value()).value();
  render::SceneInput scene;
  scene.models.emplace_back();
  scene.models[0].cloud = std::make_shared<cloud::Cloud>(model.cloud);
  const Vec3 middle = model.cloud.box_mm().centre_mm();
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  ControlOptions control;
  control.coupling = Coupling{0.5, 0.002};
  for (const double friction : {0.0, 0.9})
    for (const double carved_mm : {0.0, 0.2}) {
      SCOPED_TRACE(testing::Message() << "friction " << friction << ", carved " << carved_mm << " mm");
      scene.models[0].surface.friction = {friction, 0.7 * friction};
      scene.models[0].surface.texture = {};
      if (carved_mm > 0.0) {
        scene.models[0].surface.texture.kind = surface::TextureKind::kGrating;
        scene.models[0].surface.texture.depth_mm = carved_mm;
        scene.models[0].surface.texture.wavelength_mm = 2.0;
      }
      const test::Stepped renderer = wrap(registry.make("cloud", {}).value(), control);
      ASSERT_TRUE(renderer->prepare(scene, {}));
      Random random(41);
      Vec3 at(0, 0, 1), speed = Vec3::Zero();
      renderer->restart(middle + at);
      int contacts = 0, pulled = 0;
      double most = 0.0;
      for (int i = 0; i < 20'000; ++i) {
        speed = 0.97 * speed - Vec3(1, 1, 3).cwiseProduct(at + Vec3(0, 0, 0.3)) +
                8.0 * Vec3(random.normal(), random.normal(), random.normal());
        at += kDt * speed;
        const render::Frame frame = renderer->step(middle + at, kDt);
        contacts += frame.contact;
        pulled += frame.force_n.z() < 0.0;
        most = std::max(most, frame.force_n.z());
      }
      EXPECT_GT(contacts, 5000);
      EXPECT_LT(contacts, 19'900);
      EXPECT_GT(most, 0.1);
      EXPECT_EQ(pulled, 0) << "seed 41";
    }
}

TEST(VirtualCoupling, ExactlyZeroWhenFreeAndNoMemoryOfTheLastContact) {
  VirtualCoupling c({1.0, 0.002});
  (void)c.couple(Vec3(0, 0, -1), Vec3::Zero(), Vec3(0, 0, 1), true, kDt);
  EXPECT_EQ(c.couple(Vec3(0, 0, 1), Vec3(0, 0, 1), Vec3::Zero(), false, kDt), Vec3::Zero());
  const Vec3 again = c.couple(Vec3(0, 0, -0.01), Vec3::Zero(), Vec3(0, 0, 1e9), true, kDt);
  EXPECT_NEAR(again.z(), 0.01 + 0.002 * 10.0, 1e-8);
}

/// Numbers of every kind, half of them odd.
double pick(Random& random) {
  constexpr double kOdd[] = {0.0,
                             1e-300,
                             1e300,
                             5e-324,
                             1.7e308,
                             std::numeric_limits<double>::infinity(),
                             std::numeric_limits<double>::quiet_NaN()};
  return random.below(2) == 0 ? kOdd[random.below(7)] : random.uniform(-1, 1);
}
Vec3 pick_vec(Random& random) {
  return {pick(random), pick(random), pick(random)};
}

TEST(Control, NeverNan) {
  Random random(21);
  VirtualCoupling c({1.0, 0.002});
  ForceFilter ours({100.0, 90.0}), literal({100.0, 90.0, FilterForm::kLiteral});
  PassivityController controllers[] = {PassivityController({EnergyRule::kTrapezoid, 0.005}),
                                       PassivityController({EnergyRule::kPrinted, 0.005}),
                                       PassivityController({EnergyRule::kHold, 0.005})};
  for (int i = 0; i < 20000; ++i) {
    SCOPED_TRACE(i);
    const Vec3 hip = pick_vec(random), god = pick_vec(random), force = pick_vec(random);
    const double dt_s = pick(random);
    ASSERT_TRUE(is_finite(c.couple(hip, god, force, random.below(4) != 0, dt_s)));
    ASSERT_TRUE(is_finite(ours.filter(force, dt_s)));
    ASSERT_TRUE(is_finite(literal.filter(force, dt_s)));
    for (PassivityController& controller : controllers) {
      ASSERT_TRUE(is_finite(controller.control(hip, force, dt_s, 3.3)));
      ASSERT_TRUE(std::isfinite(controller.observer().energy_mj()));
    }
  }
}

TEST(CouplingStability, ColgatesCondition) {
  // Literature: K = 0.5 N/mm needs b > 0.25 N s/m at 1 kHz, 0.05 at 5 kHz. 1 N s/m = 0.001 N s/mm.
  const CouplingStability at_1 = coupling_stability({0.5, 0.0}, 0.3e-3, 1e-3);
  EXPECT_TRUE(at_1.passive);
  EXPECT_NEAR(at_1.min_device_damping_n_s_per_mm, 0.25e-3, 1e-12);
  EXPECT_NEAR(at_1.max_stiffness_n_per_mm, 0.6, 1e-12);
  EXPECT_NEAR(coupling_stability({0.5, 0.0}, 0.3e-3, 0.2e-3).min_device_damping_n_s_per_mm, 0.05e-3, 1e-12);
  EXPECT_FALSE(coupling_stability({0.5, 0.1e-3}, 0.3e-3, 1e-3).passive)
      << "its own damping counts against it";
  EXPECT_FALSE(coupling_stability({0.6, 0.0}, 0.3e-3, 1e-3).passive) << "the condition is strict";
  EXPECT_EQ(coupling_stability({0.5, 1e-3}, 0.3e-3, 1e-3).max_stiffness_n_per_mm, 0.0);
}

/// One axis of a device (45 g, damping b) held at a point by a coupling, the force held for a period: by what
/// factor its swing grows from the first second to the third.
double growth(double stiffness_n_per_mm, double device_damping_n_s_per_mm) {
  constexpr int kParts = 100, kSecond = 1000;
  constexpr double kMassNs2PerMm = 0.045e-3;
  VirtualCoupling coupling({stiffness_n_per_mm, 0.0});
  double z = 0.1, v = 0.0, first = 0.0, third = 0.0;
  for (int frame = 0; frame < 3 * kSecond; ++frame) {
    const Vec3 hip(0, 0, z), rigid = -1e12 * hip;
    const double f = coupling.couple(hip, Vec3::Zero(), rigid, true, kDt).z();
    for (int part = 0; part < kParts; ++part) {
      v += (f - device_damping_n_s_per_mm * v) / kMassNs2PerMm * kDt / kParts;
      z += v * kDt / kParts;
    }
    if (frame < kSecond) first = std::max(first, std::abs(z));
    if (frame >= 2 * kSecond) third = std::max(third, std::abs(z));
  }
  return third / first;
}

TEST(CouplingStability, TheConditionIsWhereASwingBeginsToGrow) {
  const double b = 0.3e-3;
  const double most = coupling_stability({1.0, 0.0}, b, kDt).max_stiffness_n_per_mm;
  // The damping that is left is b - k T / 2: 5 % from the border a swing changes by exp(-+ 0.17 / s x 2 s).
  EXPECT_LT(growth(0.95 * most, b), 0.8);
  EXPECT_GT(growth(1.05 * most, b), 1.2);
}

TEST(Coupling, WrongNumbersAreNamed) {
  EXPECT_TRUE(check(Coupling{1.0, 0.0}));
  for (const Coupling wrong : {Coupling{0.0, 0.0}, Coupling{-1.0, 0.0}, Coupling{std::nan(""), 0.0}})
    EXPECT_TRUE(test::refused(check(wrong), "stiffness_n_per_mm"));
  EXPECT_TRUE(test::refused(check(Coupling{1.0, -1e-9}), "damping_n_s_per_mm"));
}

// The force filter: both limits hold exactly, release is exact, delays are as computed by hand.

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
    EXPECT_EQ(filter.filter(f, kDt), f);
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
          const Vec3 f = filter.filter(wanted, kDt);
          const bool released = wanted == Vec3::Zero() && form == FilterForm::kPerTime;
          const bool rated = rate > 0.0 && !released,
                     turned = turn > 0.0 && f.norm() > 1e-9 && last.norm() > 1e-9;
          ASSERT_TRUE(!rated || (f - last).norm() <= rate * kDt * (1 + 1e-12)) << "seed 32, frame " << i;
          ASSERT_TRUE(!turned || angle_deg(last, f) <= turn * kDt + 1e-6) << "seed 32, frame " << i;
          last = f;
        }
      }
}

TEST(ForceFilter, RateByHand) {
  ForceFilter filter({100.0, 0.0});  // 0.1 N a millisecond
  EXPECT_NEAR(filter.filter(Vec3(1, 0, 0), kDt).x(), 0.1, 1e-15);
  EXPECT_NEAR(filter.filter(Vec3(1, 0, 0), 3 * kDt).x(), 0.4, 1e-15) << "a longer frame may change more";
  EXPECT_NEAR(filter.filter(Vec3(0.45, 0, 0), kDt).x(), 0.45, 1e-15);
  EXPECT_NEAR(filter.filter(Vec3(0, 1, 0), kDt).norm(),
              std::hypot(0.45 - 0.1 * 0.45 / std::hypot(0.45, 1.0), 0.1 / std::hypot(0.45, 1.0)), 1e-15);
}

TEST(ForceFilter, TurnByHand) {
  const Vec3 x(2, 0, 0), y(0, 2, 0);
  ForceFilter literal({0.0, 30000.0, FilterForm::kLiteral}),
      ours({0.0, 30000.0});  // 30 degrees a millisecond
  (void)literal.filter(x, kDt);
  (void)ours.filter(x, kDt);
  EXPECT_LT((literal.filter(y, kDt) - 2.0 * Vec3(std::cos(30 * kDeg), 0.5, 0)).norm(), 1e-15);
  // Ours: the part of the wanted force along 30 degrees, 60 degrees short of it: half its size.
  EXPECT_LT((ours.filter(y, kDt) - 1.0 * Vec3(std::cos(30 * kDeg), 0.5, 0)).norm(), 1e-15);
  for (int i = 0; i < 3; ++i) (void)ours.filter(y, kDt);
  EXPECT_EQ(ours.filter(y, kDt), y) << "once there nothing is changed, to the last bit";
}

TEST(ForceFilter, AReversedForceGoesThroughZeroInOursAndAroundInTheLiteralForm) {
  ForceFilter literal({0.0, 30000.0, FilterForm::kLiteral}), ours({0.0, 30000.0});
  (void)literal.filter(Vec3(1, 0, 0), kDt);
  (void)ours.filter(Vec3(1, 0, 0), kDt);
  const Vec3 around = literal.filter(Vec3(-1, 0, 0), kDt);
  EXPECT_NEAR(angle_deg(around, Vec3(1, 0, 0)), 30.0, 1e-9);
  EXPECT_NEAR(around.norm(), 1.0, 1e-15) << "pushes aside with all of a force nobody asked for there";
  EXPECT_EQ(ours.filter(Vec3(-1, 0, 0), kDt), Vec3::Zero());
  EXPECT_EQ(ours.filter(Vec3(-1, 0, 0), kDt), Vec3(-1, 0, 0));
}

TEST(ForceFilter, ReleaseIsExactInOursAndFadesInTheLiteralForm) {
  ForceFilter literal({100.0, 0.0, FilterForm::kLiteral}), ours({100.0, 0.0});
  for (int i = 0; i < 3; ++i) {
    (void)literal.filter(Vec3(0.25, 0, 0), kDt);
    (void)ours.filter(Vec3(0.25, 0, 0), kDt);
  }
  EXPECT_EQ(ours.filter(Vec3::Zero(), kDt), Vec3::Zero());
  EXPECT_NEAR(literal.filter(Vec3::Zero(), kDt).x(), 0.15, 1e-15);
  EXPECT_NEAR(literal.filter(Vec3::Zero(), kDt).x(), 0.05, 1e-15);
  EXPECT_EQ(literal.filter(Vec3::Zero(), kDt), Vec3::Zero()) << "and ends at exactly nothing";
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

TEST(FilterDelay, OfARateLimitByHand) {
  const auto delay = test::value_of(filter_delay({100.0, 0.0}, {}));
  // 1 N in steps of 0.1: the 7th frame has 0.7, the 10th 1.0; the first frame is at time 0.
  EXPECT_NEAR(delay.size.to_63_percent_s, 6e-3, 1e-12);
  EXPECT_NEAR(delay.size.to_95_percent_s, 9e-3, 1e-12);
  ASSERT_TRUE(delay.size.ramp_lag_s);
  EXPECT_NEAR(*delay.size.ramp_lag_s, 0.0, 1e-12) << "10 N/s passes";
  // 10 degrees of 1 N are a change of 0.174 N, two frames.
  EXPECT_NEAR(delay.direction.to_95_percent_s, 1e-3, 1e-12);
  FilterProbe steep;
  steep.ramp_n_per_s = 101.0;
  EXPECT_FALSE(filter_delay({100.0, 0.0}, steep)->size.ramp_lag_s) << "it falls behind for ever";
}

TEST(FilterDelay, OfATurnLimitByHand) {
  for (const FilterForm form : {FilterForm::kPerTime, FilterForm::kLiteral}) {
    const auto delay = test::value_of(filter_delay({0.0, 1000.0, form}, {}));
    EXPECT_EQ(delay.size.to_95_percent_s, 0.0) << "from nothing a force may have any direction";
    EXPECT_NEAR(delay.direction.to_63_percent_s, 6e-3, 1e-12);  // 10 degrees, one a frame
    EXPECT_NEAR(delay.direction.to_95_percent_s, 9e-3, 1e-12);
    ASSERT_TRUE(delay.direction.ramp_lag_s);
    EXPECT_NEAR(*delay.direction.ramp_lag_s, 0.0, 1e-9);
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
    const auto delay = test::value_of(filter_delay({rate, 0.0}, probe));
    const double frames = std::ceil(0.95 * probe.step_n / (rate * probe.dt_s)) - 1.0;
    EXPECT_NEAR(delay.size.to_95_percent_s, frames * probe.dt_s, 1e-9) << "seed 34, " << rate;
  }
}

TEST(FilterDelay, OffHasNone) {
  const auto delay = test::value_of(filter_delay({}, {}));
  for (const StepDelay& d : {delay.size, delay.direction}) {
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
