// The Falcon's driver over the real libusb, with a pretended Falcon below it: run by umockdev-wrapper. What
// is asserted is what happens, never how soon.
//
//   umockdev-wrapper test_usb --measure 60     round trips at 1 kHz for so many seconds, as JSON; with
//   SCHED_FIFO
//                                              where that is allowed
//   umockdev-wrapper test_usb --faults RUNS FILE.json     the fault table of docs/safety.md, in real time
#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "device/falcon/falcon_device.h"
#include "device/falcon/falcon_driver.h"
#include "device/links/usb_link.h"
#include "device/safety/guard.h"
#include "device/servo/servo.h"
#include "tests/device/link_faults.h"
#include "tests/device/mock/usbfs_double.h"
#include "tests/device/rig.h"
#include "tests/device/usb_faults.h"
#include "tests/device/usb_round_trip.h"
#include "tests/house/allocation_count.h"
#include "toolkit/core/at_stop.h"
#include "toolkit/core/clock.h"

namespace palpate::device {
namespace {

constexpr double kPatienceS = 30.0;  // of a busy machine
constexpr timespec kMillisecond{0, 1'000'000};
const UsbAddress kAddress{0x0403, 0xCB48, ""};

template <class Condition>
bool comes(const Condition& condition) {
  const Stopwatch watch;
  while (!condition()) {
    if (watch.ms() > 1e3 * kPatienceS) return false;
    ::nanosleep(&kMillisecond, nullptr);
  }
  return true;
}

std::unique_ptr<UsbLink> falcon_link() {
  return std::make_unique<UsbLink>(kAddress, UsbInterface{}, "falcon", falcon_lets_go, 0);
}

std::array<int, 3> pose_counts(const Vec3& device_mm) {
  const Vec3 counts =
      falcon_counts_of_angles(falcon_angles(device_mm + Vec3{0.0, 0.0, kFalconCentreMm}).value());
  std::array<int, 3> rounded{};
  for (std::size_t leg = 0; leg < 3; ++leg)
    rounded[leg] = static_cast<int>(std::lround(counts[static_cast<Eigen::Index>(leg)]));
  return rounded;
}

std::vector<std::uint8_t> garbled_reply() {
  FalconBytes bytes = encoded(FalconReply{});
  bytes[7] = 'z';  // no letter of a number
  return {bytes.begin(), bytes.end()};
}

/// Nothing of the governor's is to end what a busy machine delays.
GovernorOptions patient() {
  GovernorOptions options;
  options.soft_start_s = 0.02;
  options.late_zero_s = options.latch_late_s = options.silence_s = kPatienceS;
  options.jump_mm_per_s = 1e6;
  return options;
}

/// The driver's process in the tests of its death: presses until it is killed.
[[noreturn]] void press_over_usb(bool guarded) {
  const MonotonicClock clock;
  Drivers drivers;
  register_falcon_driver(drivers);
  Result<MadeDevice> made = drivers.of("falcon")->make({"falcon", {}, {}}, clock);
  if (!made) ::_exit(3);
  std::unique_ptr<Guard> guard;
  if (guarded) {
    Result<Guard> started = Guard::start(made->zero);
    if (!started) ::_exit(4);
    guard = std::make_unique<Guard>(std::move(started).value());
  }
  FalconDevice device(falcon_link(), clock, {});
  SpringPlane plane(0.5);
  Servo servo(plane, patient(), device, clock, {});
  if (const Status started = servo.start(); !started) {
    fmt::print(stderr, "{}\n", started.error().message());
    ::_exit(5);
  }
  for (;;) {
    static_cast<void>(servo.tick());
    ::nanosleep(&kMillisecond, nullptr);
  }
}

/// A program that presses and is told to stop: Ctrl-C.
[[noreturn]] void press_and_stop() {
  // Before any thread begins: one that does not block it would die of a signal that comes before sigwait().
  sigset_t stop;
  ::sigemptyset(&stop);
  ::sigaddset(&stop, SIGTERM);
  ::pthread_sigmask(SIG_BLOCK, &stop, nullptr);
  const MonotonicClock clock;
  FalconDevice device(falcon_link(), clock, {});
  SpringPlane plane(0.5);
  Servo servo(plane, patient(), device, clock, {});
  if (!servo.start()) ::_exit(5);
  std::thread([&] {
    for (;;) {
      static_cast<void>(servo.tick());
      ::nanosleep(&kMillisecond, nullptr);
    }
  }).detach();
  int number = 0;
  ::sigwait(&stop, &number);
  static_cast<void>(run_stop_actions());
  ::_exit(0);
}

/// As a user who may not: 0 where it is said what helps.
[[noreturn]] void be_refused() {
  constexpr unsigned kNobody = 65534;
  if (::geteuid() == 0 && (::setgid(kNobody) != 0 || ::setuid(kNobody) != 0)) ::_exit(5);
  Drivers drivers;
  register_falcon_driver(drivers);
  const DeviceEntry entry = drivers.all()[0].look().at(0);
  const std::string rule = usb_udev_rule(kAddress.vendor, kAddress.product);
  if (entry.status != DeviceStatus::kRefused || entry.needs.at(0).find(rule) == std::string::npos) ::_exit(6);
  const Status opened = falcon_link()->open();
  if (opened || opened.error().remedy.find(rule) == std::string::npos) ::_exit(7);
  ::_exit(0);
}

class UsbFalcon : public testing::Test {
 protected:
  void SetUp() override {
    board.run_firmware();
    board.home(pose_counts(Vec3{0, 0, -2}));
    usb = std::make_unique<UsbfsDouble>(board);
  }
  /// Of the board, which another thread works on.
  template <class Read>
  auto seen(const Read& read) {
    decltype(read(board)) value{};
    usb->with([&](FalconBoard& now) { value = read(now); });
    return value;
  }
  bool holds_force() {
    return seen([](const FalconBoard& now) { return now.holds_force(); });
  }

  FalconBoard board;
  std::unique_ptr<UsbfsDouble> usb;
  MonotonicClock clock;
};

TEST_F(UsbFalcon, IsFoundAndListed) {
  ASSERT_EQ(usb_devices(0x0403, 0xCB48).size(), 1u);
  EXPECT_TRUE(usb_devices(0x0403, 0xCB48)[0].may_open);
  EXPECT_TRUE(usb_devices(0x0403, 0x6001).empty());
  Drivers drivers;
  register_falcon_driver(drivers);
  EXPECT_EQ(drivers.all()[0].look().at(0).status, DeviceStatus::kReady);
  usb->unplug();
  EXPECT_TRUE(usb_devices(0x0403, 0xCB48).empty());
  const DeviceEntry missing = drivers.all()[0].look().at(0);
  EXPECT_EQ(missing.status, DeviceStatus::kMissing);
  EXPECT_FALSE(missing.needs.empty());
  const Status opened = falcon_link()->open();
  ASSERT_FALSE(opened);
  EXPECT_NE(opened.error().message().find("0403:cb48"), std::string::npos) << opened.error().message();
}

TEST_F(UsbFalcon, AUserWhoMayNotOpenItIsToldTheRule) {
  EXPECT_EQ(
      usb_udev_rule(0x0403, 0xCB48),
      R"(SUBSYSTEM=="usb", ATTR{idVendor}=="0403", ATTR{idProduct}=="cb48", MODE="0660", TAG+="uaccess")");
  usb->forbid();
  const pid_t child = ::fork();
  if (child == 0) {
    ::execl("/proc/self/exe", "test_usb", "--be-refused", static_cast<char*>(nullptr));
    ::_exit(9);
  }
  int status = -1;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(WIFEXITED(status) ? WEXITSTATUS(status) : -1, 0);
}

TEST_F(UsbFalcon, LoadsFirmwareFromAFileAndReads) {
  usb->with([](FalconBoard& now) { now.power_cycle(); });
  const std::string path = testing::TempDir() + "palpate_falcon_" + std::to_string(::getpid()) + ".bin";
  const std::vector<std::uint8_t> image = made_up_image(2, 150);
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(image.data()), static_cast<std::streamsize>(image.size()));
  FalconOptions options;
  options.firmware = [&] { return read_falcon_firmware(path); };
  FalconDevice device(falcon_link(), clock, options);
  const Status opened = device.open();
  ::unlink(path.c_str());
  ASSERT_TRUE(opened) << opened.error().message();
  EXPECT_FALSE(device.booted().was_running);
  EXPECT_EQ(seen([](const FalconBoard& now) { return now.loaded(); }), image);
  usb->with([](FalconBoard& now) { now.home(pose_counts(Vec3{10, -5, 20})), now.buttons = 4; });
  DeviceState state;
  ASSERT_TRUE(comes([&] {
    device.cut_force();
    state = device.read();
    return state.homed;
  }));
  EXPECT_LT((state.position_mm - Vec3(10, -5, 20)).norm(), 0.06);
  EXPECT_EQ(state.buttons, 4u);
  EXPECT_EQ(seen([](const FalconBoard& now) { return now.refused(); }), 0u);
}

// For the report that a first user sends back.
TEST_F(UsbFalcon, ItsFactsTellFirmwareCalibrationAndWhatTheCableCarried) {
  Drivers drivers;
  register_falcon_driver(drivers);
  const auto made = drivers.of("falcon")->make({"falcon", {}, {{"k", "12.5"}, {"calibrated", "yes"}}}, clock);
  ASSERT_TRUE(made) << made.error().message();
  ASSERT_TRUE(made->device->open());
  usb->with([](FalconBoard& now) {
    now.instead = [](auto) { return std::vector<std::vector<std::uint8_t>>{garbled_reply()}; };
  });
  ASSERT_TRUE(comes([&] {
    made->device->cut_force();
    return made->device->read().status == ReadStatus::kGarbled;
  }));
  const DeviceFacts facts = made->facts();
  EXPECT_EQ(fact_of(facts, "firmware"), "ran already");
  EXPECT_EQ(fact_of(facts, "counts_per_n_mm"), "12.5");
  EXPECT_EQ(fact_of(facts, "calibrated"), "yes");
  EXPECT_GE(std::stoul(fact_of(facts, "replies_malformed")), 3u);
  EXPECT_GE(std::stoul(fact_of(facts, "usb_commands")), 3u);
  EXPECT_EQ(fact_of(facts, "usb_out_errors"), "0");
  EXPECT_GT(std::stod(fact_of(facts, "usb_command_mean_us")), 0.0);
  EXPECT_GE(std::stod(fact_of(facts, "usb_command_most_us")),
            std::stod(fact_of(facts, "usb_command_mean_us")));
}

TEST_F(UsbFalcon, HasOneOwnerAtATime) {
  const auto first = falcon_link();
  ASSERT_TRUE(first->open());
  const Status second = falcon_link()->open();
  ASSERT_FALSE(second);
  EXPECT_NE(second.error().what.find("another program has"), std::string::npos);
  const FalconBytes zero = falcon_zero();
  EXPECT_EQ(usb_send_once(kAddress, {}, zero, 100), UsbSent::kRefused) << "the guard tries again";
  first->close();
  EXPECT_EQ(usb_send_once(kAddress, {}, zero, 1000), UsbSent::kSent);
  usb->unplug();
  EXPECT_EQ(usb_send_once(kAddress, {}, zero, 100), UsbSent::kAbsent);
}

TEST_F(UsbFalcon, OfManyCommandsForASlowDeviceTheNewestGoesOut) {
  const auto link = falcon_link();
  ASSERT_TRUE(link->open());
  ASSERT_TRUE(link->control({0x40, 0x03, 0x0002, 0}));
  usb->hold_out(true);
  constexpr std::uint64_t kMany = 100;
  for (std::uint64_t i = 0; i < kMany; ++i)
    ASSERT_TRUE(comes([&] {
      return link->submit(encoded(FalconCommand{{500, 0, 0}, 1}));
    })) << "nobody is blocked";
  ASSERT_TRUE(comes([&] { return link->submit(falcon_zero()); }));
  EXPECT_EQ(link->counters().sent, 0u);
  usb->hold_out(false);
  link->close();
  EXPECT_FALSE(holds_force()) << "the zero last, before it was closed";
  const UsbLinkCounters counters = link->counters();
  EXPECT_LE(counters.sent, 2u) << "the one that was under way, and the newest";
  EXPECT_EQ(counters.sent + counters.overtaken, kMany + 1);
  EXPECT_FALSE(link->submit(falcon_zero())) << "closed";
}

TEST_F(UsbFalcon, ClosingNeverWaitsForADeviceThatTakesNothing) {
  const auto link = falcon_link();
  ASSERT_TRUE(link->open());
  usb->hold_out(true);
  for (int i = 0; i < 5; ++i) link->submit(falcon_zero());
  link->close();
  ASSERT_TRUE(link->open()) << "and it was let go of";
}

struct LiveFalcon {
  explicit LiveFalcon(const GovernorOptions& options, const Clock& clock)
      : device(falcon_link(), clock, {}), plane(0.5), servo(plane, options, device, clock, {}) {}
  Tick tick() {
    ::nanosleep(&kMillisecond, nullptr);
    return servo.tick();
  }
  FalconDevice device;
  SpringPlane plane;
  Servo servo;
};

TEST_F(UsbFalcon, IsUnpluggedAndBackTenTimesInALiveSession) {
  LiveFalcon live(patient(), clock);
  for (int times = 0; times < 10; ++times) {
    const Status started = live.servo.start();
    ASSERT_TRUE(started) << started.error().message();
    ASSERT_TRUE(comes([&] { return live.tick().sent_n.z() > 0.5; })) << times;
    ASSERT_TRUE(comes([&] { return holds_force(); }));
    usb->unplug();
    Fault fault = Fault::kNone;
    ASSERT_TRUE(comes([&] { return (fault = live.tick().fault) != Fault::kNone; }));
    EXPECT_EQ(fault, Fault::kLost);
    EXPECT_EQ(live.tick().sent_n, Vec3::Zero());
    live.servo.stop();
    usb->plug();
    ASSERT_TRUE(comes([&] { return !usb_devices(0x0403, 0xCB48).empty(); }));
  }
  const Status started = live.servo.start();
  ASSERT_TRUE(started) << started.error().message();
  EXPECT_TRUE(comes([&] { return !holds_force(); }))
      << "opening lets go of what was held when the cable went";
  live.servo.stop();
}

struct SpoiltCase {
  const char* name;
  Fault expected;
  void (*spoil)(FalconBoard&);
};

class UsbFalconFaults : public UsbFalcon, public testing::WithParamInterface<SpoiltCase> {};

TEST_P(UsbFalconFaults, AreSeenAndTheMotorsLetGo) {
  GovernorOptions options = patient();
  options.silence_s = 3.0;        // far more than a busy machine takes, and yet it comes
  options.jump_mm_per_s = 100.0;  // the pose rests; 30 mm in less than 0.3 s
  LiveFalcon live(options, clock);
  ASSERT_TRUE(live.servo.start());
  ASSERT_TRUE(comes([&] { return live.tick().sent_n.z() > 0.5 && holds_force(); }));
  usb->with(GetParam().spoil);
  const Stopwatch watch;
  Fault fault = Fault::kNone;
  ASSERT_TRUE(comes([&] { return (fault = live.tick().fault) != Fault::kNone; }));
  const double seen_ms = watch.ms();
  EXPECT_STREQ(fault_name(fault), fault_name(GetParam().expected));
  EXPECT_TRUE(comes([&] { return live.tick().sent_n == Vec3::Zero() && !holds_force(); }));
  fmt::print("{}: seen after {:.1f} ms, motors let go after {:.1f} ms\n", GetParam().name, seen_ms,
             watch.ms());
}

INSTANTIATE_TEST_SUITE_P(Falcon, UsbFalconFaults,
                         testing::Values(SpoiltCase{"silent", Fault::kSilence,
                                                    [](FalconBoard& now) { now.faults.silent = true; }},
                                         SpoiltCase{"garbled", Fault::kGarbled,
                                                    [](FalconBoard& now) { now.faults.garbled = true; }},
                                         SpoiltCase{"unhomed", Fault::kHomingLost,
                                                    [](FalconBoard& now) { now.faults.lost_homing = true; }},
                                         SpoiltCase{"jump", Fault::kJump,
                                                    [](FalconBoard& now) {
                                                      now.counts = pose_counts(Vec3{0, 30, -2});
                                                    }},
                                         SpoiltCase{"nowhere", Fault::kGarbled,
                                                    [](FalconBoard& now) {
                                                      now.faults.jump = {20'000, -20'000, 20'000};
                                                    }}),
                         [](const auto& instance) { return std::string(instance.param.name); });

/// The driver in a process of its own, with or without a guard.
pid_t press_in_child(bool guarded) {
  const pid_t child = ::fork();
  if (child != 0) return child;
  ::execl("/proc/self/exe", "test_usb", guarded ? "--press" : "--press-unguarded",
          static_cast<char*>(nullptr));
  ::_exit(9);
}

TEST_F(UsbFalcon, TheGuardSendsZeroAfterEveryDeathOfTheProgram) {
  for (const int number : {SIGKILL, SIGSEGV, SIGABRT}) {
    const pid_t child = press_in_child(true);
    ASSERT_TRUE(comes([&] { return holds_force(); })) << "it presses";
    const Stopwatch watch;
    ::kill(child, number);
    EXPECT_TRUE(comes([&] { return !holds_force(); })) << "signal " << number;
    fmt::print("signal {}: zero after {:.1f} ms\n", number, watch.ms());
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_NE(status, 0) << "it died; a sanitizer makes an exit of SIGSEGV";
    // The guard may still be letting go of the device.
    ASSERT_TRUE(comes([&] {
      const auto link = falcon_link();
      return link->open().ok();
    }));
  }
}

TEST_F(UsbFalcon, WithoutTheGuardTheTorqueStays) {
  const pid_t child = press_in_child(false);
  ASSERT_TRUE(comes([&] { return holds_force(); }));
  ::kill(child, SIGKILL);
  ASSERT_EQ(::waitpid(child, nullptr, 0), child);
  for (int i = 0; i < 300; ++i) ::nanosleep(&kMillisecond, nullptr);
  EXPECT_TRUE(holds_force()) << "this is what the guard is for";
}

TEST_F(UsbFalcon, AStopOfTheProgramSendsZeroThatLeavesIt) {
  const pid_t child = ::fork();
  if (child == 0) {
    ::execl("/proc/self/exe", "test_usb", "--press-and-stop", static_cast<char*>(nullptr));
    ::_exit(9);
  }
  ASSERT_TRUE(comes([&] { return holds_force(); })) << "it presses";
  ::kill(child, SIGTERM);
  int status = -1;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
  EXPECT_FALSE(holds_force());
}

TEST_F(UsbFalcon, FramesAllocateNothing) {
  LiveFalcon live(patient(), clock);
  ASSERT_TRUE(live.servo.start());
  ASSERT_TRUE(comes([&] { return live.tick().sent_n.z() > 0.5 && holds_force(); }));
  std::uint64_t counted = 0;
  int fresh = 0;
  for (int i = 0; i < 200; ++i) {
    ::nanosleep(&kMillisecond, nullptr);
    const house::AllocationCount allocations(house::AllocationCount::Threads::kThisOne);
    fresh += live.servo.tick().state.status == ReadStatus::kFresh ? 1 : 0;
    counted += allocations.count();
  }
  EXPECT_EQ(counted, 0u);
  EXPECT_GT(fresh, 0);
}

TEST(UsbRoundTrip, EveryPacketIsAnswered) {
  for (const bool event_character : {false, true}) {
    const RoundTrips trips = measure_round_trips({.seconds = 2.0, .event_character = event_character});
    fmt::print("{}\n",
               trips.json(event_character ? "libusb, umockdev, event character" : "libusb, umockdev"));
    EXPECT_GT(trips.answered, 0u);
    EXPECT_EQ(trips.malformed, 0u);
    EXPECT_TRUE(trips.lost == 0 || trips.overrun > 0) << "none vanishes uncounted";
    EXPECT_EQ(trips.answered + trips.overtaken + trips.lost + trips.refused, trips.sent);
  }
}

}  // namespace
}  // namespace palpate::device

int main(int argc, char** argv) {
  using namespace palpate::device;
  const std::string first = argc > 1 ? argv[1] : "";
  if (first == "--press") press_over_usb(true);
  if (first == "--press-unguarded") press_over_usb(false);
  if (first == "--press-and-stop") press_and_stop();
  if (first == "--be-refused") be_refused();
  if (first == kPressArgument) press_until_killed(std::vector<std::string>(argv + 2, argv + argc));
  if (const std::string missing = UsbfsDouble::missing(); !missing.empty()) {
    fmt::print(stderr, "skipped: {}\n", missing);
    constexpr int kSkipped = 77;  // what CTest takes for a skipped test
    return kSkipped;
  }
  if (first == "--faults") return measured_faults(argc, argv, measure_usb_faults);
  if (first == "--measure") {
    const double seconds = argc > 2 ? std::strtod(argv[2], nullptr) : 60.0;
    for (const bool event_character : {false, true})
      fmt::print("{}\n",
                 measure_round_trips({seconds, event_character, true})
                     .json(event_character ? "libusb, umockdev, event character" : "libusb, umockdev"));
    return 0;
  }
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
