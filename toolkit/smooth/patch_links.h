// Which patches continue each other, and with which side up: so that one distance can be blended of them, and
// sheets that lie close are not taken for one.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// How the surface goes on from one patch to the next.
enum class Turn : std::int8_t {
  kValley = -1,  ///< over a crease: the distance is the lesser of both
  kNone = 0,
  kRidge = 1,    ///< the greater
  kUnclear = 2,  ///< they lean against each other, and the points around make no crease of it
};

struct PatchLinks {
  std::vector<std::uint32_t> begin;  ///< of each patch in `to`, and one more
  std::vector<std::uint32_t> to;
  std::vector<Turn> turn;            ///< beside `to`
  std::vector<std::uint32_t> sheet;  ///< of each patch: the first patch of its connected sheet
  /// Of each patch whether it meets any in a crease; empty: not told.
  std::vector<std::uint8_t> creased;
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t patch) const noexcept {
    return {to.data() + begin[patch], begin[patch + 1] - begin[patch]};
  }
};

/// Links the patches and turns their normals to one side of each connected sheet (the sheet's own; a surface
/// with one side gets a seam). Deterministic; O(patches x overlaps).
[[nodiscard]] PatchLinks link_patches(const SmoothPoints& points, std::vector<Patch>& patches, int threads,
                                      const SmoothWithout& without = {});

}  // namespace palpate::render
