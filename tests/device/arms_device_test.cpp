// Arms over a link of which the test is the other side: counts, rest poses, currents, the beat of commands,
// and arms that lie.
#include "device/arms/arm_device.h"

#include <cmath>

#include "tests/device/helpers.h"
#include "tests/device/hid_fake_link.h"
#include "toolkit/core/random.h"

namespace palpate::device {
namespace {

struct ArmRig {
  explicit ArmRig(const std::string& name, const std::function<void(ArmDescription&)>& change = {},
                  int open_tries = 0) {
    ArmDescription arm = find_arm(name).value();
    if (change) change(arm);
    clock.advance(1.0);
    wire.keeps_rest = arm.form == ArmForm::kText;
    device = std::make_unique<ArmDevice>(arm, std::make_unique<FakeLink>(wire), clock,
                                         ArmDeviceOptions{open_tries});
  }
  /// Sends one report8 of these counts; by how much its own counter goes on.
  void report8(int a, int b, int c, int by = 1) { wire.give(words({a, b, c, counter += by})); }
  /// And reads it, a period later.
  DeviceState counts8(int a, int b, int c) {
    report8(a, b, c);
    return frame();
  }
  DeviceState counts14(int a, int b, int c, int d = 0, int info = 0) {
    wire.give(words({a, b, c, d, 0, 0, info}));
    return frame();
  }
  DeviceState line(int a, int b, int c, int model = 1, int error = 0) {
    wire.give("[" + std::to_string(model) + "," + std::to_string(a) + "," + std::to_string(b) + "," +
              std::to_string(c) + ",0,0,0," + std::to_string(error) + "]\n");
    return frame();
  }
  DeviceState frame() {
    clock.advance(1e-3);
    return device->read();
  }
  /// Lies still until it is at rest.
  DeviceState rest8(int a = 0, int b = 0, int c = 0) {
    DeviceState state;
    for (int i = 0; i < 503; ++i) state = counts8(a, b, c);
    return state;
  }
  [[nodiscard]] std::array<int, 3> last_ma() const {
    return {word_of(wire.sent.back(), 0), word_of(wire.sent.back(), 1), word_of(wire.sent.back(), 2)};
  }

  VirtualClock clock;
  FakeWire wire;
  std::unique_ptr<ArmDevice> device;
  int counter = 0;
};

/// The same, open.
struct OpenArm : ArmRig {
  explicit OpenArm(const std::string& name, const std::function<void(ArmDescription&)>& change = {})
      : ArmRig(name, change) {
    EXPECT_TRUE(ok(device->open()));
  }
};

TEST(ArmDevice, RestsWhereItLiesStillAtTheStart) {
  OpenArm rig("woodenhaptics");
  // Moving: not at rest, however long.
  for (int i = 0; i < 1000; ++i) ASSERT_FALSE(rig.counts8(1000 + 3 * i, 0, 0).homed) << i;
  EXPECT_TRUE(says(arm_homing_prompt(rig.device->read().homing_step), "rest pose"));
  const DeviceState state = rig.rest8(1234, -77, 50);
  ASSERT_TRUE(state.homed);
  EXPECT_EQ(arm_homing_prompt(rig.device->read().homing_step), "");
  EXPECT_EQ(state.status, ReadStatus::kFresh);
  EXPECT_NEAR((state.position_mm - Vec3(25, 0, 205)).norm(), 0.0, 1e-9) << "rest: forearm level, 245 out";
  EXPECT_EQ(state.raw.size, 8);
  // A flicker of an encoder at an edge is lying still too.
  OpenArm flickering("woodenhaptics");
  DeviceState last;
  for (int i = 0; i < 503; ++i) last = flickering.counts8(7 + i % 2, -i % 3, 0);
  EXPECT_TRUE(last.homed);
}

TEST(ArmDevice, PositionsFollowTheCountsOverTheirWraps) {
  OpenArm rig("woodenhaptics");
  // Rest two counts before the wrap of encoder c, then down by a quarter turn: 6000 counts of it.
  ASSERT_TRUE(rig.rest8(0, 0, 32766).homed);
  DeviceState state;
  for (int i = 1; i <= 6000; i += 20)
    state = rig.counts8(
        0, 0, static_cast<std::int16_t>(static_cast<std::uint16_t>(32766 + std::min(i + 19, 6000))));
  ASSERT_TRUE(state.homed) << "a wrap is no jump";
  // sign +1: C has turned from 90 to 180 degrees: the forearm points up.
  EXPECT_NEAR((state.position_mm - Vec3(-220, 0, 80 + 205 + 245 - 80)).norm(), 0.0, 1e-9);
}

TEST(ArmDevice, AReportThatRepeatsItselfIsSilence) {
  OpenArm rig("woodenhaptics");
  EXPECT_EQ(rig.counts8(1, 2, 3).status, ReadStatus::kFresh);
  rig.report8(9, 9, 9, 0);
  EXPECT_EQ(rig.frame().status, ReadStatus::kNothingNew);
  EXPECT_EQ(rig.frame().status, ReadStatus::kNothingNew);
  EXPECT_EQ(rig.counts8(1, 2, 3).status, ReadStatus::kFresh);
}

TEST(ArmDevice, TheNewestOfSeveralReportsCounts) {
  OpenArm rig("woodenhaptics");
  ASSERT_TRUE(rig.rest8().homed);
  for (int i = 1; i <= 10; ++i) rig.report8(5 * i, 0, 0);
  const DeviceState state = rig.frame();
  const double turn = 50 * rig.device->description().rad_per_count(0);
  EXPECT_NEAR((state.position_mm - Vec3(245 * std::cos(turn) - 220, 245 * std::sin(turn), 205)).norm(), 0.0,
              1e-9);
}

TEST(ArmDevice, ForcesBecomeCurrentsByTheTransposedJacobian) {
  OpenArm rig("woodenhaptics");
  ASSERT_TRUE(rig.rest8().homed);
  // 1 N upwards at a level forearm of 245: 245 N*mm about C, by 10 / 120 at the motor, at 25.9 N*mm/A: 788
  // mA.
  rig.device->send(governed(Vec3(0, 0, 1)));
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 788}));
  // To the left: 245 about A by 10 / 160. Ahead: 205 about B, whose motor turns against it; C has no lever.
  rig.device->send(governed(Vec3(0, 1, 0)));
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{591, 0, 0}));
  rig.device->send(governed(Vec3(1, 0, 0)));
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, -659, 0}));
  rig.device->send(governed(Vec3::Zero()));
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 0}));
}

TEST(ArmDevice, TheCapScalesAllThreeAndKeepsTheDirection) {
  OpenArm rig("woodenhaptics");
  ASSERT_TRUE(rig.rest8().homed);
  rig.device->send(governed(Vec3(4, 2, 5)));
  const auto ma = rig.last_ma();
  EXPECT_EQ(ma[2], 2000) << "5 N would take 3.9 A";
  EXPECT_NEAR(ma[0] / 2000.0, 2 * 591.2 / (5 * 788.3), 1e-3);
  EXPECT_NEAR(ma[1] / 2000.0, -4 * 659.6 / (5 * 788.3), 1e-3);
  EXPECT_EQ(rig.device->counters().limited, 1u);
}

TEST(ArmDevice, CurrentsNeverPassTheCapNorWrap) {
  Random random(36);
  for (int i = 0; i < 20000; ++i) {
    const double size = std::pow(10.0, random.uniform(-2, 12));
    const Vec3 force = size * Vec3{random.normal(), random.normal(), random.normal()};
    const Vec3 weight = 1500 * Vec3{random.normal(), random.normal(), random.normal()};
    const Milliamps ma = limited_currents(force, weight, 2000);
    for (int k = 0; k < 3; ++k)
      ASSERT_LE(std::abs(int{ma[static_cast<std::size_t>(k)]}), 2000) << "seed 36, " << i;
    // Without weight the direction stays, to the rounding of a milliampere.
    const Milliamps bare = limited_currents(force, Vec3::Zero(), 2000);
    const Vec3 got(bare[0], bare[1], bare[2]);
    const double along = got.dot(force) / force.squaredNorm();
    ASSERT_LE((got - along * force).cwiseAbs().maxCoeff(), 2.0) << "seed 36, " << i;
  }
  const double nan = std::nan("");
  EXPECT_EQ(limited_currents(Vec3(1, nan, 1), Vec3::Zero(), 2000), Milliamps{});
  EXPECT_EQ(limited_currents(Vec3(1, 1, 1), Vec3(0, 0, std::numeric_limits<double>::infinity()), 2000),
            Milliamps{});
  EXPECT_EQ(limited_currents(Vec3(1e300, 1e300, 0), Vec3::Zero(), 2000), (Milliamps{2000, 2000, 0}));
}

TEST(ArmDevice, TheWeightIsHeldFirstAndCountsInTheCap) {
  EXPECT_EQ(limited_currents(Vec3(1000, 0, 0), Vec3(1500, 0, 0), 2000), (Milliamps{2000, 0, 0}));
  EXPECT_EQ(limited_currents(Vec3(-3000, 0, 0), Vec3(1500, 0, 0), 2000), (Milliamps{-1500, 0, 0}));
  EXPECT_EQ(limited_currents(Vec3(1000, 1000, 0), Vec3(1500, 0, 0), 2000), (Milliamps{2000, 500, 0}))
      << "the force is halved in all";
  EXPECT_EQ(limited_currents(Vec3(1000, 500, 0), Vec3(4000, 1000, 0), 2000), (Milliamps{2000, 500, 0}))
      << "no room for a force";
}

TEST(ArmDevice, TheWeightPassesBelowTheGovernorUntilCut) {
  OpenArm rig("woodenhaptics", [](ArmDescription& arm) { arm.weight = true; });
  EXPECT_FALSE(rig.counts8(0, 0, 0).homed);
  rig.device->send(governed(Vec3(3, 3, 3)));
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 0})) << "not homed it moves nothing";
  ASSERT_TRUE(rig.rest8().homed);
  rig.device->send(governed(Vec3::Zero()));
  EXPECT_EQ(rig.last_ma()[2], 0) << "it begins at nothing";
  for (int i = 0; i < 1000; ++i) rig.counts8(0, 0, 0);
  rig.device->send(governed(Vec3::Zero()));
  // 0.11 kg at 91 mm, level: 98.2 N*mm, 316 mA.
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 315}));
  EXPECT_TRUE(rig.device->cut_force());
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 0}));
  rig.counts8(0, 0, 0);
  rig.device->send(governed(Vec3::Zero()));
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 0})) << "cut until a force is shown again";
  rig.device->send(governed(Vec3(0, 0, 0.1)));
  EXPECT_GT(rig.last_ma()[2], 315);
  rig.clock.advance(0.05);
  rig.device->send(governed(Vec3(0, 0, 0.1)));
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 0})) << "nobody knows where the arm is by now";
}

TEST(ArmDevice, OpeningAndEveryEndSendsZero) {
  OpenArm rig("woodenhaptics");
  ASSERT_EQ(rig.wire.sent.size(), 1u);
  EXPECT_EQ(rig.wire.sent.front(), words({0, 0, 0, 0}));
  ASSERT_TRUE(rig.rest8().homed);
  rig.device->send(governed(Vec3(0, 0, 1)));
  rig.device->close();
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 0}));
  EXPECT_EQ(rig.wire.closed, 1);
  EXPECT_FALSE(rig.device->cut_force()) << "closed";
  EXPECT_EQ(rig.device->read().status, ReadStatus::kLost);
  ASSERT_TRUE(rig.device->open());
  const std::size_t before = rig.wire.sent.size();
  rig.device.reset();
  ASSERT_EQ(rig.wire.sent.size(), before + 1);
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 0})) << "the destructor";
}

TEST(ArmDevice, ASilentArmIsNotOpened) {
  ArmRig rig("woodenhaptics", {}, 3);
  EXPECT_TRUE(refused(rig.device->open(), "silent"));
  EXPECT_FALSE(rig.wire.open);
  rig.wire.give(words({0, 0, 0, 1}));
  EXPECT_TRUE(rig.device->open());
  rig.wire.opens = false;
  EXPECT_FALSE(rig.device->open());
  rig.wire.opens = rig.wire.refuses = true;
  EXPECT_FALSE(rig.device->open());
  EXPECT_FALSE(rig.wire.open);
}

TEST(ArmDevice, SaysWhatIsWrong) {
  OpenArm rig("woodenhaptics");
  ASSERT_TRUE(rig.rest8().homed);
  EXPECT_EQ(rig.frame().status, ReadStatus::kNothingNew);
  for (int i = 0; i < 2; ++i) {
    rig.wire.give(TestBytes(7));
    EXPECT_EQ(rig.frame().status, ReadStatus::kNothingNew);
  }
  rig.wire.give(TestBytes(9));
  EXPECT_EQ(rig.frame().status, ReadStatus::kGarbled) << "three of a wrong length";
  EXPECT_EQ(rig.counts8(0, 0, 0).status, ReadStatus::kFresh);
  EXPECT_EQ(rig.device->counters().malformed, 3u);
  rig.wire.gone = true;
  EXPECT_EQ(rig.frame().status, ReadStatus::kLost);
  rig.wire.gone = false;
  EXPECT_EQ(rig.frame().status, ReadStatus::kLost) << "until it is opened again";
}

TEST(ArmDevice, CountersThatJumpLoseTheRestPose) {
  OpenArm rig("woodenhaptics");
  ASSERT_TRUE(rig.rest8(0, 0, 4000).homed);
  // Power was lost: the counters begin anew.
  const DeviceState jumped = rig.counts8(0, 0, 0);
  EXPECT_FALSE(jumped.homed);
  EXPECT_EQ(rig.device->counters().jumps, 1u);
  rig.device->send(governed(Vec3(0, 0, 1)));
  EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 0}));
  // Lying still somewhere is not rest now.
  EXPECT_FALSE(rig.rest8(0, 0, 0).homed);
  EXPECT_TRUE(says(arm_homing_prompt(rig.device->read().homing_step), "jumped"));
  ASSERT_TRUE(rig.device->open());
  EXPECT_TRUE(rig.rest8(0, 0, 0).homed);
}

TEST(ArmDevice, TheButtonSetsTheArmsOwnCounters) {
  OpenArm rig("polhem-v2");
  EXPECT_FALSE(rig.counts14(100, 200, 300).homed);
  rig.device->send(governed(Vec3(1, 1, 1)));
  EXPECT_EQ(rig.wire.sent.back(), words({0, 0, 0, 0, 0, 0, 0}));
  EXPECT_TRUE(says(arm_homing_prompt(rig.device->read().homing_step), "button"));
  EXPECT_FALSE(rig.counts14(100, 200, 300, 0, 1).homed);
  rig.device->send(governed(Vec3::Zero()));
  EXPECT_EQ(rig.wire.sent.back(), words({0, 0, 0, 1, 8327, -10926, 19386})) << "command 1";
  // One report was under way.
  EXPECT_FALSE(rig.counts14(101, 200, 300, 0, 1).homed);
  rig.device->send(governed(Vec3::Zero()));
  const DeviceState state = rig.counts14(8325, -10926, 19388);
  ASSERT_TRUE(state.homed);
  const ArmDescription& arm = rig.device->description();
  const auto pose = arm_pose(arm.geometry, arm.angles_of({8325, -10926, 19388}));
  EXPECT_NEAR((state.position_mm - pose->position_mm).norm(), 0.0, 1e-9);
  rig.device->send(governed(Vec3(0, 0, 1)));
  EXPECT_EQ(word_of(rig.wire.sent.back(), 3), 0) << "currents again";
  EXPECT_NE(rig.wire.sent.back(), words({0, 0, 0, 0, 0, 0, 0}));
  // Encoder d says the button of the grip.
  EXPECT_EQ(state.buttons, 0u);
  EXPECT_EQ(rig.counts14(8325, -10926, 19388, 10000).buttons, 1u);
  EXPECT_EQ(rig.counts14(8325, -10926, 19388, -400).buttons, 0u);
}

TEST(ArmDevice, AnAlternatingArmGetsOneCommandForEachReport) {
  OpenArm rig("polhem-v3");
  EXPECT_EQ(rig.wire.last_text(), "[0,0,0]        \n") << "it is woken";
  rig.device->send(governed(Vec3(0, 0, 1)));
  EXPECT_EQ(rig.wire.sent.size(), 1u) << "it has not answered";
  EXPECT_TRUE(rig.line(0, 0, 0).homed) << "switched on in its rest pose";
  rig.device->send(governed(Vec3(0, 0, 1)));
  EXPECT_EQ(rig.wire.sent.size(), 2u);
  rig.device->send(governed(Vec3(0, 0, 1)));
  EXPECT_EQ(rig.wire.sent.size(), 2u);
  rig.device->send(governed(Vec3::Zero()));
  EXPECT_EQ(rig.wire.sent.size(), 3u) << "the end of a force waits for nobody";
  EXPECT_EQ(rig.wire.last_text(), "[0,0,0]        \n");
  rig.device->send(governed(Vec3::Zero()));
  EXPECT_EQ(rig.wire.sent.size(), 3u);
  // A line was lost: after 20 ms it is woken anew.
  rig.clock.advance(0.021);
  rig.device->send(governed(Vec3::Zero()));
  EXPECT_EQ(rig.wire.sent.size(), 4u);
  EXPECT_EQ(rig.device->counters().woken, 1u);
}

TEST(ArmDevice, TextAddsTheCountsOfItsRestPose) {
  OpenArm rig("polhem-v3");
  const DeviceState state = rig.line(0, 0, 0);
  // By hand: elbow (-77.2, 135.5), forearm at -30.3 degrees, 35.8 out and 69.6 up, turned by 120.45 degrees.
  EXPECT_NEAR((state.position_mm - Vec3(-18.2 - 204.5, 30.9, 69.6 - 32.5)).norm(), 0.0, 1.0);
  rig.line(40, 0, 0);
  const ArmDescription& arm = rig.device->description();
  const auto pose = arm_pose(arm.geometry, arm.angles_of({8312 + 80, -10366, 19764 - 30}));
  EXPECT_NEAR((rig.line(80, 0, -30).position_mm - pose->position_mm).norm(), 0.0, 1e-9);
  EXPECT_EQ(std::string(state.raw.bytes.begin(), state.raw.bytes.begin() + state.raw.size),
            "[1,0,0,0,0,0,0,0]");
}

TEST(ArmDevice, TextOfAnotherModelOrWithAnErrorIsRefused) {
  OpenArm rig("polhem-v3");
  EXPECT_EQ(rig.line(0, 0, 0, 2).status, ReadStatus::kGarbled);
  EXPECT_FALSE(rig.line(0, 0, 0, 3).homed);
  EXPECT_EQ(rig.line(0, 0, 0).status, ReadStatus::kFresh);
  EXPECT_EQ(rig.line(0, 0, 0, 1, 7).status, ReadStatus::kGarbled);
  EXPECT_EQ(rig.device->counters().strange, 3u);
  // The linkage cannot be there: the place stays, and there is no force.
  const Vec3 before = rig.line(1, 0, 0).position_mm;
  for (int i = 0; i < 200; ++i) rig.line(1, 0, -100 * i);
  const DeviceState beyond = rig.line(1, 0, -20000);
  EXPECT_EQ(beyond.status, ReadStatus::kGarbled);
  EXPECT_TRUE(is_finite(beyond.position_mm));
  EXPECT_LT((beyond.position_mm - before).norm(), 400.0);
  rig.device->send(governed(Vec3(0, 0, 1)));
  EXPECT_EQ(rig.wire.last_text(), "[0,0,0]        \n");
}

TEST(ArmDevice, TornLinesAreWhole) {
  OpenArm rig("polhem-v3");
  rig.wire.give("0,0,0]\n[1,0,0,");
  EXPECT_EQ(rig.frame().status, ReadStatus::kNothingNew);
  rig.wire.give("0,0,0,0,0]\n[1,1,1,1,0,0,0,0]\n[1,2");
  EXPECT_EQ(rig.frame().status, ReadStatus::kFresh);
  EXPECT_EQ(rig.device->counters().reports, 2u);
}

TEST(ArmDevice, LiesNeverGetForceThrough) {
  using Lie = std::function<void(ArmRig&, int)>;
  const std::vector<std::pair<const char*, Lie>> lies = {
      {"silent", [](ArmRig&, int) {}},
      {"short", [](ArmRig& rig, int) { rig.wire.give(TestBytes(3)); }},
      {"long", [](ArmRig& rig, int) { rig.wire.give(TestBytes(64)); }},
      {"jumps", [](ArmRig& rig, int i) { rig.report8(i % 2 * 20000, 0, 0); }},
      {"creeps far", [](ArmRig& rig, int i) { rig.report8(0, 200 * i, 0); }},
      {"repeats", [](ArmRig& rig, int) { rig.report8(0, 0, 0, 0); }},
      {"gone", [](ArmRig& rig, int) { rig.wire.gone = true; }}};
  for (const auto& [name, lie] : lies) {
    OpenArm rig("woodenhaptics", [](ArmDescription& arm) {
      arm.limits.workspace_mm = {Vec3::Constant(-500), Vec3::Constant(500)};  // no edge fades here
    });
    ASSERT_TRUE(rig.rest8().homed);
    ForceGovernor governor = ForceGovernor::create(rig.device->limits(), {}).value();
    governor.arm(rig.clock.now_s());
    for (int i = 0; i < 700; ++i) {
      const DeviceState state = rig.counts8(0, 0, 0);
      rig.device->send(governor.govern(rig.clock.now_s(), state, Vec3(0, 0, 1)));
    }
    ASSERT_GT(rig.last_ma()[2], 700) << name;
    int frames = 0;
    for (; frames < 100 && governor.fault() == Fault::kNone; ++frames) {
      lie(rig, frames);
      const DeviceState state = rig.frame();
      rig.device->send(governor.govern(rig.clock.now_s(), state, Vec3(0, 0, 1)));
    }
    EXPECT_NE(governor.fault(), Fault::kNone) << name;
    EXPECT_LE(frames, 22) << name << ": 20 ms of silence at most";
    if (!rig.wire.gone) {
      EXPECT_EQ(rig.last_ma(), (std::array<int, 3>{0, 0, 0})) << name << ": in the very frame";
    }
  }
}

TEST(ArmDriver, MakesWhatIsNamedAndRefusesTheRest) {
  const Driver driver = driver_of(&register_arm_driver, "arm:polhem-v3");
  const MonotonicClock clock;
  const auto made =
      value_of(driver.make({"arm:polhem-v3", {}, {{"current_cap_a", "1.5"}, {"path", "/dev/none"}}}, clock));
  EXPECT_EQ(made.device->name(), "arm:polhem-v3");
  EXPECT_TRUE(made.zero);
  EXPECT_FALSE(made.zero()) << "there is none";
  EXPECT_GE(made.unproven.size(), 1u);
  EXPECT_FALSE(made.device->open());
  const auto refused = [&](const DeviceRequest& request) { return refusal_of(driver, request); };
  EXPECT_TRUE(says(refused({"arm", {}, {}}), "not which arm"));
  EXPECT_TRUE(says(refused({"arm:polhem-v4", {}, {}}), "did you mean"));
  EXPECT_TRUE(says(refused({"arm:polhem-v3", "x.toml", {}}), "description given too"));
  EXPECT_TRUE(says(refused({"arm", "/nowhere/x.toml", {}}), "/nowhere/x.toml"));
  EXPECT_TRUE(says(refused({"arm:polhem-v3", {}, {{"colour", "red"}}}), "no option"));
  EXPECT_TRUE(says(refused({"arm:polhem-v3", {}, {{"current_cap_a", "3"}}}), "current_cap_a"))
      << "raised in the description alone";
  EXPECT_TRUE(says(refused({"arm:polhem-v3", {}, {{"force_n", "nan"}}}), "force_n"));
  EXPECT_TRUE(says(refused({"arm:polhem-v3", {}, {{"weight", "on"}}}), "chain"));
  EXPECT_TRUE(says(refused({"arm:polhem-v3", {}, {{"weight", "perhaps"}}}), "on or off"));
  const auto entries = driver.look();
  EXPECT_GE(entries.size(), 6u);
  for (const DeviceEntry& entry : entries) {
    EXPECT_TRUE(entry.name.starts_with("arm:"));
    EXPECT_FALSE(entry.what.empty());
    if (entry.status != DeviceStatus::kReady) {
      EXPECT_FALSE(entry.needs.empty());
    }
  }
}

}  // namespace
}  // namespace palpate::device
