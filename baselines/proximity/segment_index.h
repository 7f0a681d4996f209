// Segment and nearness queries on a SurfaceMesh by Embree.
//
// No segment slips through a shared edge or corner, although Embree computes in float:
//  1. The robust intersector decides on which side of an edge a segment passes by one expression of the
//     edge's end points. Both facets of the edge use the same bits (welded vertices, rounded once), so they
//     agree whatever the rounding; traversal is conservative.
//  2. End points are snapped to a grid whose quantum is a power of two large enough for exact float
//     coordinates and differences. Then origin + 1 * direction is exactly the segment's end and the next
//     one's start: the path has no gaps.
//  3. A segment is tested margin_mm() beyond its end, since distances along it are rounded.
//  4. Within the margin of a facet float cannot tell sides. within() reports this, and the caller starts the
//     next segment at its last clear point, with equal parity of crossings for every closed surface.
//  5. The caller decides sides in double, never from the float hit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// First hit of a segment a -> b: facet and fraction of the way, float accuracy.
struct SegmentHit {
  std::uint32_t facet = kNoFacet;
  double fraction = 0.0;
};

/// A facet and its distance, in double.
struct NearFacet {
  double distance = 0.0;
  std::uint32_t facet = kNoFacet;
};

/// Work that goes into the tree of a mesh.
enum class TreeQuality : std::uint8_t {
  kBest,  ///< for a mesh that stays: by surface area
  kFast,  ///< for a mesh that is replaced soon: along a Morton curve, built 5 times as fast, queries 1.3 as
          ///< long
};

/// An Embree scene over the mesh, which must outlive it and not move. Queries are thread-safe and do not
/// allocate. Points in mm relative to the mesh's origin. O(log facets).
class SegmentIndex {
 public:
  /// `mesh` has a facet.
  [[nodiscard]] static Result<SegmentIndex> build(const SurfaceMesh& mesh, int threads,
                                                  TreeQuality quality = TreeQuality::kBest);
  SegmentIndex(SegmentIndex&&) noexcept;
  SegmentIndex& operator=(SegmentIndex&&) noexcept;
  ~SegmentIndex();

  /// First facet met, from either side. Skips facets that share a vertex with `ignore_around`.
  [[nodiscard]] std::optional<SegmentHit> first_hit(const Vec3& a, const Vec3& b,
                                                    std::uint32_t ignore_around = kNoFacet) const noexcept;
  /// Adds every facet that the segment between two vertices meets or ends within margin_mm() of, except
  /// facets at these vertices. It may allocate; for preparation.
  void all_hits(std::uint32_t from_vertex, std::uint32_t to_vertex, std::vector<std::uint32_t>& facets) const;
  [[nodiscard]] bool within(const Vec3& p, double radius_mm) const noexcept;
  /// The facet nearest to p within max_radius_mm, float accuracy; kNoFacet if none.
  [[nodiscard]] std::uint32_t nearest(const Vec3& p, double max_radius_mm) const noexcept;
  /// Puts the facets within the radius of p into `found`, unordered, and returns their number. If they do not
  /// fit, returns found.size() + 1 and some of them.
  [[nodiscard]] std::size_t gather(const Vec3& p, double radius_mm,
                                   std::span<NearFacet> found) const noexcept;
  /// Bounds the distance between Embree's float mesh and the mesh: see kMarginQuanta.
  [[nodiscard]] double margin_mm() const noexcept;
  /// Memory of Embree by its monitor, plus the float vertices.
  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  struct State;
  explicit SegmentIndex(std::unique_ptr<State> state) noexcept;
  std::unique_ptr<State> state_;
};

struct MeshGap {
  double rms_mm = 0.0;
  double max_mm = 0.0;  ///< one-sided Hausdorff distance, sampled
  std::size_t places = 0;
};

/// Distance from `places` (model frame) to the mesh: float selects the facet, double measures. O(places x log
/// facets), the same for any `threads`.
[[nodiscard]] MeshGap gap_to(const SurfaceMesh& mesh, const SegmentIndex& index, std::span<const Vec3> places,
                             int threads);

/// Facets that cross or touch others: self-intersections, interpenetrating parts, walls on a floor without
/// shared vertices. Saves contact frames a query: only on these facets can a way along the surface meet
/// another sheet. Immutable after building; concurrent reads are safe.
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
