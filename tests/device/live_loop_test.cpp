// When one renderer may take over from another, where the scene stands, what buttons ask for.

#include <cmath>
#include <numbers>

#include "device/live/hand_controls.h"
#include "device/live/switch_rules.h"
#include "device/simulated/simulated_arm.h"
#include "device/simulated/simulated_device.h"
#include "tests/device/helpers.h"
#include "tests/device/live_rig.h"
#include "tests/device/rig.h"

namespace palpate::device {
namespace {

SwitchOptions usual() {
  return {.device_force_max_n = 3.3, .force_limit_n = 2.3};
}

TEST(SwitchRules, RaisedCosineIsThatOfTheLibrary) {
  EXPECT_EQ(raised_cosine(-1.0), 0.0);
  EXPECT_EQ(raised_cosine(0.0), 0.0);
  EXPECT_EQ(raised_cosine(1.0), 1.0);
  EXPECT_EQ(raised_cosine(2.0), 1.0);
  EXPECT_EQ(raised_cosine(std::numeric_limits<double>::quiet_NaN()), 0.0);
  double before = 0.0;
  for (int i = 1; i <= 1000; ++i) {
    const double u = i / 1000.0, w = raised_cosine(u);
    EXPECT_NEAR(w, 0.5 * (1.0 - std::cos(std::numbers::pi * u)), 1e-15) << u;
    EXPECT_NEAR(w + raised_cosine(1.0 - u), 1.0, 1e-15) << u;
    EXPECT_LE(w - before, 0.5 * std::numbers::pi / 1000.0 * (1.0 + 1e-12)) << "the slope that bounds a fade";
    EXPECT_GE(w, before);
    before = w;
  }
}

TEST(SwitchRules, NumbersThatAreNotRightAreNamed) {
  EXPECT_TRUE(check(usual()));
  SwitchOptions options = usual();
  options.device_force_max_n = 0.0;
  ASSERT_FALSE(check(options));
  EXPECT_TRUE(says(check(options).error().message(), "force"));
  for (double SwitchOptions::*number :
       {&SwitchOptions::force_limit_n, &SwitchOptions::world_per_device, &SwitchOptions::period_s,
        &SwitchOptions::free_force_n, &SwitchOptions::free_s, &SwitchOptions::clearance_mm,
        &SwitchOptions::fade_s, &SwitchOptions::speed_most_mm_s, &SwitchOptions::load_share}) {
    for (const double wrong :
         {0.0, -1.0, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
      options = usual();
      options.*number = wrong;
      EXPECT_FALSE(check(options)) << wrong;
    }
  }
  options = usual();
  options.fade_s = 2.0;
  EXPECT_FALSE(check(options));
}

TEST(SwitchRules, FreeSpaceIsTimeAndDistance) {
  const SwitchOptions options = usual();
  FreeWatch watch;
  watch.restart(0.0);
  const Vec3 place(1.0, 2.0, 3.0);
  EXPECT_FALSE(watch.is_free(place, 0.149, options));
  EXPECT_TRUE(watch.is_free(place, 0.151, options)) << "it never touched";
  watch.observe(place, true, 1.0, 1.0, options);
  EXPECT_FALSE(watch.is_free(place + Vec3(0.0, 0.0, 0.9), 2.0, options)) << "too near";
  EXPECT_FALSE(watch.is_free(place + Vec3(0.0, 0.0, 5.0), 1.1, options)) << "too soon";
  EXPECT_TRUE(watch.is_free(place + Vec3(0.0, 0.0, 1.1), 1.2, options));
  watch.observe(place, false, 0.019, 2.0, options);
  EXPECT_TRUE(watch.is_free(place + Vec3(0.0, 0.0, 1.1), 2.0, options)) << "nobody feels 0.019 N";
  watch.observe(place, false, 0.02, 3.0, options);
  EXPECT_FALSE(watch.is_free(place + Vec3(0.0, 0.0, 1.1), 3.1, options)) << "a force without contact";
  watch.observe(place, false, std::numeric_limits<double>::quiet_NaN(), 5.0, options);
  EXPECT_FALSE(watch.is_free(place + Vec3(0.0, 0.0, 1.1), 5.1, options));
}

TEST(SwitchRules, ClearanceIsTheDevices) {
  SwitchOptions options = usual();
  options.world_per_device = 4.0;
  FreeWatch watch;
  watch.observe(Vec3::Zero(), true, 1.0, 0.0, options);
  EXPECT_FALSE(watch.is_free(Vec3(3.9, 0.0, 0.0), 1.0, options)) << "0.98 mm of the device";
  EXPECT_TRUE(watch.is_free(Vec3(4.1, 0.0, 0.0), 1.0, options));
}

TEST(SwitchRules, AFadeIsRefusedForOneReasonAtATime) {
  const SwitchOptions options = usual();
  EXPECT_DOUBLE_EQ(difference_limit_n(options), 0.825) << "a quarter of 3.3 N";
  const auto side = [](double n, bool contact) { return SwitchSide{Vec3(0.0, 0.0, n), contact}; };
  EXPECT_EQ(fade_refusal(side(1.0, true), side(1.8, true), 100.0, options), SwitchReason::kNone);
  EXPECT_EQ(fade_refusal(side(0.0, false), side(0.0, false), 100.0, options), SwitchReason::kNone);
  EXPECT_EQ(fade_refusal(side(1.0, true), side(1.83, true), 100.0, options), SwitchReason::kForcesDiffer);
  EXPECT_EQ(fade_refusal(side(0.1, true), side(0.0, false), 100.0, options), SwitchReason::kContactDiffers);
  EXPECT_EQ(fade_refusal(side(1.0, true), side(1.0, true), 150.0, options), SwitchReason::kTooFast);
  EXPECT_EQ(fade_refusal(side(2.3, true), side(2.2, true), 0.0, options), SwitchReason::kSaturated);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(fade_refusal(side(1.0, true), side(nan, true), 0.0, options), SwitchReason::kNone);
  EXPECT_NE(fade_refusal(side(1.0, true), side(1.0, true), nan, options), SwitchReason::kNone);
  SwitchOptions strong = options;
  strong.device_force_max_n = 12.0;
  EXPECT_DOUBLE_EQ(difference_limit_n(strong), 1.0);
}

TEST(SwitchRules, SpeedIsNotThatOfEncoderSteps) {
  HandSpeed speed;
  for (int i = 0; i < 200; ++i) speed.observe(Vec3(i % 2 == 0 ? 0.0 : 0.055, 0.0, 0.0), 1e-3);
  EXPECT_LT(speed.mm_s(), 10.0) << "a hand at rest between two steps of an encoder";
  speed.restart();
  for (int i = 0; i < 200; ++i) speed.observe(Vec3(0.2 * i, 0.0, 0.0), 1e-3);
  EXPECT_NEAR(speed.mm_s(), 200.0, 1e-6);
}

TEST(RequestSlot, TheNewestCountsAndIsTakenOnce) {
  RequestSlot slot;
  EXPECT_EQ(slot.take().kind, SwitchRequest::Kind::kNone);
  slot.post({SwitchRequest::Kind::kNext, SwitchSource::kTimer, 0});
  const SwitchRequest newest{SwitchRequest::Kind::kSelect, SwitchSource::kKey, 6};
  slot.post(newest);
  EXPECT_EQ(slot.peek(), newest);
  EXPECT_EQ(slot.take(), newest);
  EXPECT_EQ(slot.take().kind, SwitchRequest::Kind::kNone);
}

TEST(RequestSlot, ManyThreadsPostAndOneTakes) {
  RequestSlot slot;
  constexpr int kPosts = 2000;
  std::vector<std::thread> posters;
  for (std::uint8_t lane = 1; lane <= 3; ++lane)
    posters.emplace_back([&slot, lane] {
      for (int i = 0; i < kPosts; ++i)
        slot.post({SwitchRequest::Kind::kSelect, static_cast<SwitchSource>(lane), lane});
    });
  int taken = 0;
  const auto take = [&] {
    const SwitchRequest request = slot.take();
    if (request.kind == SwitchRequest::Kind::kNone) return;
    ++taken;
    EXPECT_EQ(static_cast<std::uint8_t>(request.source), request.lane)
        << "never half of one and half of another";
  };
  for (int i = 0; i < kPosts; ++i) take();
  for (std::thread& poster : posters) poster.join();
  take();
  EXPECT_GT(taken, 0);
}

DeviceLimits limits_of(const Vec3& half, WorkspaceShape shape) {
  return {3.3, {-half, half}, 0.0, 1000.0, 0.0, 0.0, shape};
}

TEST(Workspace, FitsTheBoxIntoTheShape) {
  const geometry::Aabb scene{Vec3(100.0, 0.0, 0.0), Vec3(300.0, 50.0, 10.0)};
  for (const WorkspaceShape shape :
       {WorkspaceShape::kBox, WorkspaceShape::kEllipsoid, WorkspaceShape::kCylinder}) {
    const DeviceLimits limits = limits_of(Vec3(80.0, 60.0, 40.0), shape);
    const DeviceMap map = map_for(scene, limits, {WorkspaceFit::kFitted, 1.0}).value();
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 at((corner & 1) != 0 ? 300.0 : 100.0, (corner & 2) != 0 ? 50.0 : 0.0,
                    (corner & 4) != 0 ? 10.0 : 0.0);
      const Vec3 there = map.device_mm(at);
      const double a = there.x() / 80.0, b = there.y() / 60.0, c = there.z() / 40.0;
      EXPECT_LE(std::abs(c), 1.0);
      if (shape == WorkspaceShape::kEllipsoid) {
        EXPECT_LE(a * a + b * b + c * c, 1.0);
      }
      if (shape == WorkspaceShape::kCylinder) {
        EXPECT_LE(a * a + b * b, 1.0);
      }
      EXPECT_LE(std::max(std::abs(a), std::abs(b)), 0.9 + 1e-12);
      EXPECT_LT((map.world_mm(there) - at).norm(), 1e-10);
    }
    EXPECT_LT((map.world_mm(Vec3::Zero()) - scene.centre_mm()).norm(), 1e-12);
  }
  EXPECT_DOUBLE_EQ(
      map_for(scene, limits_of(Vec3(100.0, 100.0, 100.0), WorkspaceShape::kBox), {}).value().world_per_device,
      1.0);
  EXPECT_FALSE(map_for(scene, limits_of(Vec3::Zero(), WorkspaceShape::kBox), {WorkspaceFit::kFitted, 1.0}));
  EXPECT_FALSE(map_for(scene, limits_of(Vec3::Ones(), WorkspaceShape::kBox), {WorkspaceFit::kFactor, -1.0}));
}

TEST(Workspace, AFactorIsFeltAsStiffness) {
  // A wall of 0.5 N/mm at three mm of the scene for one of the device.
  SpringPlane wall(0.5);
  VirtualClock clock;
  trace::ProbePath path;
  path.name = "down";
  for (int i = 0; i <= 1000; ++i) {
    path.t_s.push_back(i * 1e-3);
    path.hip_mm.push_back(Vec3(0.0, 0.0, 0.5 - 1e-3 * i));
  }
  SimulatedDevice device(path, clock, limits_of(Vec3(50.0, 50.0, 50.0), WorkspaceShape::kBox), 2000);
  GovernorOptions options{.soft_start_s = 1e-9};
  Servo servo(wall, options, device, clock, DeviceMap(geometry::RigidTransform{}, 3.0));
  ASSERT_TRUE(servo.start());
  Tick tick;
  for (int i = 0; i <= 1000; ++i) {
    tick = servo.tick();
    clock.advance(1e-3);
  }
  EXPECT_NEAR(tick.hip_mm.z(), -1.5, 1e-9);
  EXPECT_NEAR(tick.sent_n.z(), 0.75, 1e-9) << "0.5 mm of the device: 1.5 N/mm";
}

TEST(Workspace, TheClutchMovesTheSceneAndNeverTheHip) {
  Clutch clutch;
  geometry::RigidTransform rigid;
  rigid.rotation = Eigen::AngleAxisd(0.7, Vec3(1.0, 2.0, 3.0).normalized());
  rigid.translation_mm = Vec3(5.0, 6.0, 7.0);
  DeviceMap map(rigid, 2.0);
  Vec3 device(10.0, -4.0, 3.0);
  const Vec3 hip = map.world_mm(device);
  map = clutch.update(map, true, false, device);
  EXPECT_FALSE(clutch.engaged()) << "in contact it does not engage";
  map = clutch.update(map, true, true, device);
  ASSERT_TRUE(clutch.engaged());
  for (int i = 0; i < 10; ++i) {
    device += Vec3(1.0, 2.0, -1.5);
    EXPECT_LT((map.world_mm(device) - hip).norm(), 1e-12) << "held";
    map = clutch.update(map, true, false, device);
  }
  map = clutch.update(map, false, false, device);
  EXPECT_FALSE(clutch.engaged());
  EXPECT_LT((map.world_mm(device) - hip).norm(), 1e-10) << "let go of where it was";
  EXPECT_EQ(map.world_per_device, 2.0);
  EXPECT_LT((map.world_mm(device + Vec3::UnitX()) - hip - 2.0 * (rigid.rotation * Vec3::UnitX())).norm(),
            1e-10);
}

TEST(Triggers, AButtonThatBouncesIsPressedOnce) {
  Debounced button;
  int presses = 0;
  bool before = false;
  for (int i = 0; i < 200; ++i) {
    const double t_s = i * 1e-3;
    // Pressed at 50 ms, bouncing for 6 ms; let go at 150 ms, bouncing.
    const bool raw = (i >= 50 && i < 150 && !(i < 56 && i % 2 == 1)) || (i >= 151 && i < 155 && i % 2 == 1);
    const bool now = button.update(raw, t_s);
    if (now && !before) {
      ++presses;
      EXPECT_EQ(i, 50) << "at once";
    }
    before = now;
  }
  EXPECT_EQ(presses, 1);
  EXPECT_FALSE(before);
}

// ---- Switches under a simulated hand: what a hand feels of them, against a published simulation, and that
// nothing steps which the renderers do not do themselves.

struct Felt {
  double most_n_per_s = 0.0, most_mm_per_s = 0.0, most_m_per_s2 = 0.0;
};

/// The bench of the table: 0.15 kg, a hand of 0.25 N/mm and 0.006 N s/mm that presses with 1.14 N, a sample
/// of delay, A of 0.8 N/mm, B of 1.2 N/mm half a millimetre higher. `fade_s` 0: a hard switch.
Felt switched_with(double fade_s) {
  constexpr double kPeriodS = 1e-3, kPressN = 1.14, kSettleS = 3.0, kHandNPerMm = 0.25;
  const double depth_mm = kPressN / 0.8;
  ArmOptions arm{.mass_kg = 0.15, .damping_n_s_per_mm = 0.0, .force_max_n = 100.0, .delay_s = kPeriodS};
  Hand hand{.damping_n_s_per_mm = 0.006, .stiffness_n_per_mm = kHandNPerMm};
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
  GovernorOptions governed{.user_limit_n = 100.0, .slew_n_per_s = 1e9, .soft_start_s = 1e-9};
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

}  // namespace
}  // namespace palpate::device
