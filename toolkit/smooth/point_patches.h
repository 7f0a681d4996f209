// Which patches each point follows: what a place of the surface is made of is asked of the points around it.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// Patches that one point follows, at most.
inline constexpr std::size_t kPatchesOfPoint = 2;

/// The patches of a point, best first, with shares that sum to 1; kNone from the first that there is not.
struct PointPatches {
  static constexpr std::uint32_t kNone = 0xffffffffu;
  std::array<std::uint32_t, kPatchesOfPoint> patch{kNone, kNone};
  std::array<float, kPatchesOfPoint> share{};
};

/// Of every point. A patch is followed by the points that lie on it within their noise, up to a little beyond
/// where it ends: so a face goes on to its edge. The same for any number of threads. O(patches x points of
/// each).
[[nodiscard]] std::vector<PointPatches> follow_patches(const SmoothPoints& points,
                                                       std::span<const Patch> patches, int threads);

}  // namespace palpate::render
