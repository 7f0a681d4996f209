// Simulated loops against what is known of them: exact limits of linear loops, and what the worst hand can
// take out of a passive one.
#include "device/simulated/closed_loop.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>

#include "device/simulated/simulated_arm.h"
#include "tests/device/rig.h"

namespace palpate::device {
namespace {

constexpr double kWithin = 0.10;  // of theory

/// A linear loop from a place 0.1 mm off: does it grow? Measured between the first and the last tenth.
bool grows(const ArmOptions& arm, const Hand& hand, double stiffness, double wall_damping = 0.0) {
  VirtualClock clock;
  const HandScript script = resting_at(Vec3(0, 0, 0.1));
  SimulatedArm device(arm, hand, script, clock);
  SpringPlane spring(stiffness, true);
  spring.difference_n_per_mm = wall_damping / arm.period_s;
  // The hand's own spring rests at the starting place: the loop swings about a place between.
  const LoopRun run = run_loop(spring, device, clock, bare_loop(arm.period_s, 8.0)).value();
  if (run.fault != Fault::kNone) return true;
  const auto size = [&](std::size_t from, std::size_t to) {
    double low = 1e300, high = -1e300;
    for (std::size_t i = from; i < to; ++i) {
      low = std::min(low, run.hip.hip_mm[i].z());
      high = std::max(high, run.hip.hip_mm[i].z());
    }
    return high - low;
  };
  const std::size_t n = run.hip.size();
  // From the middle on, when what dies fast has died.
  return size(n - n / 10, n) > size(n / 2, n / 2 + n / 10);
}

/// The loop is stable up to this stiffness, and not beyond it.
void expect_limit(const ArmOptions& arm, const Hand& hand, double limit, double within,
                  double damping = 0.0) {
  EXPECT_FALSE(grows(arm, hand, (1.0 - within) * limit, damping)) << limit;
  EXPECT_TRUE(grows(arm, hand, (1.0 + within) * limit, damping)) << limit;
}

ArmOptions linear_arm(double mass_kg, double damping, double period_s) {
  return {.mass_kg = mass_kg, .damping_n_s_per_mm = damping, .force_max_n = 1e6, .period_s = period_s};
}

/// The limit of a mass and a damper under a sampled spring, by hand: the period's map has trace 1 + e + a K
/// and determinant e + b K of exponentials; the circle is left where a pole reaches it.
double closed_form_limit(double mass_kg, double damping, double period_s) {
  const double m = mass_kg * 1e-3, r = damping / m, e = std::exp(-r * period_s);
  const double push_v = (1 - e) / damping, push_x = period_s / damping - m / (damping * damping) * (1 - e);
  const double gain_x = (1 - e) / r;  // of the velocity, on the position
  const auto radius = [&](double k) {
    // [x; v] -> [1 - k push_x, gain_x; -k push_v, e]
    const std::complex<double> trace = 1 - k * push_x + e, det = (1 - k * push_x) * e + k * push_v * gain_x;
    const std::complex<double> root = std::sqrt(trace * trace - 4.0 * det);
    return std::max(std::abs(0.5 * (trace + root)), std::abs(0.5 * (trace - root)));
  };
  double low = 1e-3, high = 1e3;
  while (high > low * (1 + 1e-9)) (radius(std::sqrt(low * high)) > 1 ? high : low) = std::sqrt(low * high);
  return low;
}

TEST(LoopTheory, EigenvaluesAgreeWithTheClosedForm) {
  for (const double m : {0.045, 0.2, 2.0})
    for (const double b : {0.0001, 0.0003, 0.002})
      for (const double t : {0.000125, 0.001, 0.002}) {
        const double exact = closed_form_limit(m, b, t);
        EXPECT_NEAR(linear_stiffness_n_per_mm({{m, b, 0, 0}, t, 0, 0}), exact, 1e-5 * exact) << m << " " << b;
      }
  // A device of 45 g and 0.3 N s/m at 1 kHz: 2 b/T, and a third of it with a sample of delay.
  EXPECT_NEAR(linear_stiffness_n_per_mm({{0.045, 0.0003, 0, 0}, 0.001, 0, 0}), 0.6, 0.006);
  EXPECT_NEAR(linear_stiffness_n_per_mm({{0.045, 0.0003, 0, 0}, 0.001, 0.001, 0}), 0.2, 0.002);
}

TEST(LoopTheory, TheSimulationLosesItsStabilityWhereTheEigenvaluesSay) {
  struct Case {
    double mass, damping, period, delay, lag, wall;
    Hand hand;
  };
  Hand grip{.mass_kg = 0.15, .damping_n_s_per_mm = 0.0045, .stiffness_n_per_mm = 0.4};
  for (const Case& c : {Case{0.045, 0.0003, 0.001, 0.0, 0.0, 0.0, {}},
                        {0.045, 0.0003, 0.001, 0.001, 0.0, 0.0, {}},
                        {0.045, 0.0003, 0.001, 0.0024, 0.0, 0.0, {}},
                        {0.045, 0.0003, 0.00025, 0.0, 0.00016, 0.0, {}},
                        {0.045, 0.0003, 0.001, 0.0, 0.0, 0.0002, {}},
                        {0.3, 0.0015, 0.0005, 0.0004, 0.00016, 0.001, {}},
                        {0.045, 0.0003, 0.001, 0.0, 0.00016, 0.0, grip},
                        {0.045, 0.0003, 0.001, 0.004, 0.0, 0.0, grip}}) {
    ArmOptions arm = linear_arm(c.mass, c.damping, c.period);
    arm.delay_s = c.delay;
    arm.lag_s = c.lag;
    const Plant plant{c.mass + c.hand.mass_kg, c.damping + c.hand.damping_n_s_per_mm,
                      c.hand.stiffness_n_per_mm, c.lag};
    const double theory = linear_stiffness_n_per_mm({plant, c.period, c.delay, c.wall});
    SCOPED_TRACE(testing::Message() << c.mass << " " << c.delay << " " << c.lag << " " << c.wall);
    expect_limit(arm, c.hand, theory, 0.02, c.wall);
  }
}

TEST(LoopTheory, AHeavyFreeMassIsTheWorstHandOfASpringAndReachesColgatesBound) {
  // Of all undamped masses and springs in the hand.
  const double b = 0.0003, t = 0.001;
  double worst = 1e300;
  Plant worst_plant;
  for (double mass = 0.045; mass < 1.0; mass *= 1.5)
    for (double swing = 0.0; swing < 1.0; swing += 0.05) {  // of pi / T
      const double omega = swing * std::acos(-1.0) / t;
      const Plant plant{mass, b, mass * 1e-3 * omega * omega, 0.0};
      const double limit = linear_stiffness_n_per_mm({plant, t, 0.0, 0.0});
      if (limit < worst) {
        worst = limit;
        worst_plant = plant;
      }
    }
  const double theory = passive_stiffness_n_per_mm(b, 0.0, 0.0, 0.0, t);
  EXPECT_NEAR(worst, theory, kWithin * theory);
  EXPECT_EQ(worst_plant.stiffness_n_per_mm, 0.0);
  Hand hand{.mass_kg = worst_plant.mass_kg - 0.045};
  expect_limit(linear_arm(0.045, b, t), hand, theory, kWithin);
}

TEST(LoopTheory, DelayLowersTheLimitOfSlowSwingsAsItsFormulaSays) {
  for (const double delay : {0.0, 0.001, 0.0025, 0.004})
    for (const double wall : {0.0, 0.0002}) {
      // K < (b + B) / (T / 2 + delay), the limit of slow swings (Gil and others 2009; Hulin 2010).
      const double theory = (0.0003 + wall) / (0.5 * 0.001 + delay);
      // A mass with which swings are slow against delay and samples, the formula's assumption.
      EXPECT_NEAR(linear_stiffness_n_per_mm({{0.2, 0.0003, 0, 0}, 0.001, delay, wall}), theory,
                  kWithin * theory)
          << delay << " " << wall;
    }
}

/// What a hand takes out that swings as fast as the samples, mJ in so many cycles: it goes `way_mm` deeper in
/// one period and comes back in the next.
double shaken_mj(const ArmOptions& arm, SpringPlane& spring, double top_mm, double way_mm, int cycles) {
  std::vector<double> t_s;
  std::vector<Vec3> goal_mm;
  for (int i = 0; i <= 2 * cycles; ++i) {
    t_s.push_back(i * arm.period_s);
    goal_mm.emplace_back(0, 0, i % 2 == 0 ? top_mm : top_mm - way_mm);
  }
  const HandScript script =
      HandScript::create("shake", std::move(t_s), std::move(goal_mm), HandScript::Between::kStraight).value();
  VirtualClock clock;
  Hand guide{.guides = true};
  SimulatedArm device(arm, guide, script, clock);
  const LoopRun run =
      run_loop(spring, device, clock, bare_loop(arm.period_s, (2 * cycles + 0.5) * arm.period_s)).value();
  EXPECT_EQ(run.fault, Fault::kNone);
  EnergyLedger energy = run.energy;
  energy.kinetic = 0.0;  // of the last leg's speed: the hand takes it back
  return -energy.hand();
}

/// In a cycle, once the loop is under way.
double taken_mj(const ArmOptions& arm, double stiffness, double wall_damping, double top_mm, double way_mm) {
  SpringPlane spring(stiffness);
  spring.difference_n_per_mm = wall_damping / arm.period_s;
  constexpr int kBegun = 2, kCycles = 8;
  return (shaken_mj(arm, spring, top_mm, way_mm, kBegun + kCycles) -
          shaken_mj(arm, spring, top_mm, way_mm, kBegun)) /
         kCycles;
}

/// Whether any of these hands takes energy out: they swing about every place within a step of the encoder,
/// by every way from a hundredth of a step to eighty: where the samples bind, friction counts
/// the less the longer the way.
bool active(const ArmOptions& arm, double stiffness, double wall_damping) {
  const double step = arm.encoder_mm > 0.0 ? arm.encoder_mm : 0.05;
  const double most = std::min(80.0 * step, 4500.0 * arm.period_s);  // the governor stops what is faster
  for (double way = 0.01 * step; way < most; way *= 1.6)
    for (int place = 0; place < 8; ++place) {
      // About a border between two steps, and off it by eighths of the way.
      const double top = -20.5 * step + way * (place + 0.5) / 8.0;
      if (taken_mj(arm, stiffness, wall_damping, top, way) > 0.0) return true;
    }
  return false;
}

TEST(LoopTheory, TheWorstHandTakesEnergyOutFromTheBoundOnAndNotBelow) {
  struct Case {
    double damping, wall, friction, encoder, period;
  };
  for (const Case& c : {Case{0.0003, 0.0, 0.0, 0.0, 0.001},  // Colgate
                        {0.0003, 0.0, 0.0, 0.0, 0.00025},
                        {0.0003, 0.0001, 0.0, 0.0, 0.001},
                        {0.002, 0.0012, 0.0, 0.0, 0.0005},
                        {0.01, 0.0, 0.1, 0.055, 0.001},       // the encoder binds: 2f/step = 3.6
                        {0.0003, 0.0, 0.1, 0.055, 0.001},     // the samples bind: 2b/T = 0.6
                        {0.002, 0.0, 0.11, 0.055, 0.001}}) {  // 4 and 4
    ArmOptions arm = linear_arm(0.045, c.damping, c.period);
    arm.friction_n = c.friction;
    arm.encoder_mm = c.encoder;
    const double theory = passive_stiffness_n_per_mm(c.damping, c.wall, c.friction, c.encoder, c.period);
    EXPECT_FALSE(active(arm, (1.0 - kWithin) * theory, c.wall)) << theory;
    EXPECT_TRUE(active(arm, (1.0 + kWithin) * theory, c.wall)) << theory;
  }
}

// ---- Hands, devices and walls in a loop.

const TaskPlace kPlace{Vec3::Zero(), Vec3::UnitZ(), Vec3::UnitX()};

struct LoopCase {
  ArmOptions arm = arm_models()[0];
  Hand hand = hand_models()[1];
  double stiffness = 0.5;
  HandScript script = press(kPlace, {});
  LoopOptions loop;
};

/// As long as the script, where nothing else is said.
LoopRun run_on(render::HapticRenderer& wall, const LoopCase& c, double duration_s = 0.0) {
  VirtualClock clock;
  SimulatedArm device(c.arm, c.hand, c.script, clock);
  LoopOptions loop = c.loop;
  loop.period_s = c.arm.period_s;
  loop.duration_s = duration_s > 0.0 ? duration_s : c.script.duration_s();
  return run_loop(wall, device, clock, loop).value();
}

LoopRun run(const LoopCase& c) {
  SpringPlane wall(c.stiffness);
  return run_on(wall, c);
}

TEST(ClosedLoop, APressedWallAndAHandShareTheDepthAsTwoSprings) {
  LoopCase c;
  c.arm.friction_n = 0.0;
  c.arm.encoder_mm = 0.0;
  const LoopRun done = run(c);
  EXPECT_EQ(done.fault, Fault::kNone);
  // 2 mm of goal, 0.4 N/mm of hand, 0.5 N/mm of wall.
  EXPECT_NEAR(done.hip.hip_mm.back().z(), -2.0 * 0.4 / 0.9, 1e-4);
  EXPECT_NEAR(done.motor_force_n.back().z(), 0.5 * 2.0 * 0.4 / 0.9, 1e-4);
  EXPECT_FALSE(swing_of(done.hip, Vec3::UnitZ(), 1e-6).sustained);
}

TEST(ClosedLoop, TheSameToTheLastBitAndOtherwiseWithAnotherSeed) {
  LoopCase c;
  c.loop.jitter_s = 0.0004;
  const LoopRun a = run(c), b = run(c);
  ASSERT_EQ(a.hip.size(), b.hip.size());
  EXPECT_EQ(trace::path_hash(a.hip), trace::path_hash(b.hip));
  EXPECT_EQ(trace::trace_hash(a.felt), trace::trace_hash(b.felt));
  c.loop.seed = 2;
  EXPECT_NE(trace::path_hash(run(c).hip), trace::path_hash(a.hip));
}

TEST(ClosedLoop, FarFromTheOriginItSwingsAsNearIt) {
  LoopCase c;
  const LoopRun here = run(c);
  c.loop.world_from_device.translation_mm = Vec3(1e6, -1e6, 0);  // the plane is still at z = 0
  const LoopRun there = run(c);
  ASSERT_EQ(here.hip.size(), there.hip.size());
  for (std::size_t i = 0; i < here.hip.size(); i += 50)
    ASSERT_NEAR(here.hip.hip_mm[i].z(), there.hip.hip_mm[i].z(), 1e-9);
}

TEST(ClosedLoop, TooStiffAWallIsSeenToBuzzAndASoftOneToRest) {
  LoopCase c;
  c.hand = hand_models()[0];
  c.hand.push_n = Vec3(0, 0, -0.5);  // nobody but a steady push: the lightest hand
  c.script = resting_at(Vec3(0, 0, 1));
  c.arm.friction_n = 0.02;
  for (const double stiffness : {0.2, 12.0}) {
    SpringPlane wall(stiffness);
    const LoopRun done = run_on(wall, c, 5.0);
    const Swing swing = swing_of(done.hip, Vec3::UnitZ(), c.arm.encoder_mm);
    const bool buzzes = done.fault != Fault::kNone || swing.sustained;
    EXPECT_EQ(buzzes, stiffness > 1.0) << stiffness << ": " << swing.amplitude_mm << " mm";
    if (buzzes && done.fault == Fault::kNone) {
      EXPECT_GT(swing.frequency_hz, 5.0);
      EXPECT_LT(done.least_environment_mj, -1e-3) << "the samples give energy";
    }
  }
}

TEST(ClosedLoop, LetGoTheDeviceLeavesTheWallAndFrictionHoldsIt) {
  LoopCase c;
  c.script = release_contact(kPlace, {});
  const LoopRun done = run(c);
  EXPECT_GT(done.hip.hip_mm.back().z(), 0.0);
  EXPECT_EQ(done.felt.frames.back().force_n, Vec3::Zero());
  EXPECT_LT(done.hip.hip_mm[900].z(), -0.5) << "pressed in before";
}

/// Counts its steps, and after `changes_s` is another wall.
class CountedPlane final : public render::SceneFreeRenderer {
 public:
  explicit CountedPlane(double changes_s = 1e9) : changes_s_(changes_s) {}
  render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    ++steps;
    SpringPlane wall(t_s < changes_s_ ? 0.5 : 0.1);
    return wall.step(hip_mm, t_s);
  }
  render::Description describe() const override { return {"counted", "", "", "constant", {}}; }
  std::size_t steps = 0;

 private:
  double changes_s_;
};

void expect_same_run(const LoopRun& a, const LoopRun& b) {
  EXPECT_EQ(trace::path_hash(a.hip), trace::path_hash(b.hip));
  EXPECT_EQ(trace::path_hash(a.measured), trace::path_hash(b.measured));
  EXPECT_EQ(trace::trace_hash(a.felt), trace::trace_hash(b.felt));
  EXPECT_EQ(a.sent_n, b.sent_n);
  EXPECT_EQ(a.motor_force_n, b.motor_force_n);
  EXPECT_EQ(a.least_environment_mj, b.least_environment_mj);
  EXPECT_EQ(a.energy.hand(), b.energy.hand());
  EXPECT_EQ(a.fault, b.fault);
}

TEST(ClosedLoop, APressThatIsStillIsNotSimulatedToItsEndAndEndsTheSame) {
  for (const double delay_s : {0.0, 0.004})
    for (const double jitter_s : {0.0, 0.0004}) {
      LoopCase c;
      c.arm.delay_s = delay_s;
      c.loop.jitter_s = jitter_s;
      CountedPlane to_the_end, until_still;
      const LoopRun whole = run_on(to_the_end, c);
      c.loop.still_s = 0.25;
      const LoopRun ended = run_on(until_still, c);
      expect_same_run(whole, ended);
      EXPECT_LT(2 * until_still.steps, to_the_end.steps) << delay_s << ", " << jitter_s;
    }
}

TEST(ClosedLoop, WhatStillMovesOrIsStillToChangeIsSimulated) {
  LoopCase swinging;  // a wall that changes before it has been still for long enough
  swinging.loop.still_s = 1.5;
  CountedPlane changing(1.5), changing_too(1.5);
  const LoopRun ended = run_on(changing, swinging);
  swinging.loop.still_s = 0.0;
  expect_same_run(run_on(changing_too, swinging), ended);
  EXPECT_LT(ended.hip.hip_mm.back().z(), ended.hip.hip_mm[1400].z() - 0.1) << "deeper into a softer wall";
  LoopCase released;  // the hand lets go later: what rests before that does not rest for good
  released.script = release_contact(kPlace, {});
  released.loop.still_s = 0.1;
  CountedPlane wall, same_wall;
  const LoopRun let = run_on(wall, released);
  released.loop.still_s = 0.0;
  expect_same_run(run_on(same_wall, released), let);
  EXPECT_GT(let.hip.hip_mm.back().z(), 0.0);
  LoopCase frictionless;  // it dies away and never rests
  frictionless.arm.friction_n = 0.0;
  frictionless.loop.still_s = 0.1;
  CountedPlane felt;
  const LoopRun all = run_on(felt, frictionless);
  EXPECT_EQ(felt.steps, all.hip.size());
}

TEST(ClosedLoop, RefusesJitterOfAPeriodAndNoDuration) {
  VirtualClock clock;
  const HandScript script = resting_at(Vec3::UnitZ());
  SimulatedArm device(arm_models()[0], {}, script, clock);
  SpringPlane wall(0.5);
  LoopOptions loop;
  loop.jitter_s = loop.period_s;
  EXPECT_FALSE(run_loop(wall, device, clock, loop));
  loop.jitter_s = 0.0;
  loop.duration_s = 0.0;
  EXPECT_FALSE(run_loop(wall, device, clock, loop));
}

// ---- the admittance device

LoopRun run_admittance(const AdmittanceOptions& options, const Hand& hand, const HandScript& script,
                       double stiffness, double duration_s, bool bilateral = false) {
  VirtualClock clock;
  SimulatedAdmittance device(options, hand, script, clock);
  SpringPlane wall(stiffness, bilateral);
  return run_loop(wall, device, clock, bare_loop(options.period_s, duration_s)).value();
}

TEST(Admittance, MovesAsItsVirtualMassUnderAForce) {
  AdmittanceOptions options{.damping_n_s_per_mm = 0.0, .bandwidth_hz = 0.0};
  Hand hand;
  hand.push_n = Vec3(0, 0, -4.0);  // 4 N on 2 kg: 2 m/s^2
  const LoopRun done = run_admittance(options, hand, resting_at(Vec3(0, 0, 500)), 1.0, 0.5);
  // Semi-implicit sums: n(n+1)/2 T^2 a after n ticks.
  EXPECT_NEAR(done.hip.hip_mm.back().z(), 500.0 - 2000.0 * 0.5 * 500 * 501 * 1e-6, 1e-6);
}

TEST(Admittance, ItsLimitIsThatOfItsSums) {
  AdmittanceOptions options{.bandwidth_hz = 0.0, .force_max_n = 1e9, .speed_max_mm_s = 1e9};
  const double mass = options.mass_kg * kNS2PerMmPerKg, t = options.period_s;
  // z^2 - (2 - B T/M - K T^2/M) z + 1 - B T/M leaves the circle through -1.
  const double limit = (4.0 * mass - 2.0 * options.damping_n_s_per_mm * t) / (t * t);
  const auto largest = [&](double stiffness) {
    const LoopRun done = run_admittance(options, {}, resting_at(Vec3(0, 0, 1e-3)), stiffness, 2.0, true);
    if (done.fault != Fault::kNone) return 1e9;
    double most = 0.0;
    for (std::size_t i = done.hip.size() - 20; i < done.hip.size(); ++i)
      most = std::max(most, std::abs(done.hip.hip_mm[i].z()));
    return most;
  };
  EXPECT_LT(largest(0.99 * limit), 1e-3);
  EXPECT_GT(largest(1.01 * limit), 1.0);
}

TEST(Admittance, RendersAStifferWallThanAnyImpedanceDeviceUnderTheSameHand) {
  const HandScript script = press(kPlace, {4.0, 4.0, 0.0});
  const LoopRun done =
      run_admittance(admittance_model(), hand_models()[1], script, 20.0, script.duration_s());
  EXPECT_EQ(done.fault, Fault::kNone);
  EXPECT_FALSE(swing_of(done.hip, Vec3::UnitZ(), 0.01).sustained);
  EXPECT_NEAR(done.hip.hip_mm.back().z(), -4.0 * 0.4 / 20.4, 0.02);
  EXPECT_NEAR(done.motor_force_n.back().z(), 0.4 * (4.0 - 4.0 * 0.4 / 20.4), 0.02) << "what the hand feels";
}

TEST(Admittance, RefusesWhatIsNotRight) {
  VirtualClock clock;
  const HandScript script = resting_at(Vec3::Zero());
  AdmittanceOptions options{.mass_kg = 0.0};
  SimulatedAdmittance device(options, {}, script, clock);
  EXPECT_FALSE(device.open());
}

}  // namespace
}  // namespace palpate::device
