// The Falcon's set-up and the device over it, against a simulated Falcon on virtual time, with the real
// governor and servo: no frame with force follows a fault.

#include "device/falcon/falcon_device.h"
#include <palpate/clock.h>
#include <palpate/device/servo.h>
#include <palpate/device/watchdog.h>
#include "tests/device/helpers.h"
#include "tests/device/hid_fake_link.h"
#include "tests/device/mock/falcon_link.h"
#include "tests/device/rig.h"

namespace palpate::device {
namespace {

constexpr std::array<int, 3> kCentreCounts = {-96, -96, -96};

struct FalconRig {
  explicit FalconRig(FalconOptions options = {}) {
    auto owned = std::make_unique<FalconLink>(board, clock);
    link = owned.get();
    options.pause = [this](int ms) { clock.advance(1e-3 * ms); };
    if (!options.firmware) options.firmware = [this] { return check_falcon_firmware(image); };
    device = std::make_unique<FalconDevice>(std::move(owned), clock, std::move(options));
  }
  /// Firmware runs and all legs are homed at the centre.
  static void prepared(FalconBoard& board) {
    board.run_firmware();
    board.home(kCentreCounts);
  }
  /// A packet each way.
  DeviceState exchange() {
    device->cut_force();
    clock.advance(2e-3);
    return device->read();
  }
  VirtualClock clock;
  FalconBoard board;
  std::vector<std::uint8_t> image = made_up_image();
  FalconLink* link = nullptr;
  std::unique_ptr<FalconDevice> device;
};

/// The same, prepared and open.
struct OpenFalcon : FalconRig {
  explicit OpenFalcon(FalconOptions options = {}) : FalconRig(std::move(options)) {
    prepared(board);
    EXPECT_TRUE(ok(device->open()));
  }
};

// Set-up.

TEST(FalconBoot, LoadsTheImageByteForByteWhereNoneRuns) {
  FalconRig rig;
  ASSERT_TRUE(ok(rig.device->open()));
  EXPECT_EQ(rig.board.loaded(), rig.image);
  EXPECT_EQ(rig.board.stage(), FalconBoard::Stage::kRunning);
  EXPECT_EQ(rig.board.resets(), 1);
  EXPECT_FALSE(rig.device->booted().was_running);
  EXPECT_EQ(rig.device->booted().firmware, "unknown image");
  EXPECT_EQ(rig.device->booted().attempts, 1);
  EXPECT_EQ(rig.board.latency_ms(), 1);
  EXPECT_FALSE(rig.board.event_character());
  EXPECT_FALSE(rig.board.holds_force());
}

TEST(FalconBoot, ResetsByTheRisingEdgeAtTheRomsRate) {
  FalconRig rig;
  ASSERT_TRUE(rig.device->open());
  std::vector<ControlRequest>& sent = rig.link->controls;
  const auto at = [&](std::uint8_t request, std::uint16_t value) {
    return std::find(sent.begin(), sent.end(), ControlRequest{0x40, request, value, 0}) - sent.begin();
  };
  EXPECT_LT(at(0x03, 0x4138), at(0x01, 0x0101)) << "9600 baud, then DTR high";
  EXPECT_LT(at(0x01, 0x0100), at(0x01, 0x0101)) << "DTR low, then high";
  EXPECT_LT(at(0x01, 0x0101), at(0x03, 0x0015)) << "then the rate for loading";
  EXPECT_LT(at(0x01, 0x0101), static_cast<std::ptrdiff_t>(sent.size()));
}

TEST(FalconBoot, RunningFirmwareIsFoundAndLeftAlone) {
  FalconOptions options;
  options.firmware = []() -> Result<FalconFirmware> { return Error{"nobody should ask"}; };
  FalconRig rig(options);
  rig.board.run_firmware();
  rig.board.faults.deaf_for = 7;  // replies may be lost
  ASSERT_TRUE(rig.device->open());
  EXPECT_TRUE(rig.device->booted().was_running);
  EXPECT_EQ(rig.board.resets(), 0);
  EXPECT_LT(rig.clock.now_s(), 0.1);
}

TEST(FalconBoot, RepliesComeInPiecesAndOneByOne) {
  for (const std::size_t most : {1U, 3U, 5U, 16U, 40U}) {
    FalconRig rig;
    FalconRig::prepared(rig.board);
    rig.board.most_per_packet = most;
    ASSERT_TRUE(rig.device->open()) << most;
  }
  FalconRig booted;
  booted.board.faults.zero_first = true;
  EXPECT_TRUE(booted.device->open()) << "the boot ROM's answer may begin with zero";
}

TEST(FalconBoot, AWrongEchoIsTriedAgainUpToTenTimes) {
  FalconRig rig;
  rig.board.faults.wrong_echoes = 3;
  ASSERT_TRUE(rig.device->open());
  EXPECT_EQ(rig.device->booted().attempts, 4);
  EXPECT_EQ(rig.link->opens, 4) << "closed and opened in between";
  EXPECT_EQ(rig.board.loaded(), rig.image);
  FalconRig hopeless;
  hopeless.board.faults.wrong_echoes = 1000;
  const Status opened = hopeless.device->open();
  ASSERT_FALSE(opened);
  EXPECT_TRUE(says(opened.error().what, "echoed")) << opened.error().message();
  EXPECT_EQ(hopeless.link->opens, 10);
  EXPECT_NE(hopeless.board.stage(), FalconBoard::Stage::kRunning);
}

TEST(FalconBoot, WithoutFirmwareItSaysWhatIsMissingAndSendsNoByteOfIt) {
  FalconOptions options;
  options.firmware = [] { return find_falcon_firmware({"", "", {"/nowhere/at/all"}}); };
  FalconRig rig(options);
  EXPECT_TRUE(refused(rig.device->open(), "/nowhere/at/all"));
  EXPECT_EQ(rig.board.resets(), 0) << "not even reset";
  FalconRig wrong;
  wrong.image[0] = 0xAB;
  EXPECT_FALSE(wrong.device->open());
  EXPECT_TRUE(wrong.board.loaded().empty());
  EXPECT_EQ(wrong.board.resets(), 0);
}

TEST(FalconBoot, EveryOtherFailureIsBoundedAndSaid) {
  const auto failure = [](const auto& spoil) {
    FalconRig rig;
    spoil(rig);
    const Status opened = rig.device->open();
    EXPECT_FALSE(opened);
    EXPECT_LT(rig.clock.now_s(), 120.0);
    EXPECT_FALSE(rig.device->cut_force()) << "closed again";
    return opened ? std::string() : opened.error().what;
  };
  EXPECT_TRUE(says(failure([](FalconRig& rig) { rig.board.faults.mute_rom = true; }), "does not answer"));
  EXPECT_TRUE(
      says(failure([](FalconRig& rig) { rig.board.faults.dead_image = true; }), "does not answer packets"));
  EXPECT_TRUE(says(failure([](FalconRig& rig) { rig.link->jammed = true; }), "takes no bytes"));
  EXPECT_TRUE(says(failure([](FalconRig& rig) { rig.link->unplugged = true; }), "no device"));
}

TEST(FalconBoot, TheEventCharacterIsOnInUseAloneAndOnlyWhenAsked) {
  FalconOptions options;
  options.event_character = true;
  FalconRig rig(options);
  ASSERT_TRUE(rig.device->open());
  EXPECT_TRUE(rig.board.event_character());
  EXPECT_EQ(rig.board.loaded(), rig.image) << "images hold its byte too";
}

// The device.

TEST(FalconDevice, ReadsPositionsButtonsBytesAndTimes) {
  OpenFalcon rig;
  (void)rig.exchange();
  rig.board.counts = falcon_counts_at(Vec3{10, -20, 15});
  rig.board.buttons = 5;
  const DeviceState state = rig.exchange();
  EXPECT_EQ(state.status, ReadStatus::kFresh);
  EXPECT_LT((state.position_mm - Vec3(10, -20, 15)).norm(), 0.06) << "rounded to counts";
  EXPECT_TRUE(state.homed);
  EXPECT_EQ(state.buttons, 5u);
  EXPECT_EQ(state.packet_ns, rig.clock.now_ns());
  ASSERT_EQ(state.raw.size, kFalconPacketBytes);
  EXPECT_TRUE(falcon_reply(std::span(state.raw.bytes).first<kFalconPacketBytes>()));
  EXPECT_EQ(rig.device->read().status, ReadStatus::kNothingNew) << "two status bytes alone are no news";
}

TEST(FalconDevice, LimitsAreTwoNewtonsUntilCalibrated) {
  EXPECT_EQ(FalconRig().device->limits().force_max_n, 2.0);
  FalconOptions options;
  options.calibrated = true;
  EXPECT_EQ(FalconRig(options).device->limits().force_max_n, 8.0);
  options.counts_per_n_mm = 0.0;
  EXPECT_FALSE(FalconRig(options).device->open());
}

TEST(FalconDevice, ForceBecomesTheTorquesOfTheKnownPoseTimesK) {
  for (const double k : {10.0, 3.6}) {
    FalconOptions options;
    options.counts_per_n_mm = k;
    FalconRig rig(options);
    rig.board.run_firmware();
    rig.board.home(falcon_counts_at(Vec3::Zero()));
    ASSERT_TRUE(rig.device->open());
    ASSERT_TRUE(rig.exchange().homed);
    rig.device->send(governed(Vec3{1.0, 0.0, 0.0}));
    const std::array<double, 3> known = {18.64, -62.99, 44.35};  // N mm for 1 N along x
    for (std::size_t leg = 0; leg < 3; ++leg)
      EXPECT_NEAR(rig.board.held().motors[leg], -k * known[leg], 0.5 + 0.02 * k) << leg;
    EXPECT_EQ(rig.board.held().flags, FalconCommand::kHoming | FalconCommand::kGreen);
    EXPECT_EQ(rig.board.refused(), 0u);
  }
}

TEST(FalconDevice, AForceBeyondTheMotorsKeepsItsDirection) {
  FalconOptions options;
  options.calibrated = true;
  options.counts_per_n_mm = 100.0;
  OpenFalcon rig(options);
  ASSERT_TRUE(rig.exchange().homed);
  rig.device->send(governed(Vec3{4.0, 0.0, 0.0}));
  EXPECT_EQ(rig.board.held().motors[1], 4095);
  EXPECT_NEAR(rig.board.held().motors[0], -4095.0 * 18.64 / 62.99, 10.0);
  EXPECT_NEAR(rig.board.held().motors[2], -4095.0 * 44.35 / 62.99, 10.0);
}

TEST(FalconDevice, HomingIsPromptedAndNothingPushesBeforeIt) {
  FalconRig rig;
  rig.board.run_firmware();
  rig.board.counts = {12'000, -7'000, 31'000};  // nonsense that no pose has
  ASSERT_TRUE(rig.device->open());
  EXPECT_TRUE(says(falcon_homing_prompt(0), "Pull the grip all the way out"));
  EXPECT_TRUE(says(falcon_homing_prompt(5), "2 of 3"));
  EXPECT_TRUE(falcon_homing_prompt(FalconReply::kAllLegs).empty());
  for (const std::uint8_t legs : std::array<std::uint8_t, 3>{0, 1, 3}) {
    rig.board.homed = legs;
    const DeviceState state = rig.exchange();
    EXPECT_EQ(state.status, ReadStatus::kFresh);
    EXPECT_FALSE(state.homed);
    EXPECT_EQ(rig.device->homed_legs(), legs);
    EXPECT_EQ(state.position_mm, Vec3::Zero());
    rig.device->send(governed(Vec3{1.0, 0.0, 0.0}));
    EXPECT_FALSE(rig.board.holds_force()) << "whatever is asked";
    EXPECT_EQ(rig.board.held().flags, FalconCommand::kHoming | FalconCommand::kRed);
  }
  rig.board.home(falcon_counts_at(Vec3{0, 0, 30}));
  const DeviceState homed = rig.exchange();
  EXPECT_TRUE(homed.homed);
  EXPECT_LT((homed.position_mm - Vec3(0, 0, 30)).norm(), 0.1);
}

TEST(FalconDevice, EveryEndLetsTheMotorsGo) {
  FalconRig rig;
  FalconRig::prepared(rig.board);
  const auto left_over = [&] { rig.board.out(encoded(FalconCommand{{500, 0, 0}, 1}), rig.clock.now_ns()); };
  rig.board.control({0x40, 0x03, 0x0002, 0}, 0);
  left_over();
  ASSERT_TRUE(rig.board.holds_force());
  ASSERT_TRUE(rig.device->open());
  EXPECT_FALSE(rig.board.holds_force()) << "what an earlier program left";
  left_over();
  EXPECT_TRUE(rig.device->cut_force());
  EXPECT_FALSE(rig.board.holds_force());
  left_over();
  rig.device->close();
  EXPECT_FALSE(rig.board.holds_force());
  EXPECT_FALSE(rig.device->cut_force()) << "closed";
  ASSERT_TRUE(rig.device->open());
  left_over();
  rig.device.reset();
  EXPECT_FALSE(rig.board.holds_force()) << "the destructor";
}

TEST(FalconDevice, AnglesThatNoPlaceHasHoldThePositionThenAreGarbled) {
  OpenFalcon rig;
  const Vec3 before = rig.exchange().position_mm;
  rig.board.faults.jump = {20'000, -20'000, 20'000};
  std::vector<ReadStatus> seen;
  for (int i = 0; i < 3; ++i) {
    const DeviceState state = rig.exchange();
    EXPECT_EQ(state.position_mm, before);
    seen.push_back(state.status);
  }
  EXPECT_EQ(seen, (std::vector{ReadStatus::kNothingNew, ReadStatus::kNothingNew, ReadStatus::kGarbled}));
  EXPECT_EQ(rig.device->counters().unreachable, 3u);
  rig.board.faults = {};
  EXPECT_EQ(rig.exchange().status, ReadStatus::kFresh);
}

TEST(FalconDevice, AFlagThatDropsInOneOfManyRepliesHasDropped) {
  OpenFalcon rig;
  ASSERT_TRUE(rig.exchange().homed);
  rig.device->cut_force();
  rig.board.faults.lost_homing = true;
  rig.device->cut_force();
  rig.board.faults.lost_homing = false;
  rig.device->cut_force();
  rig.clock.advance(2e-3);
  EXPECT_FALSE(rig.device->read().homed);
}

// The whole chain: servo, governor, watchdog.

struct PressRig : FalconRig {
  PressRig() : plane(0.2), servo(plane, {}, *device, clock, {}), watchdog(*device, heart) {
    FalconRig::prepared(board);
    servo.watched_by(&heart);
    EXPECT_TRUE(servo.start().ok());
    for (int i = 0; i < 10; ++i) tick();
    for (int step = 0; step <= 50; ++step) {  // slowly into the plane z = 0
      board.counts = falcon_counts_at(Vec3{0, 0, 1.0 - 0.1 * step});
      tick();
    }
    for (int i = 0; i < 700; ++i) tick();
    EXPECT_TRUE(board.holds_force()) << "it presses";
    EXPECT_EQ(servo.governor()->fault(), Fault::kNone);
  }
  Tick tick() {
    clock.advance(1e-3);
    const Tick tick = servo.tick();
    watchdog.look(clock.now_ns());
    return tick;
  }
  /// Ticks until a fault; how many, and none of what follows pushes.
  std::pair<Fault, int> fault_after(int most_ticks) {
    for (int i = 1; i <= most_ticks; ++i) {
      const Tick now = tick();
      if (now.fault == Fault::kNone) continue;
      EXPECT_EQ(now.sent_n, Vec3::Zero());
      for (int after = 0; after < 50; ++after) {
        EXPECT_EQ(tick().sent_n, Vec3::Zero());
        EXPECT_TRUE(link->unplugged || !board.holds_force());
      }
      return {now.fault, i};
    }
    return {Fault::kNone, most_ticks};
  }
  SpringPlane plane;
  Heartbeat heart;
  Servo servo;
  Watchdog watchdog;
};

TEST(FalconFaults, EachIsSeenAndFollowedByZero) {
  struct Row {
    const char* name;
    void (*spoil)(PressRig&);
    Fault fault;
    int least_ms, most_ms;
  };
  const Row rows[] = {
      {"silent", [](PressRig& rig) { rig.board.faults.silent = true; }, Fault::kSilence, 20, 24},
      {"garbled", [](PressRig& rig) { rig.board.faults.garbled = true; }, Fault::kGarbled, 1, 6},
      {"unplugged", [](PressRig& rig) { rig.link->unplugged = true; }, Fault::kLost, 1, 1},
      {"homing", [](PressRig& rig) { rig.board.faults.lost_homing = true; }, Fault::kHomingLost, 1, 3},
      {"jump",
       [](PressRig& rig) {
         const std::array<int, 3> far = falcon_counts_at(Vec3{0, 12, -4});
         for (std::size_t leg = 0; leg < 3; ++leg)
           rig.board.faults.jump[leg] = far[leg] - rig.board.counts[leg];
       },
       Fault::kJump, 1, 3},
      {"lie",
       [](PressRig& rig) {
         rig.board.faults.jump = {20'000, -20'000, 20'000};
       },
       Fault::kGarbled, 1, 6}};
  for (const Row& row : rows) {
    SCOPED_TRACE(row.name);
    PressRig rig;
    row.spoil(rig);
    const auto [fault, ms] = rig.fault_after(40);
    EXPECT_EQ(fault, row.fault);
    EXPECT_TRUE(ms >= row.least_ms && ms <= row.most_ms) << ms;
  }
}

TEST(FalconFaults, WhatPassesSoonIsFeltThrough) {
  for (const bool garbled : {false, true}) {
    PressRig rig;
    (garbled ? rig.board.faults.garbled : rig.board.faults.silent) = true;
    for (int i = 0; i < (garbled ? 1 : 10); ++i) EXPECT_EQ(rig.tick().fault, Fault::kNone);
    rig.board.faults = {};
    for (int i = 0; i < 200; ++i) EXPECT_EQ(rig.tick().fault, Fault::kNone);
    EXPECT_TRUE(rig.board.holds_force());
  }
}

TEST(FalconFaults, AStuckServoIsZeroedByTheWatchdog) {
  PressRig rig;
  for (int i = 0; i < 12; ++i) {
    rig.clock.advance(1e-3);
    rig.watchdog.look(rig.clock.now_ns());
  }
  EXPECT_FALSE(rig.board.holds_force());
  EXPECT_EQ(rig.fault_after(2).first, Fault::kStalled);
}

using Options = std::vector<std::pair<std::string, std::string>>;

Result<MadeDevice> made_falcon(const std::string& name, Options options = {},
                               const std::string& description = {}) {
  static const MonotonicClock clock;
  return driver_of(&register_falcon_driver, name).make({name, description, std::move(options)}, clock);
}

std::string problem(const std::string& name, Options options = {}, const std::string& description = {}) {
  const auto made = made_falcon(name, std::move(options), description);
  return made ? std::string("fine") : made.error().message();
}

TEST(FalconDriver, MakesADeviceThatIsNotOpen) {
  const auto made = value_of(made_falcon("falcon"));
  EXPECT_EQ(made.device->name(), "falcon");
  EXPECT_EQ(made.device->limits().force_max_n, 2.0);
  EXPECT_EQ(made.device->read().status, ReadStatus::kLost);
  EXPECT_FALSE(made.device->cut_force());
  EXPECT_TRUE(made.zero);
  EXPECT_GE(made.unproven.size(), 4u);
}

TEST(FalconDriver, CalibratedItIsStrongerAndDoubtsLess) {
  const auto made = value_of(made_falcon(
      "falcon:A7", {{"k", "3.6"}, {"calibrated", "yes"}, {"event-character", "off"}, {"firmware", "f.bin"}}));
  EXPECT_EQ(made.device->limits().force_max_n, 8.0);
  EXPECT_EQ(made.unproven.size(), 3u);
  EXPECT_EQ(made_falcon("falcon", {{"event-character", "on"}})->unproven.size(), 5u);
}

TEST(FalconDriver, SaysWhatIsNotRight) {
  EXPECT_TRUE(says(problem("falcon", {{"colour", "red"}}), "no option 'colour'"));
  for (const std::string k : {"0.5", "101", "ten", "nan", ""})
    EXPECT_TRUE(says(problem("falcon", {{"k", k}}), "k: ")) << k;
  EXPECT_TRUE(says(problem("falcon", {{"calibrated", "perhaps"}}), "calibrated is 'perhaps'"));
  EXPECT_TRUE(says(problem("falcon", {{"calibrated", "yes"}}), "give k=COUNTS too"));
  EXPECT_TRUE(says(problem("falcon", {{"firmware", ""}}), "firmware=FILE"));
  EXPECT_TRUE(says(problem("falcon:"), "serial"));
  EXPECT_TRUE(says(problem("falcon", {}, "arm.toml"), "takes no description"));
}

}  // namespace
}  // namespace palpate::device
