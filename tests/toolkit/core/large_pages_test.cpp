#include "toolkit/core/large_pages.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace palpate {
namespace {

struct alignas(64) Line {
  std::uint8_t bytes[64];
};

template <class T>
void expect_aligned(std::size_t count) {
  // Several at a time: one alone may lie well by chance.
  std::vector<LargeVector<T>> arrays(16);
  for (LargeVector<T>& array : arrays) {
    array.resize(count);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(array.data()) % alignof(T), 0u) << count;
  }
}

TEST(LargePages, ElementsAreAlignedHoweverFew) {
  constexpr std::size_t kCounts[] = {1, 2, 3, 7, 100, 70'000};
  for (const std::size_t count : kCounts) {
    expect_aligned<Line>(count);
    expect_aligned<double>(count);
    expect_aligned<std::uint8_t>(count);
  }
}

}  // namespace
}  // namespace palpate
