// Values replaced while another thread uses them.
#include "device/servo/snapshot.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <thread>

namespace palpate::device {
namespace {

struct Book {
  std::atomic<int> alive{0};
  std::atomic<int> destroyed_elsewhere{0};
  std::thread::id publisher;
};

/// Torn where not all numbers are the same; tells where it ends.
struct Value {
  Value(Book& in, std::uint64_t number) : book(in) {
    numbers.fill(number);
    ++book.alive;
  }
  Value(const Value&) = delete;
  Value& operator=(const Value&) = delete;
  ~Value() {
    numbers.fill(~std::uint64_t{0});
    --book.alive;
    if (std::this_thread::get_id() != book.publisher) ++book.destroyed_elsewhere;
  }
  Book& book;
  std::array<std::uint64_t, 32> numbers{};
};

TEST(Snapshot, TheUserKeepsItsValueUntilItTakesTheNewest) {
  Book book;
  book.publisher = std::this_thread::get_id();
  {
    Snapshot<Value> snapshot(std::make_unique<Value>(book, 1));
    ASSERT_NE(snapshot.get(), nullptr);
    EXPECT_FALSE(snapshot.acquire());
    snapshot.publish(std::make_unique<Value>(book, 2));
    EXPECT_EQ(book.alive, 2);
    snapshot.publish(std::make_unique<Value>(book, 3));
    EXPECT_EQ(book.alive, 2) << "what nobody took is gone at once";
    EXPECT_EQ(snapshot.get()->numbers[0], 1u);
    EXPECT_TRUE(snapshot.acquire());
    EXPECT_EQ(snapshot.get()->numbers[0], 3u);
    EXPECT_EQ(book.alive, 2) << "the user destroys nothing";
    snapshot.collect();
    EXPECT_EQ(book.alive, 1);
    EXPECT_FALSE(snapshot.acquire()) << "still the same value";
    EXPECT_EQ(snapshot.get()->numbers[0], 3u);
    snapshot.publish(nullptr);
    EXPECT_TRUE(snapshot.acquire());
    EXPECT_EQ(snapshot.get(), nullptr);
    snapshot.collect();
    EXPECT_EQ(book.alive, 0);
  }
  Snapshot<Value> empty;
  EXPECT_EQ(empty.get(), nullptr);
  EXPECT_FALSE(empty.acquire());
}

/// What ThreadSanitizer watches.
TEST(Snapshot, ReplacedUnderTheUsersHandNothingTearsAndAllEndsWithThePublisher) {
  constexpr std::uint64_t kValues = 5'000;
  Book book;
  book.publisher = std::this_thread::get_id();
  std::uint64_t torn = 0, older = 0, last = 0;
  int most = 0;
  {
    Snapshot<Value> snapshot(std::make_unique<Value>(book, 0));
    std::thread user([&] {
      while (last < kValues) {
        const bool fresh = snapshot.acquire();
        const Value& value = *snapshot.get();
        for (const std::uint64_t number : value.numbers) torn += number != value.numbers[0] ? 1u : 0u;
        older += value.numbers[0] < last || (fresh && value.numbers[0] == last) ? 1u : 0u;
        last = value.numbers[0];
        if (!fresh) std::this_thread::yield();
      }
    });
    for (std::uint64_t i = 1; i <= kValues; ++i) {
      snapshot.publish(std::make_unique<Value>(book, i));
      most = std::max(most, book.alive.load());
      if (i % 16 == 0) std::this_thread::yield();
    }
    user.join();
    snapshot.collect();
    EXPECT_EQ(book.alive, 1);
  }
  EXPECT_EQ(book.alive, 0);
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(older, 0u);
  EXPECT_EQ(last, kValues);
  EXPECT_LE(most, 3) << "more is kept than three slots hold";
  EXPECT_EQ(book.destroyed_elsewhere, 0);
}

}  // namespace
}  // namespace palpate::device
