// Facets that cross or touch others: self-intersections, interpenetrating parts, walls on a floor without
// shared vertices. Saves contact frames a query: only on these facets can a way along the surface meet
// another sheet.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/proximity/segment_index.h"

namespace palpate::baselines {

/// Immutable after building; concurrent reads are safe.
class Crossings {
 public:
  /// Queries every edge as a segment and confirms in double: facets cross if an edge of one pierces the other
  /// or ends on it. Facets at the edge's own vertices count if not connected to it there, unless coplanar.
  /// Border edges are tested against all near facets. O(edges log facets), the same for any `threads`.
  [[nodiscard]] static Crossings find(const SurfaceMesh& mesh, const SegmentIndex& index, int threads);

  [[nodiscard]] std::size_t facets() const noexcept { return facets_; }
  /// Number of facets that cross or touch others of their own component: folds.
  [[nodiscard]] std::size_t folded() const noexcept { return folded_; }
  [[nodiscard]] std::size_t pairs() const noexcept { return others_.size() / 2; }
  [[nodiscard]] bool any() const noexcept { return !others_.empty(); }
  /// Facets that cross `facet`, ascending. Only if any().
  [[nodiscard]] std::span<const std::uint32_t> of(std::uint32_t facet) const noexcept {
    return {others_.data() + begin_[facet], begin_[facet + 1] - begin_[facet]};
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return (begin_.capacity() + others_.capacity()) * sizeof(std::uint32_t);
  }

 private:
  std::vector<std::uint32_t> begin_, others_;
  std::size_t facets_ = 0, folded_ = 0;
};

}  // namespace palpate::baselines
