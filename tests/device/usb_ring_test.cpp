// What a link's thread hands to frames, with threads at both ends.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <thread>

#include "device/links/packet_ring.h"

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

}  // namespace
}  // namespace palpate::device
