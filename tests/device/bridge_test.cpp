// The UDP bridge on a pretended network and a virtual clock: whatever is lost, late, repeated or garbled, no
// old force comes through.
#include "device/bridge/bridge_device.h"

#include "tests/device/bridge_rig.h"
#include "tests/device/helpers.h"

extern "C" int palpate_fuzz_bridge(const std::uint8_t* data, std::size_t size);  // tests/fuzz/fuzz_bridge.cpp

namespace palpate::device {
namespace {

constexpr int kSoftStartFrames = 700;

Datagram any_datagram(Random& random) {
  constexpr DatagramKind kKinds[] = {DatagramKind::kHello,   DatagramKind::kWelcome, DatagramKind::kBusy,
                                     DatagramKind::kCommand, DatagramKind::kState,   DatagramKind::kRelease,
                                     DatagramKind::kReleased};
  Datagram datagram{.kind = kKinds[random.below(std::size(kKinds))],
                    .session = random.next(),
                    .sequence = static_cast<std::uint32_t>(random.next()),
                    .answers = static_cast<std::uint32_t>(random.next())};
  const double x = random.uniform(-5, 5), y = random.uniform(-5, 5), z = random.uniform(-5, 5);
  if (datagram.kind == DatagramKind::kCommand || datagram.kind == DatagramKind::kState)
    datagram.vector = Vec3{x, y, z};
  if (datagram.kind == DatagramKind::kState) {
    datagram.buttons = static_cast<std::uint32_t>(random.next());
    datagram.age_us = static_cast<std::uint32_t>(random.below(1000));
    datagram.flags = static_cast<std::uint16_t>(random.below(4) | (random.below(4) << 4U));
  }
  if (datagram.kind == DatagramKind::kWelcome) {
    datagram.welcome.limits = {
        3.3, {Vec3::Constant(-50), Vec3::Constant(60)}, 0.05, 1000, 1.5, 0.01, WorkspaceShape::kCylinder};
    datagram.welcome.watchdog_s = datagram.welcome.max_age_s = 0.02;
    datagram.welcome.name_bytes = {'a', 'r', 'm'};
  }
  return datagram;
}

/// Started, and its force is whole.
struct PressingBridge : BridgeRig {
  PressingBridge() {
    EXPECT_TRUE(start().ok());
    frames(kSoftStartFrames, Vec3{1, 0, 0});
    EXPECT_EQ(held.held_n.x(), 1.0);
  }
};

TEST(Datagrams, HaveTheCrcOfEthernet) {
  const std::string_view check = "123456789";
  EXPECT_EQ(crc32_of(std::span(reinterpret_cast<const std::uint8_t*>(check.data()), check.size())),
            0xCBF43926U);
}

TEST(Datagrams, RoundTripAndNoDamagePasses) {
  Random random(3);
  for (int i = 0; i < 3000; ++i) {
    const Datagram datagram = any_datagram(random);
    const DatagramBytes whole(datagram);
    const auto back = decoded_datagram(whole.bytes());
    ASSERT_TRUE(back) << "seed 3, case " << i;
    EXPECT_EQ(back->vector, datagram.vector);
    EXPECT_EQ(back->status(), datagram.status());
    EXPECT_EQ(back->welcome.name(), datagram.welcome.name());
    const DatagramBytes again(*back);
    ASSERT_TRUE(
        std::equal(whole.bytes().begin(), whole.bytes().end(), again.bytes().begin(), again.bytes().end()));
    std::vector<std::uint8_t> damaged(whole.bytes().begin(), whole.bytes().end());
    const std::size_t bits = 8 * damaged.size();
    for (std::size_t k = 0, flips = 1 + random.below(5); k < flips; ++k) {
      const std::size_t bit = (random.below(bits / 8) + k * (bits / 8) + k) % bits;  // never the same twice
      damaged[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    }
    ASSERT_FALSE(decoded_datagram(damaged)) << "seed 3, case " << i;
    ASSERT_FALSE(decoded_datagram(std::span(damaged).first(random.below(damaged.size()))));
  }
}

TEST(Datagrams, ACommandThatIsNotFiniteIsNone) {
  Datagram command{.kind = DatagramKind::kCommand};
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    command.vector = Vec3{0.0, bad, 0.0};
    EXPECT_FALSE(decoded_datagram(DatagramBytes(command).bytes()));
  }
  Datagram welcome{.kind = DatagramKind::kWelcome};
  EXPECT_FALSE(decoded_datagram(DatagramBytes(welcome).bytes())) << "limits of nothing";
}

TEST(Bridge, FeelsTheFarDevice) {
  BridgeRig rig;
  rig.held.state.position_mm = Vec3{1, -2, 3};
  rig.held.state.buttons = 5;
  ASSERT_TRUE(rig.start().ok());
  const DeviceLimits limits = rig.device->limits();
  EXPECT_EQ(limits.force_max_n, 5.0);
  EXPECT_EQ(limits.workspace_mm.high_mm, Vec3::Constant(90.0));
  EXPECT_EQ(limits.workspace_shape, WorkspaceShape::kEllipsoid);
  EXPECT_EQ(rig.device->welcome().name(), "held");
  const Vec3 force_n{0.5, 0.25, -1.0};
  rig.frames(kSoftStartFrames, force_n);
  const DeviceState seen = rig.frame(force_n);
  EXPECT_EQ(seen.status, ReadStatus::kFresh);
  EXPECT_EQ(seen.position_mm, Vec3(1, -2, 3));
  EXPECT_EQ(seen.buttons, 5u);
  EXPECT_EQ(decoded_datagram(std::span(seen.raw.bytes).first(seen.raw.size))->vector, seen.position_mm);
  EXPECT_EQ(rig.held.held_n, force_n) << "exactly, once both soft starts are over";
  EXPECT_LT(rig.device->counters().round_trip_ns, 2'500'000);
  rig.held.state.homed = false;
  rig.frames(3, force_n);
  EXPECT_EQ(rig.governor->fault(), Fault::kHomingLost);
  EXPECT_TRUE(rig.held.held_n.isZero(0.0));
}

// The very thing. Every frame's force tells when it was made; no force is ever held that is older than what
// the far end's two limits allow, and none comes back.
TEST(Bridge, NoOldForceComesThroughInAnyWeather) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    BridgeServerOptions far_options{.slew_n_per_s = 1e6};
    BridgeRig rig(seed, far_options);
    ASSERT_TRUE(rig.start().ok());
    rig.frames(kSoftStartFrames, Vec3{1.0, 0, 0});
    Random random(seed);
    const auto up_to = [&](double most) { return random.uniform(0, most); };
    for (auto* way : {&rig.network.to_far, &rig.network.to_host})
      way->weather = {up_to(0.3), up_to(0.3), up_to(0.2), 0.2e-3, up_to(5e-3), up_to(0.1), 1.0};
    // No ramp times one of these forces is another of them: the numbers have no common measure.
    constexpr double kBaseN = 1.4142135623730951, kStepN = 3.1415926535897932e-4;
    std::vector<double> made_s;
    double newest_n = 0.0;
    int with_force = 0;
    for (int i = 0; i < 4000; ++i) {
      made_s.push_back(rig.clock.now_s());
      if (rig.governor->fault() != Fault::kNone) rig.governor->arm(rig.clock.now_s());
      const double ramp = rig.governor->armed() ? 1.0 : 0.0;
      rig.frame(Vec3{kBaseN + kStepN * i, 0, 0} * ramp);
      const double held_n = rig.held.held_n.x();
      // While a soft start is under way the number says nothing; a whole one is that of its frame.
      const double index = (held_n - kBaseN) / kStepN;
      if (held_n < kBaseN || std::abs(index - std::round(index)) > 1e-8) continue;
      ++with_force;
      ASSERT_GE(held_n, newest_n) << "an old force came back: seed " << seed << ", frame " << i;
      newest_n = held_n;
      const double age_s = rig.clock.now_s() - made_s[static_cast<std::size_t>(std::lround(index))];
      ASSERT_LE(age_s, 0.020 + 0.020 + 2e-3) << "seed " << seed << ", frame " << i;
    }
    EXPECT_GT(rig.far.counters().malformed + rig.far.counters().overtaken, 0u) << "there was weather";
    EXPECT_GT(with_force, 0) << "seed " << seed;
  }
}

TEST(Bridge, AProgramThatDiesIsSilenceAndZeroWithinTheWatchdogsTime) {
  PressingBridge rig;
  rig.network.host_is_gone = true;
  int zero_after = 0;
  while (!rig.held.held_n.isZero(0.0) && zero_after < 100) {
    rig.pass();
    ++zero_after;
  }
  EXPECT_LE(zero_after, 22) << "20 ms, and a tick each way";
  EXPECT_EQ(rig.far.counters().trips, 1u);
  // It was only slow after all: nothing of its force is taken up again until it has commanded zero.
  rig.network.host_is_gone = false;
  for (int i = 0; i < 15; ++i) {
    rig.device->send(rig.governor->govern(rig.clock.now_s(), rig.device->read(), Vec3{1, 0, 0}));
    rig.pass();
    ASSERT_TRUE(rig.held.held_n.isZero(0.0));
  }
}

// What it heard last is 20 ms old by then, and so is what its commands answer.
TEST(Bridge, AHostThatHearsNothingLetsGoInTheFrameInWhichItSeesThat) {
  PressingBridge rig;
  rig.network.to_host.weather.loss = 1.0;
  int frames = 0;
  for (; frames < 100 && rig.governor->fault() == Fault::kNone; ++frames) {
    EXPECT_EQ(rig.held.held_n.x(), 1.0) << "until then the far end has no reason";
    rig.frame(Vec3{1, 0, 0});
  }
  EXPECT_EQ(rig.governor->fault(), Fault::kSilence);
  EXPECT_TRUE(rig.held.held_n.isZero(0.0)) << "by the command of that very frame";
  EXPECT_EQ(rig.far.counters().trips, 0u) << "not by its watchdog";
  EXPECT_GT(rig.far.counters().old, 0u);
  // An old zero lets go, and no more: force is not obeyed before a zero that is new.
  rig.frames(100, Vec3{1, 0, 0});
  EXPECT_FALSE(rig.far.governor()->armed());
  rig.network.to_host.weather.loss = 0.0;
  rig.frames(40, Vec3{1, 0, 0});
  rig.governor->arm(rig.clock.now_s());
  rig.frames(kSoftStartFrames, Vec3{1, 0, 0});
  EXPECT_EQ(rig.held.held_n.x(), 1.0);
}

TEST(Bridge, AFarEndThatTrippedIsSilenceHereAndBothBeginSoftly) {
  PressingBridge rig;
  rig.network.to_far.weather.loss = 1.0;
  rig.frames(25, Vec3{1, 0, 0});
  rig.network.to_far.weather.loss = 0.0;
  EXPECT_TRUE(rig.held.held_n.isZero(0.0));
  rig.frames(40, Vec3{1, 0, 0});
  EXPECT_EQ(rig.governor->fault(), Fault::kSilence);
  EXPECT_TRUE(rig.held.held_n.isZero(0.0)) << "until somebody re-arms it";
  rig.governor->arm(rig.clock.now_s());
  double before_n = 0.0;
  for (int i = 0; i < kSoftStartFrames; ++i) {
    rig.frame(Vec3{1, 0, 0});
    ASSERT_LE(rig.held.held_n.x() - before_n, 0.01) << "no step";
    before_n = rig.held.held_n.x();
  }
  EXPECT_EQ(rig.held.held_n.x(), 1.0);
}

TEST(Bridge, StatesThatAreOldOrRepeatedAreSilence) {
  PressingBridge rig;
  const std::vector<PretendedNetwork::Bytes> all = rig.network.to_host.kept;
  rig.network.to_host.weather.loss = 1.0;
  for (int i = 0; i < 30; ++i) {
    rig.network.fly(rig.network.to_host, all[all.size() - 1 - static_cast<std::size_t>(i)], 0.0);
    rig.frame(Vec3{1, 0, 0});
  }
  EXPECT_EQ(rig.governor->fault(), Fault::kSilence);
  EXPECT_GT(rig.device->counters().overtaken, 20u);
  // A network that holds everything back for 50 ms keeps the order, and all is old.
  PressingBridge slow;
  slow.network.to_far.weather.delay_s = 0.025;
  slow.network.to_host.weather.delay_s = 0.025;
  slow.frames(200, Vec3{1, 0, 0});
  EXPECT_NE(slow.governor->fault(), Fault::kNone);
  EXPECT_TRUE(slow.held.held_n.isZero(0.0));
  EXPECT_GT(slow.far.counters().old, 50u);
}

TEST(Bridge, OldCommandsPlayedAgainMoveNothing) {
  PressingBridge rig;
  const std::vector<PretendedNetwork::Bytes> all = rig.network.to_far.kept;
  rig.device->close();
  EXPECT_TRUE(rig.held.held_n.isZero(0.0)) << "closing lets go";
  for (const auto& bytes : all) {
    rig.network.fly(rig.network.to_far, bytes, 0.0);
    rig.pass();
    ASSERT_TRUE(rig.held.held_n.isZero(0.0));
  }
  // A program that comes later is not disturbed by them either.
  BridgeOptions options{.session = 77};
  options.wait = [&] { rig.pass(); };
  for (int i = 0; i < 1100; ++i) rig.pass();  // the old session ends
  BridgeDevice later(std::make_unique<PretendedLink>(rig.network), rig.clock, options);
  ASSERT_TRUE(later.open().ok());
  for (const auto& bytes : all) rig.network.fly(rig.network.to_far, bytes, 0.0);
  for (int i = 0; i < 50; ++i) {
    rig.pass();
    ASSERT_TRUE(rig.held.held_n.isZero(0.0));
  }
  EXPECT_GT(rig.far.counters().strange, 500u);
}

TEST(Bridge, CutForceLetsGoAtOnceAlsoWhenClosed) {
  PressingBridge rig;
  EXPECT_TRUE(rig.device->cut_force());
  rig.pass();
  rig.pass();
  EXPECT_TRUE(rig.held.held_n.isZero(0.0));
  EXPECT_GE(rig.held.cuts, 1);
  rig.device->close();
  EXPECT_TRUE(rig.device->cut_force());
}

TEST(Bridge, SaysWhyItDoesNotOpen) {
  BridgeRig nobody;
  nobody.far_ticks = false;
  EXPECT_TRUE(refused(nobody.device->open(), "palpate live serve"));

  BridgeRig taken;
  ASSERT_TRUE(taken.device->open().ok());
  BridgeOptions other{.session = 5};
  other.wait = [&] {
    taken.device->send(ForceGovernor::create(taken.device->limits(), {}).value().zero());
    taken.pass();
  };
  BridgeDevice second(std::make_unique<PretendedLink>(taken.network), taken.clock, other);
  EXPECT_TRUE(refused(second.open(), "another program"));

  BridgeRig unplugged;
  unplugged.held.state.status = ReadStatus::kLost;
  EXPECT_TRUE(refused(unplugged.device->open(), "its device is not"));

  BridgeRig far_away;
  far_away.network.to_far.weather.delay_s = far_away.network.to_host.weather.delay_s = 0.030;
  EXPECT_TRUE(refused(far_away.device->open(), "20 ms"));
}

TEST(Bridge, ALostFarDeviceIsLostHere) {
  BridgeRig rig;
  ASSERT_TRUE(rig.start().ok());
  rig.frames(10, Vec3::Zero());
  rig.held.state.status = ReadStatus::kLost;
  rig.frames(3, Vec3::Zero());
  EXPECT_EQ(rig.governor->fault(), Fault::kLost);
  rig.held.state.status = ReadStatus::kFresh;
  rig.frames(3, Vec3::Zero());
  rig.held.state.position_mm.x() = std::numeric_limits<double>::quiet_NaN();
  rig.governor->arm(rig.clock.now_s());
  rig.frames(30, Vec3{1, 0, 0});
  EXPECT_TRUE(rig.held.held_n.isZero(0.0));
  EXPECT_NE(rig.governor->fault(), Fault::kNone) << "a position that is none never gets force";
}

TEST(Bridge, NoiseIsGarbled) {
  BridgeRig rig;
  ASSERT_TRUE(rig.start().ok());
  rig.network.to_host.weather.garbled = 1.0;
  rig.frames(6, Vec3::Zero());
  EXPECT_EQ(rig.governor->fault(), Fault::kGarbled);
}

TEST(BridgeDriver, MakesFromItsNameAndRefusesOthers) {
  const Driver driver = driver_of(&register_bridge_driver, "bridge:localhost:47800");
  EXPECT_EQ(driver.look().front().status, DeviceStatus::kMissing);
  const MonotonicClock clock;
  for (const char* good : {"bridge:localhost:47800", "bridge:localhost", "bridge:[::1]:5", "bridge:[::1]"}) {
    const Result<MadeDevice> made = driver.make({good, {}, {{"most-age-ms", "30"}}}, clock);
    ASSERT_TRUE(made) << good << ": " << made.error().message();
    EXPECT_EQ(made->device->name(), good);
    EXPECT_TRUE(made->zero);
    EXPECT_EQ(made->facts().front().first, "far_device");
  }
  for (const char* bad : {"bridge:", "bridge", "bridge:a:b", "bridge:a:70000", "bridge:::1:5", "bridge::5"})
    EXPECT_FALSE(driver.make({bad, {}, {}}, clock)) << bad;
  EXPECT_FALSE(driver.make({"bridge:a", {}, {{"speed", "1"}}}, clock));
  EXPECT_FALSE(driver.make({"bridge:a", {}, {{"most-age-ms", "x"}}}, clock));
  EXPECT_FALSE(driver.make({"bridge:a", "file.toml", {}}, clock));
}

TEST(BridgeFuzz, TheCorpusIsRead) {
  expect_corpus_passes(&palpate_fuzz_bridge, PALPATE_SOURCE_ROOT "/tests/corpus/bridge", 7);
  Random random(17);
  for (int run = 0; run < 400; ++run) {
    const DatagramBytes whole(any_datagram(random));
    std::vector<std::uint8_t> input(whole.bytes().begin(), whole.bytes().end());
    if (random.below(2) == 0) input[random.below(input.size())] ^= static_cast<std::uint8_t>(random.next());
    ASSERT_EQ(palpate_fuzz_bridge(input.data(), input.size()), 0) << "seed 17, run " << run;
  }
}

}  // namespace
}  // namespace palpate::device
