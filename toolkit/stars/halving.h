// Internal to stars: points that follow each other along a curve, put into blocks that are about as long as
// wide.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "toolkit/core/lanes.h"

namespace palpate::stars {

/// Points of a group that are put in order among themselves. A Morton curve jumps, and a block of places that
/// lies across a jump has a box and a layer many times its neighbours': only blocks across the middle of a
/// group can.
inline constexpr std::size_t kGroup = 512;

/// Of each point its coordinates and its index in the cloud.
struct alignas(32) Group {
  static constexpr std::size_t kRoom = kGroup + kLanes;  ///< whole lanes are read and written
  std::array<std::array<float, kRoom>, 3> at;
  std::array<std::uint32_t, kRoom> index;
  std::size_t size = 0;

  void add(float x, float y, float z, std::uint32_t i) noexcept {
    at[0][size] = x;
    at[1][size] = y;
    at[2][size] = z;
    index[size++] = i;
  }
};

/// Halves the group across its longest side, and the halves across theirs, down to kBlockPlaces. Of equal
/// coordinates the lower of the others go first, then the lower index. Within a block points stay in the
/// order that they came in: the same on every processor and with every standard library.
void halve(Group& group) noexcept;
/// The same without wide lanes, for tests.
void halve_narrow(Group& group) noexcept;

}  // namespace palpate::stars
