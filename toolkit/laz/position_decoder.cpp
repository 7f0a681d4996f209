#include "toolkit/laz/position_decoder.h"

#include <algorithm>

namespace palpate::laz {
namespace {

// Contexts of y and z: whether the pulse has one return, and how many bits the step before had, in twos and
// up to a limit.
constexpr std::uint32_t kMostYBits = 20, kMostZBits = 18;
constexpr std::size_t kXContexts = 2, kYContexts = kMostYBits + 2, kZContexts = kMostZBits + 2;

// By count of returns and number of the return. What is sound lies at and below the diagonal; the rest are
// files that count from 0, or know only one of the two.
constexpr std::uint8_t kKindsOf8[8][8] = {
    {15, 14, 13, 12, 11, 10, 9, 8},  {14, 0, 1, 3, 6, 10, 10, 9},    {13, 1, 2, 4, 7, 11, 11, 10},
    {12, 3, 4, 5, 8, 12, 12, 11},    {11, 6, 7, 8, 9, 13, 13, 12},   {10, 10, 11, 12, 13, 14, 14, 13},
    {9, 10, 11, 12, 13, 14, 15, 14}, {8, 9, 10, 11, 12, 13, 14, 15},
};
constexpr std::uint8_t kKindsOf16[16][16] = {
    {0, 1, 2, 3, 4, 5, 3, 4, 4, 5, 5, 5, 5, 5, 5, 5}, {1, 0, 1, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3},
    {2, 1, 2, 4, 4, 4, 4, 4, 4, 4, 4, 3, 3, 3, 3, 3}, {3, 3, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4},
    {4, 3, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4}, {5, 3, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4},
    {3, 3, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4}, {4, 3, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4},
    {4, 3, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4}, {5, 3, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4},
    {5, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4}, {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 4, 4, 4},
    {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4, 4}, {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4},
    {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5}, {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5},
};

std::size_t bits_context(std::uint32_t bits, std::uint32_t most, bool single) noexcept {
  return (bits < most ? bits & ~1u : most) + (single ? 1u : 0u);
}

}  // namespace

std::size_t return_kind_of_8(std::uint32_t count, std::uint32_t number) noexcept {
  return kKindsOf8[count][number];
}

std::size_t return_kind_of_16(std::uint32_t count, std::uint32_t number) noexcept {
  return kKindsOf16[count][number];
}

std::size_t return_level(std::uint32_t count, std::uint32_t number) noexcept {
  return std::min<std::size_t>(count > number ? count - number : number - count, kReturnLevels - 1);
}

PositionDecoder::PositionDecoder(std::size_t kinds, std::int32_t height)
    : x_medians_(kinds),
      y_medians_(kinds),
      x_steps_(32, kXContexts),
      y_steps_(32, kYContexts),
      heights_(32, kZContexts) {
  height_at_.fill(height);
}

void PositionDecoder::next(ArithmeticDecoder& steps, ArithmeticDecoder* heights, std::size_t kind,
                           std::size_t level, bool single, GridPosition& position) {
  const std::int32_t x = x_steps_.decode(steps, x_medians_[kind].get(), single ? 1 : 0);
  x_medians_[kind].add(x);
  position.x = wrapped_sum(position.x, x);
  const std::int32_t y =
      y_steps_.decode(steps, y_medians_[kind].get(), bits_context(x_steps_.last_bits(), kMostYBits, single));
  y_medians_[kind].add(y);
  position.y = wrapped_sum(position.y, y);
  if (heights == nullptr) return;
  const std::uint32_t bits = (x_steps_.last_bits() + y_steps_.last_bits()) / 2;
  position.z = heights_.decode(*heights, height_at_[level], bits_context(bits, kMostZBits, single));
  height_at_[level] = position.z;
}

}  // namespace palpate::laz
