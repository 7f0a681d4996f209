// 3Dconnexion: reports to the byte, rate control, silence.
#include "device/spacemouse/spacemouse_device.h"

#include <cmath>
#include <set>

#include "tests/device/helpers.h"
#include "tests/device/hid_fake_link.h"

namespace palpate::device {
namespace {

TestBytes axes_report(int x, int y, int z) {
  TestBytes bytes = {1};
  const TestBytes axes = words({x, y, z});
  bytes.insert(bytes.end(), axes.begin(), axes.end());
  return bytes;
}

struct MouseRig {
  explicit MouseRig(std::uint16_t product = 0xc635, std::uint16_t vendor = 0x256f) {
    clock.advance(1.0);
    device = std::make_unique<SpaceMouseDevice>(std::make_unique<FakeLink>(wire), clock,
                                                *spacemouse_model(vendor, product));
  }
  DeviceState frames(int count) {
    DeviceState state;
    for (int i = 0; i < count; ++i) {
      clock.advance(1e-3);
      state = device->read();
    }
    return state;
  }
  VirtualClock clock;
  FakeWire wire;
  std::unique_ptr<SpaceMouseDevice> device;
};

TEST(SpaceMouseReports, KnownOnesHaveTheseBytes) {
  using Kind = SpaceMouseReport::Kind;
  const TestBytes seven = {1, 0x5E, 0x01, 0xA2, 0xFE, 0x07, 0x00};
  const auto axes = decoded_spacemouse(seven).value();
  EXPECT_EQ(axes.kind, Kind::kAxes);
  EXPECT_EQ(axes.axes, (std::array<std::int16_t, 3>{350, -350, 7}));
  EXPECT_FALSE(axes.has_turns);
  TestBytes thirteen = axes_report(1, 2, 3);
  for (const std::uint8_t byte : words({4, 5, -6})) thirteen.push_back(byte);
  EXPECT_EQ(decoded_spacemouse(thirteen)->turns, (std::array<std::int16_t, 3>{4, 5, -6}));
  const TestBytes turns = {2, 1, 0, 2, 0, 3, 0};
  EXPECT_EQ(decoded_spacemouse(turns)->kind, Kind::kTurns);
  const TestBytes buttons = {3, 0x02, 0x01, 0x00, 0x80};
  EXPECT_EQ(decoded_spacemouse(buttons)->buttons, 0x80000102u);
  const TestBytes long_buttons = {3, 1, 0, 0, 0, 0xFF, 0xFF};
  EXPECT_EQ(decoded_spacemouse(long_buttons)->buttons, 1u) << "of the first 32";
  const TestBytes battery = {0x17, 50};
  EXPECT_EQ(decoded_spacemouse(battery)->kind, Kind::kOther);
}

TEST(SpaceMouseReports, LengthsThatAreWrongAreRefused) {
  for (std::size_t size = 0; size < 20; ++size) {
    TestBytes bytes(size, 1);
    EXPECT_EQ(decoded_spacemouse(bytes).has_value(), size == 7 || size == 13) << size;
    if (size == 0) continue;
    bytes[0] = 2;
    EXPECT_EQ(decoded_spacemouse(bytes).has_value(), size == 7) << size;
    bytes[0] = 3;
    EXPECT_EQ(decoded_spacemouse(bytes).has_value(), size >= 2 && size <= 7) << size;
  }
}

TEST(SpaceMouseReports, TheTableHoldsWhatMayBeOpened) {
  std::set<std::pair<int, int>> ids;
  for (const SpaceMouseModel& model : spacemouse_models()) {
    EXPECT_TRUE(ids.insert({model.vendor, model.product}).second) << model.name;
    const bool old = model.product == 0xc603 || model.product == 0xc606 || model.product == 0xc640;
    EXPECT_EQ(model.axes_as_is, old) << model.name;
  }
  EXPECT_EQ(ids.size(), 23u);
  for (const int keyboard_or_mouse :
       {0xc650, 0xc651, 0xc654, 0xc655, 0xc656, 0xc657, 0xc658, 0xc664, 0xc665, 0xc668})
    EXPECT_EQ(spacemouse_model(0x256f, static_cast<std::uint16_t>(keyboard_or_mouse)), nullptr);
  EXPECT_EQ(spacemouse_model(0x046d, 0xc62e), nullptr) << "another maker's";
}

TEST(SpaceMouse, TheCurveHasADeadZoneAndAnEnd) {
  const SpaceMouseOptions options;
  EXPECT_EQ(spacemouse_speed(0, options), 0.0);
  EXPECT_EQ(spacemouse_speed(17, options), 0.0) << "5 % of 350 is 17.5";
  EXPECT_GT(spacemouse_speed(18, options), 0.0);
  EXPECT_DOUBLE_EQ(spacemouse_speed(350, options), 150.0);
  EXPECT_DOUBLE_EQ(spacemouse_speed(-350, options), -150.0);
  EXPECT_DOUBLE_EQ(spacemouse_speed(32767, options), 150.0);
  // Half way beyond the dead zone: 0.5^1.7 of full speed.
  EXPECT_NEAR(spacemouse_speed(350 * 0.525, options), 150 * std::pow(0.5, 1.7), 1e-9);
  double before = 0.0;
  for (int counts = 0; counts <= 350; ++counts) {
    const double speed = spacemouse_speed(counts, options);
    EXPECT_GE(speed, before);
    before = speed;
  }
}

TEST(SpaceMouse, ASpeedIsIntegratedAlongTheModelsAxes) {
  MouseRig rig;
  ASSERT_TRUE(rig.device->open());
  EXPECT_EQ(rig.wire.sent.front(), (TestBytes{4, 1})) << "its lamp";
  EXPECT_EQ(rig.frames(50).position_mm, Vec3(0, 0, 0));
  EXPECT_EQ(rig.frames(1).status, ReadStatus::kFresh) << "silent at rest, and yet known";
  for (int i = 0; i < 10; ++i) {
    rig.wire.give(axes_report(350, 0, 0));
    rig.frames(10);
  }
  EXPECT_NEAR(rig.frames(1).position_mm.x(), 0.101 * 150, 1e-9);
  rig.wire.give(axes_report(0, 350, 0));
  EXPECT_NEAR(rig.frames(20).position_mm.z(), -0.020 * 150, 1e-9) << "its y is our -z";
  rig.wire.give(axes_report(0, 0, 350));
  EXPECT_NEAR(rig.frames(20).position_mm.y(), -0.020 * 150, 1e-9) << "its z is our -y";
  rig.wire.give(axes_report(0, 0, 0));
  const Vec3 rest = rig.frames(1).position_mm;
  EXPECT_EQ(rig.frames(500).position_mm, rest);
  MouseRig old(0xc603, 0x046d);
  ASSERT_TRUE(old.device->open());
  old.wire.give(axes_report(0, 350, 0));
  EXPECT_NEAR(old.frames(20).position_mm.y(), 0.020 * 150, 1e-9) << "as it is";
}

TEST(SpaceMouse, ItStaysInItsBoxAndDoesNotLeapAfterAPause) {
  MouseRig rig;
  ASSERT_TRUE(rig.device->open());
  for (int i = 0; i < 200; ++i) {
    rig.wire.give(axes_report(-350, 0, 0));
    rig.frames(10);
  }
  EXPECT_EQ(rig.frames(1).position_mm.x(), -100.0);
  rig.wire.give(axes_report(350, 0, 0));
  rig.frames(1);
  rig.clock.advance(0.09);
  const DeviceState after = rig.device->read();
  EXPECT_LE(after.position_mm.x(), -100.0 + 150 * 0.0211);
}

TEST(SpaceMouse, SilenceWhilePushedIsLossUntilItIsHeardOf) {
  MouseRig rig;
  ASSERT_TRUE(rig.device->open());
  rig.wire.give(axes_report(350, 0, 0));
  EXPECT_EQ(rig.frames(100).status, ReadStatus::kFresh);
  const DeviceState lost = rig.frames(3);
  EXPECT_EQ(lost.status, ReadStatus::kLost);
  EXPECT_EQ(rig.frames(500).position_mm, lost.position_mm) << "it stands";
  rig.wire.give(axes_report(0, 0, 0));
  EXPECT_EQ(rig.frames(1).status, ReadStatus::kFresh);
  rig.wire.gone = true;
  EXPECT_EQ(rig.frames(1).status, ReadStatus::kLost);
}

TEST(SpaceMouse, ButtonsAndDamage) {
  MouseRig rig;
  ASSERT_TRUE(rig.device->open());
  rig.wire.give(TestBytes{3, 2, 0});
  EXPECT_EQ(rig.frames(1).buttons, 2u);
  rig.wire.give(TestBytes{3, 0, 0});
  EXPECT_EQ(rig.frames(1).buttons, 0u);
  rig.wire.give(axes_report(350, 0, 0));
  rig.frames(1);
  for (int i = 0; i < 3; ++i) rig.wire.give(TestBytes{1, 2, 3});
  const DeviceState garbled = rig.frames(1);
  EXPECT_EQ(garbled.status, ReadStatus::kGarbled);
  EXPECT_EQ(rig.frames(10).position_mm, garbled.position_mm);
  rig.device->close();
  EXPECT_EQ(rig.wire.sent.back(), (TestBytes{4, 0}));
}

TEST(SpaceMouse, ItPassesTheGovernorAndSendsNoForce) {
  MouseRig rig;
  ASSERT_TRUE(rig.device->open());
  auto governor = ForceGovernor::create(rig.device->limits(), {});
  ASSERT_TRUE(governor) << governor.error().message();
  governor->arm(rig.clock.now_s());
  const std::size_t sent = rig.wire.sent.size();
  for (int i = 0; i < 1000; ++i) {
    if (i % 16 == 0) rig.wire.give(axes_report(i % 700 - 350, 350, -350));
    const DeviceState state = rig.frames(1);
    rig.device->send(governor->govern(rig.clock.now_s(), state, Vec3(0, 0, 1)));
    ASSERT_EQ(governor->fault(), Fault::kNone) << i;
  }
  EXPECT_EQ(rig.wire.sent.size(), sent);
}

TEST(SpaceMouseDriver, SaysWhatIsMissing) {
  const Driver driver = driver_of(&register_spacemouse_driver, "spacemouse");
  EXPECT_GE(driver.look().size(), 1u);
  const MonotonicClock clock;
  const auto refused = [&](const DeviceRequest& request) { return refusal_of(driver, request); };
  EXPECT_TRUE(says(refused({"spacemouse", {}, {{"path", "/dev/none"}}}), "no 3Dconnexion"));
  EXPECT_TRUE(says(refused({"spacemouse", {}, {{"curv", "2"}}}), "did you mean 'curve'"));
  EXPECT_TRUE(says(refused({"spacemouse", {}, {{"curve", "0.5"}}}), "curve"));
  EXPECT_TRUE(says(refused({"spacemouse", {}, {{"dead_zone", "1"}}}), "dead_zone"));
  EXPECT_TRUE(says(refused({"spacemouse:x", {}, {}}), "takes no name"));
}

}  // namespace
}  // namespace palpate::device
