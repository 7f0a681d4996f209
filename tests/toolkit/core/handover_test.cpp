// Values handed over between two threads.
#include "toolkit/core/handover.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <thread>
#include <vector>

namespace palpate {
namespace {

/// Torn where not all numbers are the same.
using Block = std::array<std::uint64_t, 64>;

Block block(std::uint64_t value) {
  Block b;
  b.fill(value);
  return b;
}

bool whole(const Block& b) {
  return std::all_of(b.begin(), b.end(), [&](std::uint64_t v) { return v == b.front(); });
}

TEST(Handover, StartsWithTheInitialValue) {
  Handover<int> box(7);
  EXPECT_EQ(box.front(), 7);
  EXPECT_FALSE(box.acquire());
  EXPECT_EQ(box.front(), 7);
}

TEST(Handover, NewestWinsAndIsTakenOnce) {
  Handover<int> box;
  for (int i = 1; i <= 5; ++i) box.publish(i);
  EXPECT_EQ(box.front(), 0) << "a value changed before it was taken";
  EXPECT_TRUE(box.acquire());
  EXPECT_EQ(box.front(), 5);
  EXPECT_FALSE(box.acquire());
  EXPECT_EQ(box.front(), 5);
  box.publish(6);
  EXPECT_EQ(box.front(), 5) << "the writer wrote into the reader's slot";
  box.publish(7);
  EXPECT_EQ(box.front(), 5) << "the writer wrote into the reader's slot";
  EXPECT_TRUE(box.acquire());
  EXPECT_EQ(box.front(), 7);
}

/// Every order of eight publications and fetches, against the obvious model.
TEST(Handover, EveryOrderOfCallsGivesTheNewestValue) {
  constexpr unsigned kCalls = 12;
  for (unsigned order = 0; order < (1u << kCalls); ++order) {
    Handover<int> box;
    int published = 0, seen = 0;
    for (unsigned call = 0; call < kCalls; ++call) {
      if ((order >> call & 1u) != 0) {
        box.publish(++published);
      } else {
        EXPECT_EQ(box.acquire(), published != seen);
        seen = published;
      }
      ASSERT_EQ(box.front(), seen) << "order " << order << ", call " << call;
    }
  }
}

TEST(Handover, PreallocatedMemoryIsUsedAgain) {
  Handover<std::vector<double>> box(std::vector<double>(1000));
  std::array<const double*, 3> seen{};
  for (std::size_t i = 0; i < 30; ++i) {
    box.back().assign(1000, static_cast<double>(i));
    const double* const memory = box.back().data();
    if (i < 3)
      seen[i] = memory;
    else
      EXPECT_NE(std::find(seen.begin(), seen.end(), memory), seen.end()) << "allocated anew";
    box.publish();
    if (i < 3 || i % 2 == 0) box.acquire();
  }
  EXPECT_EQ(box.front().size(), 1000u);
}

/// What ThreadSanitizer watches: a reader and a writer at full speed.
TEST(Handover, TwoThreadsNeverTearAndNeverGoBack) {
  constexpr std::uint64_t kValues = 200'000;
  Handover<Block> box(block(0));
  std::uint64_t torn = 0, older = 0, not_newer = 0, taken = 0, last = 0;
  std::thread reader([&] {
    while (last < kValues) {
      const bool fresh = box.acquire();
      const Block& b = box.front();
      torn += whole(b) ? 0u : 1u;
      older += b.front() < last ? 1u : 0u;
      not_newer += fresh && b.front() <= last ? 1u : 0u;
      taken += fresh ? 1u : 0u;
      last = b.front();
      if (!fresh) std::this_thread::yield();
    }
  });
  for (std::uint64_t i = 1; i <= kValues; ++i) {
    box.back().fill(i);
    box.publish();
    if (i % 64 == 0) std::this_thread::yield();
  }
  reader.join();
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(older, 0u);
  EXPECT_EQ(not_newer, 0u);
  EXPECT_EQ(last, kValues) << "the last value was lost";
  EXPECT_GE(taken, 1u);
}

}  // namespace
}  // namespace palpate
