// Disjoint sets (union-find) with orientations. Members know their orientation relative to their set.
#pragma once

#include <algorithm>
#include <cstdint>

#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"

namespace palpate {

/// Up to 2^31 members, 4 bytes each. The lowest member of a set is its root, so results do not depend on the
/// order of joining. Amortised O(log n) a call. Calls of several threads may not meet in one set, but for
/// root_of().
class OrientedDisjointSets {
 public:
  struct Root {
    std::uint32_t set;
    std::uint32_t flipped;  ///< 1: opposite to the root
  };

  explicit OrientedDisjointSets(std::size_t members, int threads = 1) : link_(members) {
    constexpr std::size_t kGrain = 1 << 16;
    parallel_each(members, kGrain, threads,
                  [this](std::size_t i) { link_[i] = static_cast<std::uint32_t>(i << 1); });
  }
  /// Halves the path to the root.
  Root find(std::uint32_t i) noexcept {
    std::uint32_t flipped = 0;
    for (;;) {
      const std::uint32_t link = link_[i], parent = link >> 1;
      if (parent == i) return {i, flipped};
      const std::uint32_t above = link_[parent];
      link_[i] = (above & ~1u) | ((link ^ above) & 1u);
      if (above >> 1 == parent) return {parent, flipped ^ (link & 1u)};
      flipped ^= link_[i] & 1u;
      i = above >> 1;
    }
  }
  /// The same without writing.
  [[nodiscard]] Root root_of(std::uint32_t i) const noexcept {
    std::uint32_t flipped = 0;
    for (std::uint32_t link = link_[i]; link >> 1 != i; link = link_[i]) {
      flipped ^= link & 1u;
      i = link >> 1;
    }
    return {i, flipped};
  }
  enum class Joined : unsigned char { kNow, kBefore, kBeforeOtherwise };
  /// Joins the sets of two members, which are turned against each other if `flipped` is 1. kBeforeOtherwise:
  /// they are in one set already and oriented the other way there.
  Joined join(std::uint32_t a, std::uint32_t b, std::uint32_t flipped = 0) noexcept {
    const Root ra = find(a), rb = find(b);
    const std::uint32_t between = ra.flipped ^ rb.flipped ^ flipped;
    if (ra.set == rb.set) return between == 0 ? Joined::kBefore : Joined::kBeforeOtherwise;
    link_[std::max(ra.set, rb.set)] = std::min(ra.set, rb.set) << 1 | between;
    return Joined::kNow;
  }

 protected:
  UninitializedVector<std::uint32_t> link_;  ///< parent * 2 + (1: turned against it); the parent is lower
};

}  // namespace palpate
