// Plug-ins over pretended libraries of their makers. Nothing is asked to happen within a time of its own.
#include "device/plugins/plugin_host.h"

#include <cstdlib>
#include <optional>

#include <palpate/device/force_governor.h>
#include "device/plugins/plugin_exchange.h"
#include "tests/device/helpers.h"
#include "tests/device/stubs/stub_device.h"
#include "tests/files.h"

namespace palpate::device {
namespace {

class Plugins : public InFolder {
 protected:
  DeviceEntry entry(const std::string& name) const {
    return driver_of(&register_plugin_drivers, name).look().front();
  }
  Result<MadeDevice> make(const DeviceRequest& request) const {
    return driver_of(&register_plugin_drivers, request.name).make(request, clock_);
  }
  /// Frames with this force wanted until `seen`.
  template <class Condition>
  bool felt_until(Device& device, const Vec3& wanted_n, const Condition& seen) {
    return comes([&] {
      last_ = device.read();
      device.send(governor_->govern(clock_.now_s(), last_, wanted_n));
      return seen();
    });
  }
  void arm(Device& device) {
    governor_.emplace(ForceGovernor::create(device.limits(), patient_governor()).value());
    governor_->arm(clock_.now_s());
  }
  /// What every plug-in has to do, with the device that stands behind it.
  void check_device(const std::string& name, StubDevice& stub) {
    stub.x_mm = 3.0;
    stub.z_mm = -7.0;
    stub.buttons = 2;
    auto made = value_of(make({name, {}, {}}));
    Device& device = *made.device;
    EXPECT_FALSE(device.cut_force()) << "not open";
    ASSERT_TRUE(ok(device.open()));
    EXPECT_TRUE(stub.force_on.load());
    arm(device);
    EXPECT_TRUE(felt_until(device, Vec3{0.25, 0, -0.5}, [&] {
      return std::abs(stub.force_x_n - 0.25) < 1e-4 && std::abs(stub.force_z_n + 0.5) < 1e-4;
    }));
    EXPECT_TRUE(felt_until(device, Vec3::Zero(), [&] { return last_.status == ReadStatus::kFresh; }));
    EXPECT_NEAR(last_.position_mm.x(), 3.0, 1e-9);
    EXPECT_NEAR(last_.position_mm.z(), -7.0, 1e-9);
    EXPECT_EQ(last_.buttons, 2u);
    EXPECT_FALSE(made.facts().empty());
    const auto feel = [&] {
      return felt_until(device, Vec3{0.25, 0, 0}, [&] { return stub.force_x_n > 0.2; });
    };
    const auto is_zero_command = [&] { return comes([&] { return stub.force_x_n == 0.0; }); };
    EXPECT_TRUE(feel());
    EXPECT_TRUE(device.cut_force());
    EXPECT_TRUE(is_zero_command()) << "cut from anywhere";
    EXPECT_TRUE(feel());
    EXPECT_TRUE(is_zero_command()) << "a servo that is gone: the plug-in's own limit";
    EXPECT_TRUE(feel());
    device.close();
    EXPECT_TRUE(is_zero_command()) << "closed";
    EXPECT_TRUE(device.cut_force()) << "also after close";
    EXPECT_EQ(device.read().status, ReadStatus::kLost);
    ASSERT_TRUE(device.open()) << "again";
    arm(device);
    EXPECT_TRUE(feel());
    stub.fails = true;
    EXPECT_TRUE(felt_until(device, Vec3::Zero(), [&] { return last_.status == ReadStatus::kLost; }));
    stub.fails = false;
    made.device.reset();
    EXPECT_EQ(stub.open.load(), 0);
    EXPECT_TRUE(is_zero_command());
    EXPECT_TRUE(made.zero()) << "a guard's handle of its own";
    EXPECT_EQ(stub.open.load(), 0);
  }

  const Environment plugins_{"PALPATE_PLUGINS", PALPATE_STUB_PLUGINS};
  const Environment touch_{"GTDD_HOME", PALPATE_STUB_PLUGINS};
  MonotonicClock clock_;
  std::optional<ForceGovernor> governor_;
  DeviceState last_;
};

TEST_F(Plugins, DhdIsFeltAndLetGo) {
  EXPECT_EQ(entry("dhd").status, DeviceStatus::kReady);
  check_device("dhd", stub_dhd_device());
}

TEST_F(Plugins, OpenHapticsIsFeltAndLetGo) {
  EXPECT_EQ(entry("openhaptics").status, DeviceStatus::kReady);
  check_device("openhaptics", stub_hd_device());
}

TEST_F(Plugins, OneThatIsNotCalibratedIsNotHomed) {
  stub_hd_device().calibrated = false;
  auto made = value_of(make({"openhaptics", {}, {}}));
  ASSERT_TRUE(made.device->open());
  arm(*made.device);
  EXPECT_TRUE(felt_until(*made.device, Vec3{0.3, 0, 0}, [&] { return last_.status == ReadStatus::kFresh; }));
  EXPECT_FALSE(last_.homed);
  EXPECT_EQ(stub_hd_device().force_x_n, 0.0);
  stub_hd_device().calibrated = true;
  EXPECT_TRUE(felt_until(*made.device, Vec3::Zero(), [&] { return last_.homed; }));
}

TEST_F(Plugins, WhatIsNotConnectedIsSaid) {
  stub_dhd_device().connected = 0;
  EXPECT_EQ(entry("dhd").status, DeviceStatus::kMissing);
  EXPECT_TRUE(says(entry("dhd").needs.front(), "connected"));
  Result<MadeDevice> made = make({"dhd", {}, {}});
  ASSERT_TRUE(made);
  EXPECT_TRUE(refused(made->device->open(), "no device found"));
  stub_dhd_device().connected = 1;
  stub_hd_device().connected = 0;
  made = make({"openhaptics", {}, {}});
  ASSERT_TRUE(made);
  EXPECT_FALSE(made->device->open());
  stub_hd_device().connected = 1;
  const Environment none("GTDD_HOME", nullptr);
  EXPECT_TRUE(says(entry("openhaptics").needs.front(), "GTDD_HOME"));
}

TEST_F(Plugins, OneThatIsNotThereSaysHowToGetIt) {
  const Environment elsewhere("PALPATE_PLUGINS", folder_.c_str());
  for (const auto& [name, said] : {std::pair{"dhd", "DHD_ROOT"}, {"openhaptics", "OH_SDK_BASE"}}) {
    const DeviceEntry found = entry(name);
    EXPECT_EQ(found.status, DeviceStatus::kMissing);
    ASSERT_EQ(found.needs.size(), 1u);
    EXPECT_TRUE(says(found.needs.front(), said));
    EXPECT_TRUE(refused(make({name, {}, {}}), said));
  }
}

TEST_F(Plugins, WhatIsNoPluginIsNotUsed) {
  const Environment elsewhere("PALPATE_PLUGINS", folder_.c_str());
  write_text(in("palpate-dhd.so"), "not a module");
  EXPECT_TRUE(says(entry("dhd").needs.front(), "cannot be loaded"));
  std::filesystem::remove(folder_ / "palpate-dhd.so");
  for (const char* module : {PALPATE_STUB_OLD, PALPATE_STUB_HALF}) {
    std::filesystem::create_symlink(module, folder_ / "palpate-dhd.so");
    EXPECT_TRUE(says(entry("dhd").needs.front(), "no plug-in of this version")) << module;
    std::filesystem::remove(folder_ / "palpate-dhd.so");
  }
  // Somebody's own, of another name, is listed too.
  std::filesystem::create_symlink(PALPATE_STUB_OLD, folder_ / "palpate-own.so");
  EXPECT_EQ(entry("own").status, DeviceStatus::kMissing);
}

TEST_F(Plugins, RequestsThatMeanNothingAreRefused) {
  EXPECT_FALSE(make({"dhd:x", {}, {}}));
  EXPECT_FALSE(make({"dhd:99", {}, {}}));
  EXPECT_FALSE(make({"dhd", "file.toml", {}}));
  EXPECT_FALSE(make({"dhd", {}, {{"gain", "1"}}}));
}

TEST(PluginExchange, AStateIsFreshOnceAndAForceIsHeldForAWhileOnly) {
  PluginExchange exchange;
  palpate_plugin_state state{};
  exchange.read(state);
  EXPECT_EQ(state.status, 1u) << "nothing yet";
  exchange.state({{1, 2, 3}, 0, 0, 1, 4, 0});
  exchange.read(state);
  EXPECT_EQ(state.status, 0u);
  EXPECT_EQ(state.position_mm[2], 3.0);
  exchange.read(state);
  EXPECT_EQ(state.status, 1u);
  EXPECT_TRUE(exchange.force().isZero(0.0)) << "never sent";
  const double force_n[3] = {1.0, 0.0, -2.0};
  exchange.send(force_n);
  exchange.zero();
  EXPECT_TRUE(exchange.force().isZero(0.0));
  EXPECT_TRUE(comes([&] {
    exchange.send(force_n);
    return (exchange.force() - Vec3{1, 0, -2}).norm() < 1e-4;
  }));
  EXPECT_TRUE(comes([&] { return exchange.force().isZero(0.0); })) << "nobody sends any more";
}

}  // namespace
}  // namespace palpate::device
