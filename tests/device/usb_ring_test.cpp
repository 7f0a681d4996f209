// What frames and a link's thread hand each other, with threads at both ends.
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <thread>
#include <vector>

#include "device/links/packet_rings.h"

namespace palpate::device {
namespace {

std::array<std::uint8_t, 8> numbered(std::uint32_t writer, std::uint32_t number) {
  std::array<std::uint8_t, 8> bytes{};
  std::memcpy(bytes.data(), &writer, 4);
  std::memcpy(bytes.data() + 4, &number, 4);
  return bytes;
}

TEST(PacketRing, IsFullAndEmptyWhereItSays) {
  PacketRing<4> ring;
  EXPECT_EQ(ring.front(), nullptr);
  for (int round = 0; round < 3; ++round) {
    for (std::uint32_t i = 0; i < 4; ++i) EXPECT_TRUE(ring.push(numbered(1, i)));
    EXPECT_FALSE(ring.push(numbered(1, 9)));
    for (std::uint32_t i = 0; i < 4; ++i) {
      ASSERT_NE(ring.front(), nullptr);
      EXPECT_EQ(ring.front()->size, 8u);
      EXPECT_EQ(ring.front()->bytes[4], i);
      ring.drop();
    }
    EXPECT_EQ(ring.front(), nullptr);
  }
  const std::array<std::uint8_t, kLinkPacketBytes + 1> long_one{};
  EXPECT_FALSE(ring.push(long_one));
}

TEST(PacketRing, BetweenTwoThreadsNothingIsTornOrChanged) {
  constexpr std::uint32_t kMany = 50'000;
  PacketRing<8> ring;
  std::thread writer([&] {
    for (std::uint32_t i = 0; i < kMany;)
      if (ring.push(numbered(~i, i)))
        ++i;
      else
        std::this_thread::yield();
  });
  for (std::uint32_t i = 0; i < kMany;) {
    const LinkPacket* packet = ring.front();
    if (packet == nullptr) {
      std::this_thread::yield();
      continue;
    }
    const auto expected = numbered(~i, i);
    EXPECT_TRUE(std::equal(expected.begin(), expected.end(), packet->bytes.begin())) << i;
    ring.drop();
    ++i;
  }
  writer.join();
}

TEST(CommandQueue, KeepsTheOrderAndRefusesWhenFull) {
  CommandQueue<4> queue;
  LinkPacket packet;
  EXPECT_FALSE(queue.pop(packet));
  for (std::uint32_t i = 0; i < 4; ++i) EXPECT_TRUE(queue.push(numbered(1, i)));
  EXPECT_FALSE(queue.push(numbered(1, 9)));
  for (std::uint32_t round = 0; round < 10; ++round) {
    ASSERT_TRUE(queue.pop(packet));
    EXPECT_EQ(packet.bytes[4], round);
    EXPECT_TRUE(queue.push(numbered(1, 4 + round)));
    EXPECT_FALSE(queue.push(numbered(1, 99)));
  }
  const std::array<std::uint8_t, kLinkPacketBytes + 1> long_one{};
  EXPECT_FALSE(queue.push(long_one));
}

TEST(CommandQueue, ServoAndWatchdogAtOnceLoseAndTearNothing) {
  constexpr std::uint32_t kMany = 20'000, kWriters = 3;
  CommandQueue<8> queue;
  std::vector<std::thread> writers;
  for (std::uint32_t writer = 0; writer < kWriters; ++writer)
    writers.emplace_back([&queue, writer] {
      for (std::uint32_t i = 0; i < kMany;)
        if (queue.push(numbered(writer, i)))
          ++i;
        else
          std::this_thread::yield();
    });
  std::array<std::uint32_t, kWriters> next{};
  LinkPacket packet;
  for (std::uint32_t taken = 0; taken < kWriters * kMany;) {
    if (!queue.pop(packet)) {
      std::this_thread::yield();
      continue;
    }
    std::uint32_t writer = 0, number = 0;
    std::memcpy(&writer, packet.bytes.data(), 4);
    std::memcpy(&number, packet.bytes.data() + 4, 4);
    ASSERT_LT(writer, kWriters);
    ASSERT_EQ(number, next[writer]++) << "each writer's own order";
    ++taken;
  }
  for (std::thread& writer : writers) writer.join();
  EXPECT_FALSE(queue.pop(packet));
}

}  // namespace
}  // namespace palpate::device
