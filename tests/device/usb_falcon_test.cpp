// The Falcon's driver over the real libusb, with a pretended Falcon below it: run by umockdev-wrapper. What
// is asserted is what happens, never how soon.
//
//   umockdev-wrapper test_usb --measure SECONDS         round trips at 1 kHz, as JSON; SCHED_FIFO if allowed
//   umockdev-wrapper test_usb --faults RUNS FILE.json   the table of docs/results/hands-and-loops.md
#include <fcntl.h>
#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>

#include <palpate/clock.h>
#include <palpate/device/servo.h>
#include <palpate/progress.h>
#include "device/falcon/falcon_device.h"
#include "device/links/usb_link.h"
#include "tests/device/helpers.h"
#include "tests/device/link_faults.h"
#include "tests/device/mock/usbfs_double.h"
#include "tests/device/rig.h"
#include "tests/device/round_trip.h"
#include "tests/house/allocation_count.h"

namespace palpate::device {
namespace {

constexpr timespec kMillisecond{0, 1'000'000};
const UsbAddress kAddress{0x0403, 0xCB48, ""};

std::unique_ptr<UsbLink> falcon_link() {
  return std::make_unique<UsbLink>(kAddress, UsbInterface{}, "falcon", falcon_lets_go, 0);
}

std::vector<std::uint8_t> garbled_reply() {
  FalconBytes bytes = encoded(FalconReply{});
  bytes[7] = 'z';  // no letter of a number
  return {bytes.begin(), bytes.end()};
}

GovernorOptions patient() {
  GovernorOptions options = patient_governor(0.02);
  options.jump_mm_per_s = 1e6;
  return options;
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
  static_cast<void>(run_stop_callbacks());
  ::_exit(0);
}

/// As a user who may not: 0 where it is said what helps.
[[noreturn]] void be_refused() {
  constexpr unsigned kNobody = 65534;
  if (::geteuid() == 0 && (::setgid(kNobody) != 0 || ::setuid(kNobody) != 0)) ::_exit(5);
  const DeviceEntry entry = driver_of(&register_falcon_driver, "falcon").look().at(0);
  if (entry.status != DeviceStatus::kRefused || entry.needs.at(0) != kUdevRemedy) ::_exit(6);
  const Status opened = falcon_link()->open();
  if (opened || !opened.error().remedy.starts_with(kUdevRemedy)) ::_exit(7);
  ::_exit(0);
}

/// This program once more, in a process of its own.
pid_t run_self(std::vector<std::string> words) {
  const pid_t child = ::fork();
  if (child != 0) return child;
  words.insert(words.begin(), "test_usb");
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  ::execv("/proc/self/exe", argv.data());
  ::_exit(9);
}

class UsbFalcon : public testing::Test {
 protected:
  void SetUp() override {
    board.run_firmware();
    board.home(falcon_counts_at(Vec3{0, 0, -2}));
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
  EXPECT_EQ(driver_of(&register_falcon_driver, "falcon").look().at(0).status, DeviceStatus::kReady);
  usb->unplug();
  EXPECT_TRUE(usb_devices(0x0403, 0xCB48).empty());
  const DeviceEntry missing = driver_of(&register_falcon_driver, "falcon").look().at(0);
  EXPECT_EQ(missing.status, DeviceStatus::kMissing);
  EXPECT_FALSE(missing.needs.empty());
  EXPECT_TRUE(refused(falcon_link()->open(), "0403:cb48"));
}

TEST_F(UsbFalcon, AUserWhoMayNotOpenItIsToldOfTheRules) {
  usb->forbid();
  const pid_t child = run_self({"--be-refused"});
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
  usb->with([](FalconBoard& now) { now.home(falcon_counts_at(Vec3{10, -5, 20})), now.buttons = 4; });
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
  const auto made = value_of(driver_of(&register_falcon_driver, "falcon")
                                 .make({"falcon", {}, {{"k", "12.5"}, {"calibrated", "yes"}}}, clock));
  ASSERT_TRUE(made.device->open());
  usb->with([](FalconBoard& now) {
    now.instead = [](auto) { return std::vector<std::vector<std::uint8_t>>{garbled_reply()}; };
  });
  ASSERT_TRUE(comes([&] {
    made.device->cut_force();
    return made.device->read().status == ReadStatus::kGarbled;
  }));
  const DeviceFacts facts = made.facts();
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
  EXPECT_TRUE(refused(falcon_link()->open(), "another program has"));
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

TEST_F(UsbFalcon, IsUnpluggedAndBackInALiveSession) {
  LiveFalcon live(patient(), clock);
  for (int times = 0; times < 3; ++times) {
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
  ASSERT_TRUE(ok(live.servo.start()));
  EXPECT_TRUE(comes([&] { return !holds_force(); }))
      << "opening lets go of what was held when the cable went";
  live.servo.stop();
}

TEST_F(UsbFalcon, AStopOfTheProgramSendsZeroThatLeavesIt) {
  const pid_t child = run_self({"--press-and-stop"});
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

/// One packet a millisecond, each answered by one that holds its number; printed as JSON. `real_time`: asks
/// for SCHED_FIFO, for the loop, the link and what pretends to be a device.
RoundTrips measure_usb_trips(double seconds, bool event_character, bool real_time) {
  constexpr int kLoopPriority = 80, kDoublePriority = 82;
  constexpr std::uint32_t kNumbers = 4000;  // a command's range; more than can be under way
  FalconBoard board;
  board.run_firmware();
  board.echo_motors = true;
  UsbfsDouble usb(board);
  sched_param priority{}, before{};
  priority.sched_priority = kLoopPriority;
  int policy = 0;
  ::pthread_getschedparam(::pthread_self(), &policy, &before);
  const bool fifo = real_time && ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &priority) == 0;
  if (fifo) usb.run_at(kDoublePriority);
  UsbLink link(kAddress, {}, "falcon", falcon_lets_go, fifo ? UsbLink::kPriority : 0);
  const auto no_firmware = []() -> Result<FalconFirmware> { return Error{"it runs"}; };
  if (!link.open() || !boot_falcon(link, {no_firmware, [](int ms) { sleep_ms(ms); }, event_character}))
    std::abort();
  FalconReader reader;
  const TripProtocol protocol{
      kNumbers,
      [](std::uint32_t number) {
        const FalconBytes bytes = encoded(FalconCommand{{static_cast<int>(number), 0, 0}, 1});
        return std::vector<std::uint8_t>(bytes.begin(), bytes.end());
      },
      [&reader](std::span<const std::uint8_t> polled, const auto& answered) {
        for (const std::uint8_t byte : ftdi_payload(polled))
          if (const auto reply = reader.take(byte)) answered(static_cast<std::uint32_t>(reply->counts[0]));
      },
      [&link] { return link.counters().overtaken; }};
  RoundTrips trips = measure_round_trips(link, seconds, protocol);
  trips.fifo = fifo;
  trips.malformed = reader.malformed();
  trips.overrun = link.counters().overrun;
  link.close();
  ::pthread_setschedparam(::pthread_self(), policy, &before);
  fmt::print("{}\n", trips.json(event_character ? "libusb, umockdev, event character" : "libusb, umockdev"));
  return trips;
}

TEST(UsbRoundTrip, EveryPacketIsAnswered) {
  for (const bool event_character : {false, true}) {
    const RoundTrips trips = measure_usb_trips(1.0, event_character, false);
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
      static_cast<void>(measure_usb_trips(seconds, event_character, true));
    return 0;
  }
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
