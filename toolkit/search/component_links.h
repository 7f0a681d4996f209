// The shortest links that join a cloud's pieces. Internal to search.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include "toolkit/core/disjoint_sets.h"

namespace palpate::search {

struct ComponentLink {
  double square_mm2 = 0.0;
  std::uint32_t a = 0, b = 0;  ///< a < b
  friend bool operator<(const ComponentLink& x, const ComponentLink& y) noexcept {
    if (x.square_mm2 != y.square_mm2) return x.square_mm2 < y.square_mm2;
    return x.a != y.a ? x.a < y.a : x.b < y.b;
  }
};

/// Joins all `count` pieces by the shortest set of links, ties by (a, b): pieces - 1 links, in order.
/// Boruvka's rounds: every piece but the largest takes its closest other, so their number at least halves.
/// O(n log n) a round.
[[nodiscard]] std::vector<ComponentLink> shortest_component_links(const cloud::Cloud& cloud,
                                                                  OrientedDisjointSets& pieces,
                                                                  std::size_t count);

}  // namespace palpate::search
