// Facets that cross other facets or end on them: interpenetrating parts, self-intersections, walls that stand
// on a floor without sharing its vertices. Known beforehand, they spare
// every frame in contact a query: a way along the surface can meet another sheet only on a facet that is
// listed here.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/proximity/segment_index.h"

namespace palpate::baselines {

/// Immutable after building; safe to read from many threads.
class Crossings {
 public:
  /// Every edge is a segment query against the mesh, its crossings confirmed in double: two facets cross
  /// where an edge of one pierces the other or ends on it. Facets that share a vertex with the edge count
  /// where no edges connect them around it; such as lie in one plane do not. Border edges are also held
  /// against all that is near. O(edges log facets). The same result for any number of threads.
  [[nodiscard]] static Crossings find(const SurfaceMesh& mesh, const SegmentIndex& index, int threads);

  /// Facets that appear in some pair.
  [[nodiscard]] std::size_t facets() const noexcept { return facets_; }
  /// Facets that cross or touch others of their own component: folds.
  [[nodiscard]] std::size_t folded() const noexcept { return folded_; }
  [[nodiscard]] std::size_t pairs() const noexcept { return others_.size() / 2; }
  [[nodiscard]] bool any() const noexcept { return !others_.empty(); }
  /// What crosses `facet`, ascending. Only where any().
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
