// Drivers over the real hidapi and libudev, with devices pretended by umockdev. Run under umockdev-wrapper.
// --faults RUNS FILE.json: the fault table of docs/results/hands-and-loops.md, in real time.
// --soak=SECONDS: only measures round trips at 1 kHz, over hidraw and over a pseudo-terminal, as JSON.
#include "device/links/hid_link.h"

#include <array>
#include <cstdio>
#include <cstdlib>

#include "device/arms/arm_device.h"
#include "device/links/tty_link.h"
#include "device/spacemouse/spacemouse_device.h"
#include "tests/device/helpers.h"
#include "tests/device/hid_fake_link.h"
#include "tests/device/link_faults.h"
#include "tests/device/mock/hidraw_double.h"
#include "tests/device/round_trip.h"
#include "tests/device/tty_board.h"

namespace palpate::device {
namespace {

using Bytes = HidrawDouble::Bytes;

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

const HidrawIdentity kCompact = {.vendor = 0x256f,
                                 .product = 0xc635,
                                 .usage_page = 1,
                                 .usage = 8,
                                 .serial = "",
                                 .product_name = "SpaceMouse Compact",
                                 .numbered = true};

TEST(HidLink, FindsByIdUsageSerialAndPath) {
  HidrawDouble arm({}), other({.serial = "two"});
  HidrawDouble mouse(kCompact);
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
  EXPECT_TRUE(refused(both.open(), "serial two"));
  HidLink none({0x16c0, 0x0486});
  EXPECT_TRUE(says(none.open().error().message(), "there is no HID device 16c0:0486"));
  HidLink one({0x1234, 0x0006, 0, 0, "", arm.node()});
  EXPECT_TRUE(one.open());
  EXPECT_EQ(one.path(), arm.node());
  const auto entries = driver_of(&register_spacemouse_driver, "spacemouse").look();
  ASSERT_EQ(entries.size(), 1u);
  EXPECT_EQ(entries.front().status, DeviceStatus::kReady);
  EXPECT_TRUE(says(entries.front().what, "SpaceMouse Compact"));
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
    ASSERT_TRUE(comes([&] { return (size = link.poll(into).size) > 0; })) << int{i};
    ASSERT_EQ(size, 3u);
    ASSERT_EQ(into[0], i);
  }
  EXPECT_EQ(board.written().front(), (Bytes{0, 0, 2, 3})) << "hidapi takes a 0 before each";
  EXPECT_EQ(link.counters().written, 50u);
  EXPECT_EQ(link.counters().received, 50u);
  board.report({9, 9});
  board.report({8});
  ASSERT_TRUE(comes([&] { return link.poll(into).size == 2; }));
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

TEST(HidLink, IsUnpluggedAndPluggedInAgain) {
  HidrawDouble board({}, &echo);
  HidLink link({0x1234, 0x0006});
  std::array<std::uint8_t, 65> into{};
  for (int round = 0; round < 3; ++round) {
    const auto opened = link.open();
    ASSERT_TRUE(opened) << round << ": " << opened.error().message();
    ASSERT_TRUE(link.submit(Bytes{7}));
    ASSERT_TRUE(comes([&] { return link.poll(into).size == 1; })) << round;
    board.unplug();
    ASSERT_TRUE(comes([&] { return link.poll(into).gone; })) << round;
    EXPECT_FALSE(link.submit(Bytes{7})) << round;
    EXPECT_FALSE(link.open()) << round;
    board.plug();
  }
}

TEST(HidArm, IsCalibratedByItsButtonDrivenAndLetGo) {
  Report14Board board;
  board.counts[0] = 100;
  HidrawDouble usb({}, board.answer());
  const MonotonicClock clock;
  const auto entries = driver_of(&register_arm_driver, "arm").look();
  for (const DeviceEntry& entry : entries)
    if (entry.name == "arm:polhem-v2") {
      EXPECT_EQ(entry.status, DeviceStatus::kReady);
      EXPECT_TRUE(says(entry.what, usb.node()));
    }
  auto made =
      value_of(driver_of(&register_arm_driver, "arm:polhem-v2").make({"arm:polhem-v2", {}, {}}, clock));
  Device& arm = *made.device;
  ASSERT_TRUE(ok(arm.open()));
  const auto frame = [&](const Vec3& force) {
    const DeviceState state = arm.read();
    arm.send(governed(force));
    return state;
  };
  ASSERT_FALSE(frame(Vec3::Zero()).homed);
  board.pressed = true;
  ASSERT_TRUE(comes([&] { return frame(Vec3::Zero()).homed; }));
  board.pressed = false;
  EXPECT_EQ(board.counts[0], 8327);
  EXPECT_EQ(board.counts[1], -10926);
  const auto pushes = [&] {
    frame(Vec3(0, 0, 0.5));
    return board.ma[2] != 0;
  };
  EXPECT_TRUE(comes(pushes));
  EXPECT_TRUE(arm.cut_force());
  EXPECT_TRUE(comes([&] { return board.ma[0] == 0 && board.ma[1] == 0 && board.ma[2] == 0; }));
  EXPECT_TRUE(comes(pushes));
  arm.close();
  EXPECT_EQ(board.ma[2], 0) << "closing writes zero before it ends";
  board.ma[2] = 500;  // what a program left that was killed
  EXPECT_TRUE(made.zero());
  EXPECT_EQ(board.ma[2], 0) << "the guard's way";
}

TEST(HidSpaceMouse, MovesOverTheRealLibrary) {
  HidrawDouble usb(kCompact);
  const MonotonicClock clock;
  auto made =
      value_of(driver_of(&register_spacemouse_driver, "spacemouse").make({"spacemouse", {}, {}}, clock));
  EXPECT_FALSE(made.zero) << "it has no motors";
  ASSERT_TRUE(made.device->open());
  EXPECT_TRUE(comes([&] { return !usb.written().empty(); }));
  EXPECT_EQ(usb.written().front(), (Bytes{4, 1})) << "numbered: no 0 before";
  EXPECT_TRUE(comes([&] {
    usb.report({1, 0x5E, 0x01, 0, 0, 0, 0});
    return made.device->read().position_mm.x() > 1.0;
  }));
  usb.report({3, 1, 0});
  EXPECT_TRUE(comes([&] { return made.device->read().buttons == 1; }));
  usb.unplug();
  EXPECT_TRUE(comes([&] { return made.device->read().status == ReadStatus::kLost; }));
}

/// Over an open link to a board that gives back what it is sent.
template <class EchoedLink>
RoundTrips trips_over(EchoedLink& link, double seconds) {
  if (!link.open()) std::abort();
  const RoundTrips trips =
      measure_round_trips(link, seconds, echo_protocol([&link] { return link.counters().replaced; }));
  EXPECT_EQ(trips.overtaken, link.counters().replaced) << "what was written was answered";
  return trips;
}

/// Over hidraw and over a pseudo-terminal, printed as JSON.
std::array<RoundTrips, 2> measured_trips(double seconds) {
  HidrawDouble hid({}, &echo);
  HidLink hidraw({0x1234, 0x0006});
  TtyBoard board(
      [](std::span<const std::uint8_t> bytes) { return TtyBoard::Bytes(bytes.begin(), bytes.end()); });
  TtyLink terminal({board.path()});
  const std::array<RoundTrips, 2> trips = {trips_over(hidraw, seconds), trips_over(terminal, seconds)};
  std::printf("[%s,\n %s]\n", trips[0].json("hidapi-hidraw on umockdev").c_str(),
              trips[1].json("pseudo-terminal").c_str());
  return trips;
}

// Times are printed, never asserted.
TEST(HidRoundTrips, EveryCommandThatWasWrittenIsAnswered) {
  for (const RoundTrips& trips : measured_trips(1.0)) {
    EXPECT_GT(trips.answered, 0u);
    EXPECT_EQ(trips.lost, 0u) << "what was written was answered";
    EXPECT_EQ(trips.refused, 0u);
  }
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
    if (const std::string argument = argv[i]; argument.starts_with(option)) {
      static_cast<void>(measured_trips(std::atof(argument.c_str() + option.size())));
      return 0;
    }
  return RUN_ALL_TESTS();
}
