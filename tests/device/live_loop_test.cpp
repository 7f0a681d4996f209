// Switches under a simulated hand: what a hand feels of them, against a published simulation, and that
// nothing steps which the renderers do not do themselves.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "device/live/triggers.h"
#include "device/simulated/simulated_arm.h"
#include "tests/device/live_rig.h"
#include "tests/device/rig.h"

namespace palpate::device {
namespace {

struct Felt {
  double most_n_per_s = 0.0, most_mm_per_s = 0.0, most_m_per_s2 = 0.0;
};

/// The bench of the table: 0.15 kg, a hand of 0.25 N/mm and 0.006 N s/mm that presses with 1.14 N, a sample
/// of delay, A of 0.8 N/mm, B of 1.2 N/mm half a millimetre higher. `fade_s` 0: a hard switch.
Felt switched_with(double fade_s) {
  constexpr double kPeriodS = 1e-3, kPressN = 1.14, kSettleS = 3.0, kHandNPerMm = 0.25;
  const double depth_mm = kPressN / 0.8;
  ArmOptions arm;
  arm.mass_kg = 0.15;
  arm.damping_n_s_per_mm = 0.0;
  arm.force_max_n = 100.0;
  arm.delay_s = kPeriodS;
  Hand hand;
  hand.damping_n_s_per_mm = 0.006;
  hand.stiffness_n_per_mm = kHandNPerMm;
  const Vec3 goal(0.0, 0.0, -depth_mm - kPressN / kHandNPerMm);
  const HandScript script =
      HandScript::create("press", {0.0, 0.5}, {Vec3(0.0, 0.0, 2.0), goal}, HandScript::Between::kMinimumJerk)
          .value();
  VirtualClock clock;
  SimulatedArm device(arm, hand, script, clock);
  SwitchOptions options = bench_options();
  options.device_force_max_n = options.force_limit_n = 100.0;
  options.difference_most_n = 10.0;  // the rule refuses this very case
  if (fade_s > 0.0) options.fade_s = fade_s;
  TwoPlanes rig(options, 1.2, 0.5);
  rig.a->stiffness_n_per_mm = 0.8;
  GovernorOptions governed;
  governed.user_limit_n = 100.0;
  governed.slew_n_per_s = 1e9;
  governed.soft_start_s = 1e-9;
  EXPECT_TRUE(device.open());
  Servo servo(rig.mixer, governed, device, clock, geometry::RigidTransform{});
  EXPECT_TRUE(servo.start(Vec3(0.0, 0.0, 2.0)));
  Felt felt;
  double last_n = 0.0, last_mm_s = 0.0;
  const int ticks = 5000, at = static_cast<int>(kSettleS / kPeriodS);
  for (int i = 0; i < ticks; ++i) {
    clock.advance(kPeriodS);
    if (i == at) {
      rig.ask(1);
      if (fade_s == 0.0) {
        // What a switch without a mixer does.
        rig.a->stiffness_n_per_mm = 1.2;
        rig.a->height_mm = 0.5;
      }
    }
    const Tick tick = servo.tick();
    EXPECT_EQ(tick.fault, Fault::kNone);
    const double n = tick.sent_n.z(), mm_s = device.velocity_mm_s().z();
    if (i >= at) {
      felt.most_n_per_s = std::max(felt.most_n_per_s, std::abs(n - last_n) / kPeriodS);
      felt.most_mm_per_s = std::max(felt.most_mm_per_s, std::abs(mm_s));
      felt.most_m_per_s2 = std::max(felt.most_m_per_s2, std::abs(mm_s - last_mm_s) / kPeriodS * 1e-3);
    } else if (i == at - 1) {
      EXPECT_NEAR(n, kPressN, 1e-3) << "at rest before the switch";
    }
    last_n = n;
    last_mm_s = mm_s;
  }
  EXPECT_NEAR(last_n, 1.341, 1e-3) << "the new balance";
  return felt;
}

TEST(LiveLoop, AFadeMovesTheHandAsMuchAsThePublishedSimulationSays) {
  struct Row {
    double fade_s, n_per_s, mm_per_s, m_per_s2;
  };
  for (const Row& row : {Row{0.0, 1171.0, 63.0, 7.6}, Row{0.02, 84.0, 57.0, 4.5}, Row{0.05, 34.0, 38.0, 2.8},
                         Row{0.1, 8.0, 19.0, 0.65}, Row{0.2, 2.4, 7.0, 0.19}}) {
    const Felt felt = switched_with(row.fade_s);
    std::printf("fade %3.0f ms: %7.1f N/s %5.1f mm/s %5.2f m/s^2 (printed %6.1f %5.1f %5.2f)\n",
                row.fade_s * 1e3, felt.most_n_per_s, felt.most_mm_per_s, felt.most_m_per_s2, row.n_per_s,
                row.mm_per_s, row.m_per_s2);
    EXPECT_NEAR(felt.most_m_per_s2, row.m_per_s2, 0.1 * row.m_per_s2) << row.fade_s;
  }
}

TEST(LiveLoop, TheRuleRefusesThatCase) {
  TwoPlanes rig(bench_options(SwitchRule::kContactElseRefuse), 1.2, 0.5);
  rig.a->stiffness_n_per_mm = 0.8;
  rig.begin(1.0);
  rig.rest(-1.425, 200);
  rig.ask(1);
  rig.step(-1.425);
  EXPECT_EQ(rig.mixer.last().decision, MixDecision::kRefused);
  EXPECT_EQ(rig.mixer.last().reason, SwitchReason::kForcesDiffer) << "1.17 N apart";
}

}  // namespace
}  // namespace palpate::device
