// Hands, devices and walls in a loop.
#include "device/simulated/closed_loop.h"

#include <gtest/gtest.h>

#include <cmath>

#include "device/simulated/arm_models.h"
#include "tests/device/rig.h"

namespace palpate::device {
namespace {

const TaskPlace kPlace{Vec3::Zero(), Vec3::UnitZ(), Vec3::UnitX()};

struct LoopCase {
  ArmOptions arm = arm_models()[0];
  Hand hand = hand_models()[1];
  double stiffness = 0.5;
  HandScript script = press(kPlace, {});
  LoopOptions loop;
};

LoopRun run(LoopCase c) {
  VirtualClock clock;
  SimulatedArm device(c.arm, c.hand, c.script, clock);
  SpringPlane wall(c.stiffness);
  c.loop.period_s = c.arm.period_s;
  c.loop.duration_s = c.script.duration_s();
  return run_loop(wall, device, clock, c.loop).value();
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

TEST(ClosedLoop, FeltThroughAnEncoderItStaysWithinAStep) {
  const LoopRun done = run({});
  EXPECT_NEAR(done.hip.hip_mm.back().z(), -2.0 * 0.4 / 0.9, 0.1 / 0.9 + 0.055);
  for (std::size_t i = 0; i < done.hip.size(); ++i)
    ASSERT_LE((done.hip.hip_mm[i] - done.measured.hip_mm[i]).cwiseAbs().maxCoeff(), 0.0275 + 1e-12);
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
  c.loop.world_from_device.translation_mm = Vec3(0, 0, 0);
  const LoopRun here = run(c);
  VirtualClock clock;
  SimulatedArm device(c.arm, c.hand, c.script, clock);
  SpringPlane wall(c.stiffness);
  c.loop.duration_s = c.script.duration_s();
  c.loop.world_from_device.translation_mm = Vec3(1e6, -1e6, 0);  // the plane is still at z = 0
  const LoopRun there = run_loop(wall, device, clock, c.loop).value();
  ASSERT_EQ(here.hip.size(), there.hip.size());
  for (std::size_t i = 0; i < here.hip.size(); i += 50)
    ASSERT_NEAR(here.hip.hip_mm[i].z(), there.hip.hip_mm[i].z(), 1e-9);
}

TEST(ClosedLoop, TooStiffAWallIsSeenToBuzzAndASoftOneToRest) {
  LoopCase c;
  c.hand = hand_models()[0];
  c.hand.push_n = Vec3(0, 0, -0.5);  // nobody but a steady push: the lightest hand
  c.script = resting_at(Vec3(0, 0, 1));
  for (const double stiffness : {0.2, 12.0}) {
    LoopCase one = c;
    one.stiffness = stiffness;
    one.arm.friction_n = 0.02;
    VirtualClock clock;
    SimulatedArm device(one.arm, one.hand, one.script, clock);
    SpringPlane wall(stiffness);
    one.loop.duration_s = 5.0;
    const LoopRun done = run_loop(wall, device, clock, one.loop).value();
    const Swing swing = swing_of(done.hip, Vec3::UnitZ(), one.arm.encoder_mm);
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

TEST(ClosedLoop, NoPathLeadsAroundTheGovernor) {
  LoopCase c;
  c.stiffness = 50.0;
  c.loop.slew_n_per_s = 100.0;
  const LoopRun done = run(c);
  EXPECT_GT(done.slewed, 0u);
  for (std::size_t i = 1; i < done.sent_n.size(); ++i) {
    ASSERT_LE(done.sent_n[i].norm(), 3.3 * (1 + 1e-9));
    ASSERT_LE((done.sent_n[i] - done.sent_n[i - 1]).norm(), 0.1 * (1 + 1e-9)) << i;
  }
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

LoopRun run_counted(const LoopCase& c, CountedPlane& wall) {
  VirtualClock clock;
  SimulatedArm device(c.arm, c.hand, c.script, clock);
  LoopOptions loop = c.loop;
  loop.period_s = c.arm.period_s;
  loop.duration_s = c.script.duration_s();
  return run_loop(wall, device, clock, loop).value();
}

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
      const LoopRun whole = run_counted(c, to_the_end);
      c.loop.still_s = 0.25;
      const LoopRun ended = run_counted(c, until_still);
      expect_same_run(whole, ended);
      EXPECT_LT(2 * until_still.steps, to_the_end.steps) << delay_s << ", " << jitter_s;
    }
}

TEST(ClosedLoop, WhatStillMovesOrIsStillToChangeIsSimulated) {
  LoopCase swinging;  // a wall that changes before it has been still for long enough
  swinging.loop.still_s = 1.5;
  CountedPlane changing(1.5), changing_too(1.5);
  const LoopRun ended = run_counted(swinging, changing);
  swinging.loop.still_s = 0.0;
  expect_same_run(run_counted(swinging, changing_too), ended);
  EXPECT_LT(ended.hip.hip_mm.back().z(), ended.hip.hip_mm[1400].z() - 0.1) << "deeper into a softer wall";
  LoopCase released;  // the hand lets go later: what rests before that does not rest for good
  released.script = release_contact(kPlace, {});
  released.loop.still_s = 0.1;
  CountedPlane wall, same_wall;
  const LoopRun let = run_counted(released, wall);
  released.loop.still_s = 0.0;
  expect_same_run(run_counted(released, same_wall), let);
  EXPECT_GT(let.hip.hip_mm.back().z(), 0.0);
  LoopCase frictionless;  // it dies away and never rests
  frictionless.arm.friction_n = 0.0;
  frictionless.loop.still_s = 0.1;
  CountedPlane felt;
  const LoopRun all = run_counted(frictionless, felt);
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
  AdmittanceOptions options;
  options.bandwidth_hz = 0.0;
  options.damping_n_s_per_mm = 0.0;
  Hand hand;
  hand.push_n = Vec3(0, 0, -4.0);  // 4 N on 2 kg: 2 m/s^2
  const LoopRun done = run_admittance(options, hand, resting_at(Vec3(0, 0, 500)), 1.0, 0.5);
  // Semi-implicit sums: n(n+1)/2 T^2 a after n ticks.
  EXPECT_NEAR(done.hip.hip_mm.back().z(), 500.0 - 2000.0 * 0.5 * 500 * 501 * 1e-6, 1e-6);
}

TEST(Admittance, ItsLimitIsThatOfItsSums) {
  AdmittanceOptions options;
  options.bandwidth_hz = 0.0;
  options.force_max_n = 1e9;
  options.speed_max_mm_s = 1e9;
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
  AdmittanceOptions options;
  options.mass_kg = 0.0;
  SimulatedAdmittance device(options, {}, script, clock);
  EXPECT_FALSE(device.open());
}

}  // namespace
}  // namespace palpate::device
