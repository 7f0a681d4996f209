#include "toolkit/core/unset_vector.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <utility>

namespace palpate {
namespace {

template <class Vector>
void expect_as_a_vector() {
  Vector numbers(3, 7);
  numbers.push_back(8);
  EXPECT_EQ(numbers, (Vector{7, 7, 7, 8}));
  numbers.resize(2);
  numbers.resize(5, 9);
  EXPECT_EQ(numbers, (Vector{7, 7, 9, 9, 9}));
  numbers.resize(6);  // the sixth is anything
  numbers.back() = 1;
  Vector moved = std::move(numbers);
  const Vector copied = moved;
  EXPECT_EQ(copied, (Vector{7, 7, 9, 9, 9, 1}));
  moved.assign(1'000'000, 4);
  EXPECT_EQ(moved.back(), 4u);
}

TEST(UnsetVectors, AreVectors) {
  expect_as_a_vector<UnsetVector<std::uint32_t>>();
  expect_as_a_vector<LargeUnsetVector<std::uint32_t>>();
}

}  // namespace
}  // namespace palpate
