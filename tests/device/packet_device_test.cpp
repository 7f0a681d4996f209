// Packets, the simulated link and the device over it.
#include "device/simulated/packet_device.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <utility>
#include <vector>

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
  Packet packet;
  packet.kind = random.below(2) == 0 ? PacketKind::kState : PacketKind::kCommand;
  packet.sequence = static_cast<std::uint16_t>(random.below(65536));
  for (std::int16_t& count : packet.counts)
    count = static_cast<std::int16_t>(static_cast<int>(random.below(65536)) - 32768);
  packet.flags = static_cast<std::uint8_t>(random.below(32));
  return packet;
}

TEST(Packets, AKnownOneHasTheseBytes) {
  Packet packet;
  packet.sequence = 0x1234;
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
  Random random(11);
  for (int run = 0; run < 200; ++run) {
    PacketReader reader;
    std::vector<Packet> sent, got;
    std::vector<std::uint8_t> stream;
    for (int i = 0; i < 20; ++i) {
      // Dirt without a start: a false start may swallow what follows it, as it must.
      for (std::size_t k = random.below(20); k > 0; --k)
        stream.push_back(static_cast<std::uint8_t>(random.below(0xA5)));
      sent.push_back(any_packet(random));
      const PacketBytes bytes = encoded(sent.back());
      stream.insert(stream.end(), bytes.begin(), bytes.end());
    }
    for (const std::uint8_t byte : stream)
      if (const auto packet = reader.take(byte)) got.push_back(*packet);
    ASSERT_EQ(got, sent) << "seed 11, run " << run;
  }
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

// The fuzz target aborts where something is wrong.
TEST(PacketReader, TheFuzzCorpusIsRead) {
  const auto corpus = corpus_of(PALPATE_SOURCE_ROOT "/tests/corpus/packets");
  EXPECT_GE(corpus.size(), 7u);
  for (const auto& bytes : corpus) EXPECT_EQ(LLVMFuzzerTestOneInput(bytes.data(), bytes.size()), 0);
  Random random(17);
  for (int run = 0; run < 2000; ++run) {
    // Mostly starts, packets and torn ones: plain noise holds none.
    std::vector<std::uint8_t> stream;
    while (stream.size() < 100) {
      const PacketBytes bytes = encoded(any_packet(random));
      const std::size_t from = random.below(3) == 0 ? random.below(kPacketBytes) : 0;
      const std::size_t to = random.below(3) == 0 ? random.below(kPacketBytes + 1) : kPacketBytes;
      for (std::size_t i = from; i < to; ++i) stream.push_back(bytes[i]);
      if (random.below(4) == 0) stream.push_back(0xA5);
    }
    ASSERT_EQ(LLVMFuzzerTestOneInput(stream.data(), stream.size()), 0) << "seed 17, run " << run;
  }
}

struct LinkRig {
  explicit LinkRig(std::vector<LinkFault> faults = {}, const SimulatedLinkOptions& options = {})
      : link(board, script, clock, options, std::move(faults)), device(link, clock) {}
  VirtualClock clock;
  SimulatedBoard board;
  HandScript script =
      HandScript::create("ramp", {0.0, 1.0}, {Vec3::Zero(), Vec3{10, -20, 5}}, HandScript::Between::kStraight)
          .value();
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
    Packet old;
    old.kind = PacketKind::kCommand;
    old.counts = {100, 0, 0};
    rig.board.command(encoded(old), 0);
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

TEST(PacketDevice, SaysWhatIsWrong) {
  using Kind = LinkFault::Kind;
  const auto after = [](Kind kind, int ms) {
    LinkRig rig({LinkFault{kind, 0.0995, 10.0}});
    EXPECT_TRUE(rig.device.open().ok());
    DeviceState state;
    for (int i = 0; i <= 100 + ms; ++i) {
      state = rig.device.read();
      rig.clock.advance(1e-3);
    }
    return state;
  };
  EXPECT_EQ(after(Kind::kSilent, 0).status, ReadStatus::kNothingNew);
  EXPECT_EQ(after(Kind::kShort, 10).status, ReadStatus::kGarbled);
  EXPECT_EQ(after(Kind::kDuplicated, 3).status, ReadStatus::kNothingNew);
  EXPECT_EQ(after(Kind::kLate, 10).status, ReadStatus::kNothingNew);
  EXPECT_EQ(after(Kind::kLate, 40).status, ReadStatus::kFresh) << "late, but new";
  EXPECT_EQ(after(Kind::kUnplugged, 0).status, ReadStatus::kLost);
  EXPECT_FALSE(after(Kind::kUnhomed, 0).homed);
  EXPECT_NEAR(after(Kind::kJump, 0).position_mm.x(), 61.0, 1e-9);
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

}  // namespace
}  // namespace palpate::device
