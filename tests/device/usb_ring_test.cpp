// What a link's thread hands to frames, and frames and watchdog to it, with threads at all ends.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <thread>

#include "device/links/newest_command.h"
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

// As a USB link uses it: the servo puts a command in every frame, the watchdog cuts meanwhile, the link's
// thread takes; what a thread has put is never taken after what it put later, and a zero at the end is the
// last.
TEST(NewestCommandOfALink, ServoWatchdogAndLinkAtOnceKeepTheOrderAndEndInTheLastZero) {
  constexpr std::uint32_t kFrames = 30'000, kServo = 1, kCut = 2, kEnd = 3;
  NewestCommand newest;
  std::atomic<int> running{2};
  const auto put_all = [&](std::uint32_t writer) {
    for (std::uint32_t i = 1; i <= kFrames; ++i) EXPECT_TRUE(newest.put(numbered(writer, i)));
    --running;
  };
  std::thread servo([&] { put_all(kServo); }), watchdog([&] { put_all(kCut); });
  std::array<std::uint32_t, 4> last{};
  std::uint32_t writer = 0, number = 0;
  CommandBytes command;
  const auto take_all = [&] {
    while (newest.take(command)) {
      ASSERT_EQ(command.size, 8u);
      std::memcpy(&writer, command.bytes.data(), 4);
      std::memcpy(&number, command.bytes.data() + 4, 4);
      ASSERT_GT(number, last.at(writer)) << "of " << writer;
      last.at(writer) = number;
    }
  };
  while (running.load() > 0) take_all();
  servo.join();
  watchdog.join();
  EXPECT_TRUE(newest.put(numbered(kEnd, 1)));
  take_all();
  EXPECT_EQ(writer, kEnd) << "the zero of close() goes out last";
  EXPECT_TRUE(newest.empty());
}

}  // namespace
}  // namespace palpate::device
