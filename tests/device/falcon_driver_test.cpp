// The Falcon's entry in the list of drivers: what it takes, refuses and says, without any USB.
#include "device/falcon/falcon_driver.h"

#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "toolkit/core/clock.h"

namespace palpate::device {
namespace {

using Options = std::vector<std::pair<std::string, std::string>>;

Result<MadeDevice> made_falcon(const std::string& name, Options options = {},
                               const std::string& description = {}) {
  static const MonotonicClock clock;
  Drivers drivers;
  register_falcon_driver(drivers);
  return drivers.of(name)->make({name, description, std::move(options)}, clock);
}

std::string problem(const std::string& name, Options options = {}, const std::string& description = {}) {
  const auto made = made_falcon(name, std::move(options), description);
  return made ? std::string("fine") : made.error().message();
}

TEST(FalconDriver, MakesADeviceThatIsNotOpen) {
  const auto made = made_falcon("falcon");
  ASSERT_TRUE(made);
  EXPECT_EQ(made->device->name(), "falcon");
  EXPECT_EQ(made->device->limits().force_max_n, 2.0);
  EXPECT_EQ(made->device->read().status, ReadStatus::kLost);
  EXPECT_FALSE(made->device->cut_force());
  EXPECT_TRUE(made->zero);
  EXPECT_GE(made->unproven.size(), 4u);
}

TEST(FalconDriver, CalibratedItIsStrongerAndDoubtsLess) {
  const auto made = made_falcon(
      "falcon:A7", {{"k", "3.6"}, {"calibrated", "yes"}, {"event-character", "off"}, {"firmware", "f.bin"}});
  ASSERT_TRUE(made) << made.error().message();
  EXPECT_EQ(made->device->limits().force_max_n, 8.0);
  EXPECT_EQ(made->unproven.size(), 3u);
  EXPECT_EQ(made_falcon("falcon", {{"event-character", "on"}})->unproven.size(), 5u);
}

TEST(FalconDriver, SaysWhatIsNotRight) {
  const auto holds = [](const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
  };
  EXPECT_TRUE(holds(problem("falcon", {{"colour", "red"}}), "no option colour"));
  for (const std::string k : {"0.5", "101", "ten", "nan", ""})
    EXPECT_TRUE(holds(problem("falcon", {{"k", k}}), "k: ")) << k;
  EXPECT_TRUE(holds(problem("falcon", {{"calibrated", "perhaps"}}), "calibrated=yes"));
  EXPECT_TRUE(holds(problem("falcon", {{"calibrated", "yes"}}), "give k=COUNTS too"));
  EXPECT_TRUE(holds(problem("falcon", {{"firmware", ""}}), "firmware=FILE"));
  EXPECT_TRUE(holds(problem("falcon:"), "serial"));
  EXPECT_TRUE(holds(problem("falcon", {}, "arm.toml"), "takes no description"));
}

TEST(FalconDriver, IsListedWhetherOneIsThereOrNot) {
  Drivers drivers;
  register_falcon_driver(drivers);
  const std::vector<DeviceEntry> found = drivers.all()[0].look();
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found[0].name, "falcon");
  EXPECT_TRUE(found[0].status == DeviceStatus::kReady || !found[0].needs.empty());
}

}  // namespace
}  // namespace palpate::device
