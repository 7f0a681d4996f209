// Packets, the simulated link and the device over it.
#include "device/simulated/packet_device.h"

#include <array>
#include <cmath>
#include <numbers>

#include "device/simulated/simulated_arm.h"
#include "device/simulated/simulated_link.h"
#include "tests/device/helpers.h"
#include "tests/device/hid_fake_link.h"
#include "tests/device/rig.h"
#include "toolkit/core/random.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data,
                                      std::size_t size);  // tests/fuzz/fuzz_packets.cpp

namespace palpate::device {
namespace {

Packet any_packet(Random& random) {
  Packet packet{.kind = random.below(2) == 0 ? PacketKind::kState : PacketKind::kCommand,
                .sequence = static_cast<std::uint16_t>(random.below(65536))};
  for (std::int16_t& count : packet.counts)
    count = static_cast<std::int16_t>(static_cast<int>(random.below(65536)) - 32768);
  packet.flags = static_cast<std::uint8_t>(random.below(32));
  return packet;
}

TEST(Packets, AKnownOneHasTheseBytes) {
  Packet packet{.sequence = 0x1234};
  packet.counts = {1, -2, 300};
  packet.flags = Packet::kHomed | 5;
  const PacketBytes bytes = encoded(packet);
  const PacketBytes expected = {0xA5, 0x53, 0x34, 0x12, 0x01, 0x00, 0xFE, 0xFF, 0x2C, 0x01, 0x15, 0x00};
  for (std::size_t i = 0; i < 12; ++i) EXPECT_EQ(bytes[i], expected[i]) << i;
  // The check value of CRC-16/CCITT-FALSE over "123456789" is 0x29B1: by hand here, for the twelve bytes.
  std::uint32_t crc = 0xFFFF;
  for (std::size_t i = 0; i < 12; ++i)
    for (int bit = 7; bit >= 0; --bit) {
      const bool carry = (((crc >> 15U) ^ (static_cast<unsigned>(bytes[i]) >> bit)) & 1U) != 0;
      crc = ((crc << 1U) ^ (carry ? 0x1021U : 0U)) & 0xFFFFU;
    }
  EXPECT_EQ(bytes[12] | (bytes[13] << 8), static_cast<int>(crc));
}

TEST(Packets, RoundTripAndNoDamageOfThreeBitsPasses) {
  Random random(3);
  for (int i = 0; i < 2000; ++i) {
    const Packet packet = any_packet(random);
    PacketBytes bytes = encoded(packet);
    ASSERT_EQ(decoded(bytes), packet);
    const std::size_t flips = 1 + random.below(3);
    for (std::size_t k = 0; k < flips; ++k) {
      const std::size_t bit = (random.below(37) + 37 * k) % 112;  // never the same twice
      bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    }
    ASSERT_FALSE(decoded(bytes)) << "seed 3, case " << i;
  }
}

TEST(PacketReader, FindsEveryPacketHoweverTheStreamIsTornAndDirty) {
  expect_found_in_dirt<PacketReader>(0xA5, any_packet);
}

TEST(PacketReader, APacketWithinADamagedOneIsFound) {
  Random random(5);
  const Packet whole = any_packet(random);
  const PacketBytes bytes = encoded(whole);
  for (std::size_t kept = 1; kept < kPacketBytes; ++kept) {
    PacketReader reader;
    std::optional<Packet> got;
    for (std::size_t i = 0; i < kept; ++i) EXPECT_FALSE(reader.take(bytes[i]));  // torn off
    for (int times = 0; times < 2; ++times)
      for (const std::uint8_t byte : bytes)
        if (const auto packet = reader.take(byte)) got = packet;
    EXPECT_EQ(got, whole) << kept;
    EXPECT_EQ(reader.malformed_in_a_row(), 0u);
  }
}

TEST(PacketReader, TheFuzzCorpusIsRead) {
  expect_corpus_passes(&LLVMFuzzerTestOneInput, PALPATE_SOURCE_ROOT "/tests/corpus/packets", 7);
  Random random(17);
  for (int run = 0; run < 2000; ++run) {
    const std::vector<std::uint8_t> stream = torn_stream(random, 0xA5, any_packet);
    ASSERT_EQ(LLVMFuzzerTestOneInput(stream.data(), stream.size()), 0) << "seed 17, run " << run;
  }
}

struct LinkRig {
  explicit LinkRig(std::vector<LinkFault> faults = {}, const SimulatedLinkOptions& options = {})
      : link(board, script, clock, options, std::move(faults)), device(link, clock) {}
  VirtualClock clock;
  SimulatedBoard board;
  HandScript script = straight(Vec3::Zero(), Vec3{10, -20, 5});
  SimulatedLink link;
  PacketDevice device;
};

TEST(PacketDevice, ReadsPositionsInCountsWithTheirBytesAndTimes) {
  LinkRig rig;
  ASSERT_TRUE(rig.device.open());
  rig.clock.advance(0.5);
  const DeviceState state = rig.device.read();
  EXPECT_EQ(state.status, ReadStatus::kFresh);
  EXPECT_EQ(state.position_mm, Vec3(5, -10, 2.5));
  EXPECT_EQ(state.packet_ns, 500'000'000);
  EXPECT_TRUE(state.homed);
  ASSERT_EQ(state.raw.size, kPacketBytes);
  EXPECT_EQ(decoded(std::span(state.raw.bytes).first<kPacketBytes>())->sequence, 500);
  EXPECT_EQ(rig.device.read().status, ReadStatus::kNothingNew);
  rig.clock.advance(1e-3);
  EXPECT_EQ(rig.device.read().status, ReadStatus::kFresh);
}

TEST(PacketDevice, CommandsForcesAndHoldsThemUntilTold) {
  LinkRig rig;
  ASSERT_TRUE(rig.device.open());
  rig.device.send(governed(Vec3{0.5, -1.25, 0.001}));
  EXPECT_EQ(rig.board.held(), (SimulatedBoard::Counts{500, -1250, 1}));
  rig.clock.advance(100.0);
  EXPECT_TRUE(rig.board.holds_force()) << "for ever";
  EXPECT_TRUE(rig.device.cut_force());
  EXPECT_FALSE(rig.board.holds_force());
  EXPECT_EQ(rig.board.refused(), 0u);
}

TEST(PacketDevice, AForceBeyondItsCountsKeepsItsDirectionAndNeverWraps) {
  VirtualClock clock;
  SimulatedBoard board;
  const HandScript script = resting_at(Vec3::Zero());
  SimulatedLink link(board, script, clock);
  PacketDeviceOptions fine;
  fine.n_per_count = 1e-5;  // 32767 of them are 0.33 N
  PacketDevice device(link, clock, fine);
  ASSERT_TRUE(device.open());
  device.send(governed(Vec3{1.5, -0.75, 0}));
  EXPECT_EQ(board.held()[0], 32767);
  EXPECT_NEAR(board.held()[1], -16383.5, 1.0);
}

TEST(PacketDevice, OpeningAndEveryEndLetsTheMotorsGo) {
  LinkRig rig;
  const auto left_over = [&] {
    rig.board.command(encoded(Packet{.kind = PacketKind::kCommand, .counts = {100, 0, 0}}), 0);
  };
  left_over();
  ASSERT_TRUE(rig.device.open());
  EXPECT_FALSE(rig.board.holds_force()) << "what an earlier program left";
  left_over();
  rig.device.close();
  EXPECT_FALSE(rig.board.holds_force());
  {
    PacketDevice gone(rig.link, rig.clock);
    ASSERT_TRUE(gone.open());
    left_over();
  }
  EXPECT_FALSE(rig.board.holds_force()) << "the destructor";
  left_over();
  EXPECT_TRUE(rig.device.cut_force()) << "closed, and yet";
  EXPECT_FALSE(rig.board.holds_force());
}

TEST(PacketDevice, TheSequenceMayWrap) {
  LinkRig rig;
  ASSERT_TRUE(rig.device.open());
  for (int i = 0; i < 70'000; ++i) {
    ASSERT_EQ(rig.device.read().status, ReadStatus::kFresh) << i;
    rig.clock.advance(1e-3);
  }
}

TEST(SimulatedLink, RefusesWhatIsNotRight) {
  LinkRig rig({}, {.rate_hz = 0.0});
  EXPECT_FALSE(rig.device.open());
  LinkRig unplugged;
  unplugged.board.unplug(0);
  EXPECT_FALSE(unplugged.device.open());
  EXPECT_FALSE(unplugged.device.cut_force());
  const std::array<std::uint8_t, 3> noise = {1, 2, 3};
  LinkRig noisy;
  EXPECT_TRUE(noisy.link.submit(noise));
  EXPECT_EQ(noisy.board.refused(), 1u);
}

// ---- The physics of the simulated devices against closed forms.

ArmOptions bare_arm() {
  return {.force_max_n = 1e6};
}

TEST(Motion, FreeDecayOfAVelocity) {
  const Plant plant{0.045, 0.0003, 0.0, 0.0};
  const double rate = 0.0003 / (0.045 * 1e-3);  // 1/s
  const Motion to = moved(plant, {Vec3(1e6, -3, 0), Vec3(100, -20, 7), Vec3::Zero()}, {}, 0.2);
  const double left = std::exp(-rate * 0.2);
  EXPECT_NEAR(to.v_mm_s.x(), 100 * left, 1e-11);
  EXPECT_NEAR(to.v_mm_s.z(), 7 * left, 1e-12);
  EXPECT_NEAR(to.x_mm.y(), -3 - 20 * (1 - left) / rate, 1e-11);
  // A million mm away: the rounding of the coordinate alone.
  EXPECT_NEAR(to.x_mm.x(), 1e6 + 100 * (1 - left) / rate, 1e-9);
}

TEST(Motion, ASpringAndAMassSwingAtTheirFrequency) {
  const double k = 0.4, m = 0.195, omega = std::sqrt(k / (m * 1e-3));
  const Plant plant{m, 0.0, k, 0.0};
  const Motion from{Vec3(2, 0, 0), Vec3::Zero(), Vec3::Zero()};
  const double period_s = 2.0 * std::numbers::pi / omega;
  for (const double share : {0.1, 0.25, 0.5, 1.0, 7.3}) {
    const Motion to = moved(plant, from, {}, share * period_s);
    EXPECT_NEAR(to.x_mm.x(), 2 * std::cos(2 * std::numbers::pi * share), 1e-11) << share;
    EXPECT_NEAR(to.v_mm_s.x(), -2 * omega * std::sin(2 * std::numbers::pi * share), 1e-9) << share;
  }
}

TEST(Motion, AGoalThatMovesPullsAlongAndTheMotorLags) {
  // Critically damped about a ramp: after a long time it follows with the lag 2 / omega of the spring.
  const double m = 0.1, omega = 200.0, k = m * 1e-3 * omega * omega, d = 2 * m * 1e-3 * omega;
  const Motion far =
      moved({m, d, k, 0.0}, {}, {Vec3::Zero(), Vec3::Zero(), Vec3(50, 0, 0), Vec3::Zero()}, 1.0);
  EXPECT_NEAR(far.x_mm.x(), 50 * (1.0 - 2.0 / omega), 1e-9);
  const Motion motor = moved({m, 0, 0, 0.002}, {}, {Vec3(0, 3, 0)}, 0.003);
  EXPECT_NEAR(motor.motor_n.y(), 3 * (1 - std::exp(-1.5)), 1e-14);
  // Twice integrated: F t^2/2 less what the lag withheld.
  const double lag = 0.002, t = 0.003, e = std::exp(-t / lag);
  EXPECT_NEAR(motor.x_mm.y(), 3 / (m * 1e-3) * (0.5 * t * t - lag * t + lag * lag * (1 - e)), 1e-12);
}

/// An arm alone, without a servo, open.
struct LoneArm {
  LoneArm(const ArmOptions& options, const Hand& hand, HandScript moved_by)
      : script(std::move(moved_by)), arm(options, hand, script, clock) {
    EXPECT_TRUE(arm.open());
  }
  /// To `until_s`; a read every millisecond.
  void run(double until_s) {
    while (clock.now_s() < until_s - 1e-9) {
      clock.advance(1e-3);
      (void)arm.read();
    }
  }
  VirtualClock clock;
  HandScript script;
  SimulatedArm arm;
};

TEST(SimulatedArm, FrictionStopsItWhereItsEnergyIsSpent) {
  ArmOptions options = bare_arm();
  options.damping_n_s_per_mm = 0.0;
  options.friction_n = 0.1;
  // A hand that moves at 100 mm/s and lets go: the device flies on with that speed, m v^2 / 2f = 2.25 mm.
  HandScript script = straight(Vec3::Zero(), Vec3(60, 80, 0));
  script.release_s = 0.1;
  LoneArm alone(options, {.guides = true}, script);
  const SimulatedArm& arm = alone.arm;
  alone.run(0.1);
  EXPECT_NEAR(arm.velocity_mm_s().norm(), 100.0, 1e-9);
  const Vec3 from = arm.hip_mm();
  alone.run(0.3);
  const double stop_mm = 0.045 * 1e-3 * 100 * 100 / (2 * 0.1);
  EXPECT_NEAR((arm.hip_mm() - from).norm(), stop_mm, 1e-9);
  EXPECT_EQ(arm.velocity_mm_s(), Vec3::Zero());
  const Vec3 rest = arm.hip_mm();
  alone.run(0.5);
  EXPECT_EQ(arm.hip_mm(), rest) << "nothing creeps";
  // Energy: all of what the hand gave went into friction.
  EXPECT_NEAR(arm.energy().hand(), arm.energy().friction, 1e-12);
  EXPECT_NEAR(arm.energy().friction, 0.1 * (stop_mm + 10.0), 1e-9);
}

TEST(SimulatedArm, APushBelowFrictionMovesNothingAndAboveItAccelerates) {
  for (const double push : {0.0999, 0.1001}) {
    ArmOptions options = bare_arm();
    options.damping_n_s_per_mm = 0.0;
    options.friction_n = 0.1;
    LoneArm alone(options, {.push_n = Vec3(0, 0, -push)}, resting_at(Vec3(0, 0, 1)));
    alone.run(0.5);
    const double way = push > 0.1 ? 0.5 * (push - 0.1) / (0.045 * 1e-3) * 0.25 : 0.0;
    EXPECT_NEAR(alone.arm.hip_mm().z(), 1.0 - way, 1e-9) << push;
  }
}

TEST(SimulatedArm, EnergyIsAccountedForWhereAHandSwings) {
  ArmOptions options = bare_arm();
  options.friction_n = 0.02;
  Hand hand = hand_models()[1];
  hand.damping_n_s_per_mm = 0.0;  // what it holds is then known by its spring alone
  LoneArm alone(options, hand, straight(Vec3::Zero(), Vec3(3, 0, 0), 0.01));
  const SimulatedArm& arm = alone.arm;
  alone.run(0.01);
  const auto stored = [&] {
    return 0.5 * hand.stiffness_n_per_mm * (Vec3(3, 0, 0) - arm.hip_mm()).squaredNorm() +
           0.5 * (hand.mass_kg + options.mass_kg) * 1e-3 * arm.velocity_mm_s().squaredNorm();
  };
  const double before = stored() + arm.energy().friction + arm.energy().damping;
  alone.run(2.0);
  EXPECT_NEAR(stored() + arm.energy().friction + arm.energy().damping, before, 1e-6 * before);
  EXPECT_GT(arm.energy().friction, 0.1 * before);
  EXPECT_GT(arm.energy().damping, 0.01 * before);
}

TEST(SimulatedArm, MeasuresInStepsOfItsEncoder) {
  ArmOptions options = bare_arm();
  options.encoder_mm = 0.055;
  LoneArm alone(options, {.guides = true}, straight(Vec3::Zero(), Vec3(1.1, -2.2, 0.02)));
  SimulatedArm& arm = alone.arm;
  double worst = 0.0;
  for (int i = 0; i < 1000; ++i) {
    const Vec3 seen = arm.read().position_mm;
    for (int a = 0; a < 3; ++a) {
      const double steps = seen[a] / 0.055;
      ASSERT_NEAR(steps, std::round(steps), 1e-9);
      worst = std::max(worst, std::abs(seen[a] - arm.hip_mm()[a]));
    }
    alone.clock.advance(1e-3);
  }
  EXPECT_LE(worst, 0.0275 + 1e-12);
  EXPECT_GT(worst, 0.027);
}

TEST(SimulatedArm, CommandsArriveAfterTheirDelayInTheirOrderAndSaturate) {
  LoneArm alone({.damping_n_s_per_mm = 0.0, .delay_s = 0.0025}, {}, resting_at(Vec3(0, 0, -1)));
  auto& [clock, script, arm] = alone;
  SpringPlane stiff(100.0);
  ForceGovernor governor =
      ForceGovernor::create({1000.0, arm.limits().workspace_mm, 0.0, 1000.0}, {1000.0, 1e12, 1e-9}).value();
  governor.arm(0.0);
  clock.advance(1e-3);
  const DeviceState state = arm.read();
  arm.send(governor.govern(clock.now_s(), state, stiff.step(state.position_mm, 0.0).force_n));
  clock.advance(2.4e-3);
  (void)arm.read();
  EXPECT_EQ(arm.motor_force_n(), Vec3::Zero());
  EXPECT_EQ(arm.hip_mm().z(), -1.0);
  clock.advance(0.6e-3);
  (void)arm.read();
  EXPECT_NEAR((arm.motor_force_n() - Vec3(0, 0, 3.3)).norm(), 0.0, 1e-14) << "100 N were asked for";
  // 0.5 ms of 3.3 N on 45 g.
  EXPECT_NEAR(arm.hip_mm().z(), -1.0 + 0.5 * 3.3 / 0.045e-3 * 0.25e-6, 1e-12);
}

TEST(SimulatedArm, RefusesWhatIsNotRight) {
  VirtualClock clock;
  const HandScript script = resting_at(Vec3::Zero());
  const auto expect_refused = [&](const ArmOptions& options, const Hand& hand, const char* named) {
    SimulatedArm arm(options, hand, script, clock);
    const Status opened = arm.open();
    ASSERT_FALSE(opened);
    EXPECT_TRUE(says(opened.error().what, named));
    EXPECT_EQ(arm.read().status, ReadStatus::kLost);
  };
  expect_refused({.mass_kg = 0.0}, {}, "mass_kg");
  expect_refused({.friction_n = -1}, {}, "friction_n");
  expect_refused({.delay_s = 1.0}, {}, "delay_s");
  expect_refused({.lag_s = 1e-9}, {}, "lag_s");
  expect_refused({}, {.stiffness_n_per_mm = std::nan("")}, "stiffness");
  EXPECT_FALSE(
      HandScript::create("x", {0.0, 0.0}, {Vec3::Zero(), Vec3::Zero()}, HandScript::Between::kStraight));
  EXPECT_FALSE(HandScript::create("x", {}, {}, HandScript::Between::kStraight));
}

TEST(HandScript, AReachOfLeastJerkRestsAtBothEndsAndIsWhereItSaysItMoves) {
  const HandScript script = press({Vec3(1, 2, 3), Vec3(0, 0.6, 0.8), Vec3::UnitX()}, {});
  for (const double t : {0.0, 0.01, 0.1, 0.15, 0.2, 0.29}) {
    const double h = 1e-6;
    const Vec3 slope = (script.at(t + h).position_mm - script.at(t).position_mm) / h;
    EXPECT_NEAR((slope - script.at(t + 0.5 * h).velocity_mm_s).norm(), 0.0, 1e-5) << t;
  }
  EXPECT_NEAR((script.at(0.15).position_mm - Vec3(1, 2, 3)).norm(), 0.0, 1e-12) << "half of the way in";
  EXPECT_EQ(script.at(0.3).velocity_mm_s, Vec3::Zero());
  EXPECT_NEAR((script.at(9.0).position_mm - (Vec3(1, 2, 3) - 2 * Vec3(0, 0.6, 0.8))).norm(), 0.0, 1e-12);
}

}  // namespace
}  // namespace palpate::device
