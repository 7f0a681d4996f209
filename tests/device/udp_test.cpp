// The bridge over real sockets on this machine. Nothing is asked to happen within a time of its own.
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <set>

#include <palpate/device/drivers.h>
#include <palpate/device/guard.h>
#include <palpate/progress.h>
#include "device/bridge/bridge_device.h"
#include "device/bridge/bridge_server.h"
#include "device/drivers/all_drivers.h"
#include "device/links/udp_link.h"
#include "tests/device/bridge_rig.h"
#include "tests/device/helpers.h"
#include "tests/files.h"

namespace palpate::device {
namespace {

TEST(UdpAddress, IsReadAndWritten) {
  for (const char* good : {"localhost:47800", "127.0.0.1:1", "[::1]:65535", "host.example:0"})
    EXPECT_EQ(UdpAddress::of(good)->text(), good);
  for (const char* bad : {"", "localhost", ":5", "a:b", "a:-1", "a:65536", "::1:5", "[::1:5", "a b:1x"})
    EXPECT_FALSE(UdpAddress::of(bad)) << bad;
}

TEST(UdpLink, CarriesDatagramsBothWaysEachWhole) {
  for (const char* at : {"127.0.0.1:0", "[::1]:0"}) {
    UdpPort port(UdpAddress::of(at).value());
    if (!port.open() && at[0] == '[') continue;  // a machine without IPv6
    UdpLink link(port.address());
    const std::array<std::uint8_t, 5> bytes = {1, 2, 3, 4, 5};
    EXPECT_FALSE(link.submit(bytes)) << "not open";
    ASSERT_TRUE(link.open());
    EXPECT_EQ(link.poll(std::span<std::uint8_t>()).size, 0u);
    ASSERT_TRUE(link.submit(bytes));
    ASSERT_TRUE(link.submit(std::span(bytes).first(2)));
    std::array<std::uint8_t, 16> into{};
    Peer from;
    EXPECT_TRUE(comes([&] { return port.receive(into, from) == 5; })) << "one at a time";
    EXPECT_TRUE(comes([&] { return port.receive(into, from) == 2; }));
    EXPECT_TRUE(port.send(std::span(bytes).first(3), from));
    EXPECT_TRUE(comes([&] { return link.poll(into).size == 3; }));
    link.close();
    EXPECT_TRUE(link.poll(into).gone) << "closed";
    EXPECT_TRUE(link.submit(bytes)) << "and yet";
    ASSERT_TRUE(link.open());
    EXPECT_FALSE(link.poll(into).gone) << "what waited is gone, the link is not";
  }
}

TEST(UdpLink, ATakenPortAndAnUnknownHostAreSaid) {
  UdpPort port(UdpAddress::of("127.0.0.1:0").value());
  ASSERT_TRUE(port.open());
  UdpPort second(port.address());
  EXPECT_TRUE(refused(second.open(), "another port"));
  UdpLink lost(UdpAddress{"no.such.host.invalid", 5});
  EXPECT_TRUE(refused(lost.open(), "no.such.host.invalid"));
}

TEST(UdpLink, AnswersOfAnotherAddressAreNotHeard) {
  UdpPort port(UdpAddress::of("127.0.0.1:0").value()), stranger(UdpAddress::of("127.0.0.1:0").value());
  ASSERT_TRUE(port.open() && stranger.open());
  UdpLink link(port.address());
  ASSERT_TRUE(link.open());
  const std::array<std::uint8_t, 4> bytes = {9, 9, 9, 9};
  ASSERT_TRUE(link.submit(bytes));
  std::array<std::uint8_t, 8> into{};
  Peer from;
  ASSERT_TRUE(comes([&] { return port.receive(into, from) == 4; }));
  EXPECT_TRUE(stranger.send(std::span(bytes).first(1), from));
  EXPECT_TRUE(port.send(std::span(bytes).first(2), from));
  EXPECT_TRUE(comes([&] {
    const std::size_t size = link.poll(into).size;
    EXPECT_NE(size, 1u);
    return size == 2;
  }));
}

/// A far end that ticks in a thread.
class RunningFarEnd {
 public:
  /// `watchdog_s`: the machine may be busy, and what is tested here is not its speed.
  explicit RunningFarEnd(double watchdog_s)
      : port_(UdpAddress::of("127.0.0.1:0").value()), far_(held, port_, clock, patient(watchdog_s)) {
    EXPECT_TRUE(port_.open().ok());
    EXPECT_TRUE(far_.open().ok());
  }
  void start() {
    thread_ = std::thread([this] {
      while (!ending_.load()) {
        far_.tick();
        force_x_n.store(held.held_n.x());
        releases.store(far_.counters().releases);
        ::usleep(500);
      }
    });
  }
  ~RunningFarEnd() {
    ending_ = true;
    if (thread_.joinable()) thread_.join();
  }
  [[nodiscard]] std::string where() const { return port_.address().text(); }

  MonotonicClock clock;
  HeldDevice held{clock};
  std::atomic<double> force_x_n{0.0};
  std::atomic<std::uint64_t> releases{0};

 private:
  static BridgeServerOptions patient(double watchdog_s) {
    BridgeServerOptions options;
    options.rate_hz = 500.0;
    options.watchdog_s = options.max_age_s = watchdog_s;
    options.late_zero_s = options.latch_late_s = options.silence_s = 20.0;
    return options;
  }
  UdpPort port_;
  BridgeServer far_;
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

TEST(BridgeOverSockets, IsFeltLetGoAndReleasedByAGuard) {
  RunningFarEnd far(60.0);
  far.start();
  const MonotonicClock clock;
  auto made = value_of(driver_of(&register_bridge_driver, "bridge")
                           .make({"bridge:" + far.where(), {}, {{"most-age-ms", "1000"}}}, clock));
  Device& device = *made.device;
  ASSERT_TRUE(ok(device.open()));
  EXPECT_EQ(device.limits().force_max_n, 5.0);
  ForceGovernor governor = ForceGovernor::create(device.limits(), patient_governor()).value();
  governor.arm(clock.now_s());
  // Both sides are so patient that a busy machine trips nothing.
  const auto feels = [&](double force_n) {
    return comes([&] {
      const DeviceState state = device.read();
      device.send(governor.govern(clock.now_s(), state, Vec3{force_n, 0, 0}));
      return far.force_x_n.load() >= 0.9 * force_n;
    });
  };
  EXPECT_TRUE(feels(1.0));
  // A guard's own socket, while the program's goes on: it lets go, and force comes again only after a zero.
  EXPECT_TRUE(made.zero());
  EXPECT_TRUE(comes([&] { return far.force_x_n.load() == 0.0; }));
  for (int i = 0; i < 50; ++i) {
    device.send(governor.govern(clock.now_s(), device.read(), Vec3{1, 0, 0}));
    ::usleep(1000);
    EXPECT_EQ(far.force_x_n.load(), 0.0);
  }
  governor.arm(clock.now_s());
  EXPECT_TRUE(feels(1.0));
  EXPECT_TRUE(device.cut_force());
  EXPECT_TRUE(comes([&] { return far.force_x_n.load() == 0.0; }));
  device.close();
  ASSERT_TRUE(device.open()) << "the same program again";
}

/// A program that feels the far device until it is killed, guarded or not.
[[noreturn]] void press_over_bridge(const std::string& where, bool guarded) {
  const MonotonicClock clock;
  Result<MadeDevice> made = driver_of(&register_bridge_driver, "bridge")
                                .make({"bridge:" + where, {}, {{"most-age-ms", "1000"}}}, clock);
  if (!made) ::_exit(1);
  std::optional<Guard> guard;
  if (guarded) {
    Result<Guard> started = Guard::start(made->zero);
    if (!started) ::_exit(2);
    guard.emplace(std::move(started).value());
  }
  Device& device = *made->device;
  if (!device.open()) ::_exit(3);
  Result<ForceGovernor> governor = ForceGovernor::create(device.limits(), patient_governor());
  if (!governor) ::_exit(4);
  governor->arm(clock.now_s());
  for (;;) {
    device.send(governor->govern(clock.now_s(), device.read(), Vec3{1.0, 0, 0}));
    ::usleep(500);
  }
}

// Far ends whose own watchdog sleeps for a minute: what lets go here is the guard alone.
TEST(BridgeOverSockets, AProgramThatIsKilledIsLetGoByItsGuard) {
  for (const bool guarded : {true, false}) {
    RunningFarEnd far(60.0);
    pid_t child = -1;
    {
      const auto hold = block_stop();
      child = ::fork();  // before there are threads
      if (child == 0) {
        forget_stop_callbacks();
        press_over_bridge(far.where(), guarded);
      }
    }
    ASSERT_GT(child, 0);
    far.start();
    EXPECT_TRUE(comes([&] { return far.force_x_n.load() > 0.9; }));
    const std::uint64_t before = far.releases.load();
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    if (guarded) {
      EXPECT_TRUE(comes([&] { return far.releases.load() > before && far.force_x_n.load() == 0.0; }));
    } else {
      ::usleep(300'000);
      EXPECT_EQ(far.releases.load(), before);
      EXPECT_GE(far.force_x_n.load(), 0.9) << "without a guard it holds: the test above shows something";
    }
  }
}

TEST(BridgeOverSockets, NobodyThereIsSaid) {
  std::string where;
  {
    UdpPort port(UdpAddress::of("127.0.0.1:0").value());
    ASSERT_TRUE(port.open());
    where = port.address().text();
  }
  const MonotonicClock clock;
  BridgeOptions options{.open_tries = 20};
  BridgeDevice device(std::make_unique<UdpLink>(UdpAddress::of(where).value()), clock, options);
  EXPECT_TRUE(refused(device.open(), "nobody listens"));
  EXPECT_FALSE(release_far_end(where));
}

// ---- Every driver, and the udev rules.

TEST(AllDrivers, HaveNamesOfTheirOwnAndSayWhatTheyNeed) {
  Drivers drivers;
  register_all_drivers(drivers);
  std::set<std::string> entries;
  for (const Driver& driver : drivers.all()) {
    EXPECT_FALSE(driver.transport.empty()) << driver.name;
    const std::vector<DeviceEntry> found = driver.look();
    EXPECT_FALSE(found.empty()) << driver.name;
    for (const DeviceEntry& entry : found) {
      EXPECT_EQ(drivers.of(entry.name), &driver) << entry.name;
      EXPECT_TRUE(entries.insert(entry.name).second) << entry.name;
      EXPECT_EQ(entry.status == DeviceStatus::kReady, entry.needs.empty()) << entry.name;
    }
  }
  for (const char* name : {"sim", "bridge", "inverse3", "dhd", "openhaptics"})
    EXPECT_NE(drivers.of(name), nullptr) << name;
}

TEST(AllDrivers, NonsenseIsRefusedByEachWithAnError) {
  Drivers drivers;
  register_all_drivers(drivers);
  const MonotonicClock clock;
  for (const Driver& driver : drivers.all()) {
    if (!driver.make) continue;
    const Result<MadeDevice> made = driver.make({driver.name, {}, {{"no-such-option", "1"}}}, clock);
    ASSERT_FALSE(made) << driver.name;
    EXPECT_FALSE(made.error().what.empty());
  }
}

constexpr const char* kUdevRulesHead =
    "# Haptic devices: who sits at the machine may open them (uaccess); nobody else but root and its group.\n"
    "# Installed by Palpate as lib/udev/rules.d/70-palpate.rules. By hand: copy it to /etc/udev/rules.d, "
    "then\n"
    "#   sudo udevadm control --reload && sudo udevadm trigger\n"
    "# and plug the device in again.\n";

/// The whole file of rules, from the table.
std::string udev_rules_file() {
  std::string text = kUdevRulesHead;
  std::string group;
  for (const UsbId& device : known_usb_ids()) {
    if (group != device.name) text += "\n# " + device.name + "\n";
    group = device.name;
    text += udev_rule(device) + "\n";
  }
  return text;
}

TEST(UdevRules, TheInstalledFileIsThatOfTheTable) {
  EXPECT_EQ(file_text(PALPATE_SOURCE_ROOT "/device/drivers/70-palpate.rules"), udev_rules_file())
      << udev_rules_file();
}

TEST(UdevRules, GiveAccessToWhoSitsThereAndToNobodyElse) {
  for (const UsbId& device : known_usb_ids()) {
    const std::string rule = udev_rule(device);
    EXPECT_TRUE(says(rule, "MODE=\"0660\", TAG+=\"uaccess\""));
    EXPECT_TRUE(says(rule, device.vendor));
    EXPECT_FALSE(says(rule, "0666"));
    EXPECT_EQ(std::string(device.vendor).size(), 4u);
  }
  EXPECT_EQ(
      udev_rule(UsbNode::kUsb, "0403", "cb48"),
      R"(SUBSYSTEM=="usb", ATTR{idVendor}=="0403", ATTR{idProduct}=="cb48", MODE="0660", TAG+="uaccess")");
  EXPECT_EQ(
      udev_rule(UsbNode::kHidraw, "256f", ""),
      R"(KERNEL=="hidraw*", SUBSYSTEM=="hidraw", ATTRS{idVendor}=="256f", MODE="0660", TAG+="uaccess")");
}

// Keyboards and mice of the same vendors must stay closed to everybody but their own driver.
TEST(UdevRules, OpenNoKeyboard) {
  const std::set<std::string> shared = {"046d", "256f"};
  const std::set<std::string> others = {"c650", "c651", "c654", "c655", "c656",
                                        "c657", "c658", "c664", "c665", "c668"};
  for (const UsbId& device : known_usb_ids()) {
    EXPECT_TRUE(shared.count(device.vendor) == 0 || device.product[0] != '\0') << device.vendor;
    EXPECT_EQ(others.count(device.product), 0u) << device.product;
  }
}

}  // namespace
}  // namespace palpate::device
