// What hangs together in a mesh, and which side of each facet agrees with its neighbours'.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// Facets connected over edges that two of them share are a piece. One piece whose facets agree as they are
/// takes no memory.
struct Pieces {
  std::size_t count = 0;
  std::vector<std::uint32_t> number;  ///< of every facet's piece, by their first facets; empty: one piece
  std::vector<std::uint8_t>
      turned;  ///< 1 where a facet looks the other way than its piece's first; empty: none

  [[nodiscard]] std::uint32_t piece_of(std::uint32_t facet) const noexcept {
    return number.empty() ? 0u : number[facet];
  }
  /// The facet's side that agrees with side 0 of its piece's first.
  [[nodiscard]] std::uint32_t side(std::uint32_t facet) const noexcept {
    return turned.empty() ? 0u : turned[facet];
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return number.capacity() * sizeof(std::uint32_t) + turned.capacity();
  }
};

/// Where more than two facets meet at an edge a piece ends: which two of them go together nobody knows.
/// O(facets), parallel; the same for any number of threads. A piece that cannot agree (a Moebius strip)
/// disagrees somewhere.
[[nodiscard]] Pieces pieces_of(const SurfaceMesh& mesh, int threads);

/// The same, but where more than two facets meet a piece goes on to whichever is next: what a repair tries,
/// and cuts where it fails. O(facets).
[[nodiscard]] Pieces pieces_across_many(const SurfaceMesh& mesh);

/// For every facet the number of its component, those connected over edges of however many facets, numbered
/// by their first facets. O(facets).
[[nodiscard]] std::vector<std::uint32_t> components_of(const SurfaceMesh& mesh);

}  // namespace palpate::baselines
