// Drivers over the real hidapi and libudev, with devices pretended by umockdev. Run under umockdev-wrapper.
// --faults RUNS FILE.json: the fault table of docs/safety.md, in real time.
// --soak=SECONDS: only measures round trips at 1 kHz, over hidraw and over a pseudo-terminal, as JSON.
#include "device/links/hid_link.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include "device/arms/arm_device.h"
#include "device/arms/arm_driver.h"
#include "device/links/tty_link.h"
#include "device/spacemouse/spacemouse_driver.h"
#include "tests/device/hid_fake_link.h"
#include "tests/device/hid_faults.h"
#include "tests/device/hid_round_trip.h"
#include "tests/device/link_faults.h"
#include "tests/device/mock/hidraw_double.h"
#include "tests/device/tty_board.h"

namespace palpate::device {
namespace {

using Bytes = HidrawDouble::Bytes;

// Not a deadline: after so long a test says that it failed instead of hanging.
constexpr int kHidPatienceMs = 30'000;

template <class Condition>
bool becomes_true(const Condition& condition) {
  for (int ms = 0; ms < kHidPatienceMs; ++ms) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

/// Gives back what is written, without the 0 before it.
std::optional<Bytes> echo(std::span<const std::uint8_t> bytes) {
  return Bytes(bytes.begin() + 1, bytes.end());
}

/// Polhem's board: one report for each command; counters that can be set.
class Report14Board {
 public:
  HidrawDouble::Answer answer() {
    return [this](std::span<const std::uint8_t> bytes) -> std::optional<Bytes> {
      if (bytes.size() != 15 || bytes[0] != 0) return std::nullopt;
      const Bytes command(bytes.begin() + 1, bytes.end());
      if (word_of(command, 3) == 1)
        for (std::size_t i = 0; i < 3; ++i) counts[i] = word_of(command, 4 + i);
      else
        for (std::size_t i = 0; i < 3; ++i) ma[i] = word_of(command, i);
      return words({counts[0], counts[1], counts[2], 0, 0, 0, pressed.load() ? 1 : 0});
    };
  }
  std::array<std::atomic<int>, 3> counts{};
  std::array<std::atomic<int>, 3> ma{};
  std::atomic<bool> pressed{false};
};

TEST(HidLink, FindsByIdUsageSerialAndPath) {
  HidrawDouble arm({}), other({.serial = "two"});
  HidrawDouble mouse({.vendor = 0x256f,
                      .product = 0xc635,
                      .usage_page = 1,
                      .usage = 8,
                      .serial = "",
                      .product_name = "SpaceMouse Compact",
                      .numbered = true});
  HidrawDouble keyboard({.vendor = 0x256f, .product = 0xc664, .usage_page = 1, .usage = 6, .serial = ""});
  EXPECT_EQ(hid_devices().size(), 4u);
  EXPECT_EQ(hid_devices({0x1234, 0x0006}).size(), 2u);
  EXPECT_EQ(hid_devices({0x1234, 0x0006, 0xFFAB, 0x0201}).size(), 0u);
  const auto second = hid_devices({0x1234, 0x0006, 0xFFAB, 0x0200, "two"});
  ASSERT_EQ(second.size(), 1u);
  EXPECT_EQ(second.front().path, other.node());
  EXPECT_EQ(second.front().usage_page, 0xFFAB);
  EXPECT_EQ(second.front().maker, "Palpate");
  EXPECT_TRUE(second.front().allowed);
  EXPECT_EQ(hid_devices({0x256f, 0, 1, 8}).size(), 1u) << "the keyboard is none";
  HidLink both({0x1234, 0x0006});
  const auto ambiguous = both.open();
  ASSERT_FALSE(ambiguous);
  EXPECT_NE(ambiguous.error().message().find("serial two"), std::string::npos) << ambiguous.error().message();
  HidLink none({0x16c0, 0x0486});
  EXPECT_NE(none.open().error().message().find("there is no HID device 16c0:0486"), std::string::npos);
  HidLink one({0x1234, 0x0006, 0, 0, "", arm.node()});
  EXPECT_TRUE(one.open());
  EXPECT_EQ(one.path(), arm.node());
  Drivers drivers;
  register_spacemouse_driver(drivers);
  const auto entries = drivers.of("spacemouse")->look();
  ASSERT_EQ(entries.size(), 1u);
  EXPECT_EQ(entries.front().status, DeviceStatus::kReady);
  EXPECT_NE(entries.front().what.find("SpaceMouse Compact"), std::string::npos);
}

TEST(HidLink, CarriesReports) {
  HidrawDouble board({}, &echo);
  HidLink link({0x1234, 0x0006});
  std::array<std::uint8_t, 65> into{};
  EXPECT_FALSE(link.submit(Bytes{1}));
  EXPECT_TRUE(link.poll(into).gone);
  ASSERT_TRUE(link.open());
  EXPECT_EQ(link.poll(into).size, 0u) << "never waits";
  EXPECT_FALSE(link.poll(into).gone);
  EXPECT_FALSE(link.submit({}));
  EXPECT_FALSE(link.submit(Bytes(65))) << "64 and the number";
  for (std::uint8_t i = 0; i < 50; ++i) {
    ASSERT_TRUE(link.submit(Bytes{i, 2, 3}));
    std::size_t size = 0;
    ASSERT_TRUE(becomes_true([&] { return (size = link.poll(into).size) > 0; })) << int{i};
    ASSERT_EQ(size, 3u);
    ASSERT_EQ(into[0], i);
  }
  EXPECT_EQ(board.written().front(), (Bytes{0, 0, 2, 3})) << "hidapi takes a 0 before each";
  EXPECT_EQ(link.counters().written, 50u);
  EXPECT_EQ(link.counters().received, 50u);
  board.report({9, 9});
  board.report({8});
  ASSERT_TRUE(becomes_true([&] { return link.poll(into).size == 2; }));
  EXPECT_EQ(link.poll(into).size, 1u) << "one report a poll";
}

TEST(HidLink, WhatWasSubmittedLastIsWrittenBeforeItCloses) {
  HidrawDouble board({});
  for (int round = 0; round < 20; ++round) {
    HidLink link({0x1234, 0x0006});
    ASSERT_TRUE(link.open());
    for (std::uint8_t i = 0; i < 10; ++i) link.submit(Bytes{i, 1});
    link.submit(Bytes{0xEE, static_cast<std::uint8_t>(round)});
    link.close();
    EXPECT_EQ(board.written().back(), (Bytes{0, 0xEE, static_cast<std::uint8_t>(round)}));
    EXPECT_FALSE(link.submit(Bytes{1}));
  }
}

TEST(HidLink, UnpluggedAndPluggedInAgainTenTimes) {
  HidrawDouble board({}, &echo);
  HidLink link({0x1234, 0x0006});
  std::array<std::uint8_t, 65> into{};
  for (int round = 0; round < 10; ++round) {
    const auto opened = link.open();
    ASSERT_TRUE(opened) << round << ": " << opened.error().message();
    ASSERT_TRUE(link.submit(Bytes{7}));
    ASSERT_TRUE(becomes_true([&] { return link.poll(into).size == 1; })) << round;
    board.unplug();
    ASSERT_TRUE(becomes_true([&] { return link.poll(into).gone; })) << round;
    EXPECT_FALSE(link.submit(Bytes{7})) << round;
    EXPECT_FALSE(link.open()) << round;
    board.plug();
  }
}

TEST(HidArm, IsCalibratedByItsButtonDrivenUnpluggedAndFoundAgain) {
  Report14Board board;
  board.counts[0] = 100;
  HidrawDouble usb({}, board.answer());
  Drivers drivers;
  register_arm_driver(drivers);
  const MonotonicClock clock;
  const auto entries = drivers.of("arm")->look();
  for (const DeviceEntry& entry : entries)
    if (entry.name == "arm:polhem-v2") {
      EXPECT_EQ(entry.status, DeviceStatus::kReady);
      EXPECT_NE(entry.what.find(usb.node()), std::string::npos);
    }
  auto made = drivers.of("arm:polhem-v2")->make({"arm:polhem-v2", {}, {}}, clock);
  ASSERT_TRUE(made);
  Device& arm = *made->device;
  const auto opened = arm.open();
  ASSERT_TRUE(opened) << opened.error().message();
  const auto frame = [&](const Vec3& force) {
    const DeviceState state = arm.read();
    arm.send(governed(force));
    return state;
  };
  ASSERT_FALSE(frame(Vec3::Zero()).homed);
  board.pressed = true;
  ASSERT_TRUE(becomes_true([&] { return frame(Vec3::Zero()).homed; }));
  board.pressed = false;
  EXPECT_EQ(board.counts[0], 8327);
  EXPECT_EQ(board.counts[1], -10926);
  EXPECT_TRUE(becomes_true([&] {
    frame(Vec3(0, 0, 0.5));
    return board.ma[2] != 0;
  }));
  EXPECT_TRUE(arm.cut_force());
  EXPECT_TRUE(becomes_true([&] { return board.ma[0] == 0 && board.ma[1] == 0 && board.ma[2] == 0; }));
  EXPECT_TRUE(becomes_true([&] {
    frame(Vec3(0, 0, 0.5));
    return board.ma[2] != 0;
  }));
  arm.close();
  EXPECT_EQ(board.ma[2], 0) << "closing writes zero before it ends";
  board.ma[2] = 500;  // what a program left that was killed
  EXPECT_TRUE(made->zero());
  EXPECT_EQ(board.ma[2], 0) << "the guard's way";
  for (int round = 0; round < 10; ++round) {
    ASSERT_TRUE(arm.open()) << round;
    usb.unplug();
    ASSERT_TRUE(becomes_true([&] { return frame(Vec3::Zero()).status == ReadStatus::kLost; })) << round;
    usb.plug();
  }
}

TEST(HidArm, SilenceAndShortReportsOverTheRealLibrary) {
  HidrawDouble usb({});
  ArmDescription described = find_arm("woodenhaptics").value();
  const MonotonicClock clock;
  ArmDevice arm(described, arm_link(described), clock, {10});
  const auto silent = arm.open();
  ASSERT_FALSE(silent);
  EXPECT_NE(silent.error().message().find("silent"), std::string::npos);
  usb.report(words({0, 0, 0, 1}));
  std::atomic<bool> ending{false};
  // It sends unasked; a reader that has just come sees none of the past.
  std::thread sender([&] {
    for (int i = 2; !ending; ++i) {
      usb.report(words({0, 0, 0, i}));
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  ArmDevice speaking(described, arm_link(described), clock, {1000});
  EXPECT_TRUE(speaking.open());
  EXPECT_TRUE(becomes_true([&] { return speaking.read().homed; })) << "lies still";
  ending = true;
  sender.join();
  for (int i = 0; i < 3; ++i) usb.report(Bytes(5));
  EXPECT_TRUE(becomes_true([&] { return speaking.read().status == ReadStatus::kGarbled; }));
  speaking.close();
  EXPECT_EQ(usb.written().back(), (Bytes{0, 0, 0, 0, 0, 0, 0, 0, 0}));
}

TEST(HidSpaceMouse, MovesOverTheRealLibrary) {
  HidrawDouble usb({.vendor = 0x256f,
                    .product = 0xc635,
                    .usage_page = 1,
                    .usage = 8,
                    .serial = "",
                    .product_name = "SpaceMouse Compact",
                    .numbered = true});
  Drivers drivers;
  register_spacemouse_driver(drivers);
  const MonotonicClock clock;
  auto made = drivers.of("spacemouse")->make({"spacemouse", {}, {}}, clock);
  ASSERT_TRUE(made) << made.error().message();
  EXPECT_FALSE(made->zero) << "it has no motors";
  ASSERT_TRUE(made->device->open());
  EXPECT_TRUE(becomes_true([&] { return !usb.written().empty(); }));
  EXPECT_EQ(usb.written().front(), (Bytes{4, 1})) << "numbered: no 0 before";
  EXPECT_TRUE(becomes_true([&] {
    usb.report({1, 0x5E, 0x01, 0, 0, 0, 0});
    return made->device->read().position_mm.x() > 1.0;
  }));
  usb.report({3, 1, 0});
  EXPECT_TRUE(becomes_true([&] { return made->device->read().buttons == 1; }));
  usb.unplug();
  EXPECT_TRUE(becomes_true([&] { return made->device->read().status == ReadStatus::kLost; }));
}

LinkTrips trips_over_hidraw(double seconds) {
  HidrawDouble board({}, &echo);
  HidLink link({0x1234, 0x0006});
  if (!link.open()) std::abort();
  return measure_link_trips(link, seconds, [&link] { return link.counters().replaced; });
}

LinkTrips trips_over_terminal(double seconds) {
  TtyBoard board(
      [](std::span<const std::uint8_t> bytes) { return TtyBoard::Bytes(bytes.begin(), bytes.end()); });
  TtyLink link({board.path()});
  if (!link.open()) std::abort();
  return measure_link_trips(link, seconds, [&link] { return link.counters().replaced; });
}

// Times are printed, never asserted.
TEST(HidRoundTrips, EveryCommandThatWasWrittenIsAnswered) {
  const LinkTrips hidraw = trips_over_hidraw(1.0), terminal = trips_over_terminal(1.0);
  std::printf("%s\n%s\n", hidraw.json("hidapi-hidraw on umockdev").c_str(),
              terminal.json("pseudo-terminal").c_str());
  EXPECT_GT(hidraw.answered, 0u);
  EXPECT_GT(terminal.answered, 0u);
  EXPECT_EQ(hidraw.lost, hidraw.replaced) << "what was written was answered";
  EXPECT_EQ(terminal.lost, terminal.replaced);
  EXPECT_EQ(hidraw.refused, 0u);
  EXPECT_EQ(terminal.refused, 0u);
}

int soak(double seconds) {
  const LinkTrips hidraw = trips_over_hidraw(seconds), terminal = trips_over_terminal(seconds);
  std::printf("[%s,\n %s]\n", hidraw.json("hidapi-hidraw on umockdev").c_str(),
              terminal.json("pseudo-terminal").c_str());
  return 0;
}

}  // namespace
}  // namespace palpate::device

int main(int argc, char** argv) {
  using namespace palpate::device;
  if (argc > 1 && std::string(argv[1]) == kPressArgument)
    press_until_killed(std::vector<std::string>(argv + 2, argv + argc));
  if (!palpate::device::HidrawDouble::possible()) {
    std::puts("skipped: run under umockdev-wrapper: drivers were not run over the real hidapi");
    constexpr int kSkipped = 77;  // what CTest takes for a skipped test
    return kSkipped;
  }
  if (argc > 1 && std::string(argv[1]) == "--faults") return measured_faults(argc, argv, measure_hid_faults);
  testing::InitGoogleTest(&argc, argv);
  const std::string option = "--soak=";
  for (int i = 1; i < argc; ++i)
    if (const std::string argument = argv[i]; argument.starts_with(option))
      return palpate::device::soak(std::atof(argument.c_str() + option.size()));
  return RUN_ALL_TESTS();
}
