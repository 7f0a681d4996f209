// Segment and nearness queries on a SurfaceMesh by Embree.
//
// Why no segment slips through at a shared edge or corner, although everything in Embree is float:
//   1. The robust intersector decides "which side of this edge does the segment pass" by one expression of
//   the edge's
//      two end points, the same bits for both facets of the edge (welded vertices, one float rounding each),
//      so that whatever the rounding, a segment is on one side of the edge for both or for neither; traversal
//      is conservative.
//   2. End points are snapped to a grid of quantum_mm(), a power of two so large that every coordinate and
//   every
//      difference of two is an exact float. A segment's origin + 1 * direction is then exactly its end, and
//      the next segment starts at exactly that point: the path is one closed chain, without a gap between its
//      links.
//   3. A segment is tested margin_mm() beyond its end, since the distance along it is rounded.
//   4. Where an end point lies within the margin of a facet, sides cannot be told in float. within() says so,
//   and
//      the caller then keeps its last clear point as the start of the next segment, which has the same parity
//      of crossings with every closed surface.
//   5. Sides are decided by the caller in double, never from the float hit.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "toolkit/core/result.h"

namespace palpate::baselines {

/// Where a segment a -> b first meets the mesh: the facet and the fraction of the way, float accuracy.
struct SegmentHit {
  std::uint32_t facet = kNoFacet;
  double fraction = 0.0;
};

/// A facet and its distance, in double.
struct NearFacet {
  double distance = 0.0;
  std::uint32_t facet = kNoFacet;
};

/// Holds an Embree scene of the mesh, whose facets it reads: the mesh must outlive it and not move. Queries
/// are safe from many threads, use the caller's thread alone and allocate nothing. Points are relative to the
/// mesh's origin, mm. O(log facets).
class SegmentIndex {
 public:
  [[nodiscard]] static Result<SegmentIndex> build(const SurfaceMesh& mesh, int threads);
  SegmentIndex(SegmentIndex&&) noexcept;
  SegmentIndex& operator=(SegmentIndex&&) noexcept;
  ~SegmentIndex();

  /// The first facet met, from either side. Facets that share a vertex with `ignore_around` are passed over.
  [[nodiscard]] std::optional<SegmentHit> first_hit(const Vec3& a, const Vec3& b,
                                                    std::uint32_t ignore_around = kNoFacet) const noexcept;
  /// Adds every facet that the segment between two vertices meets, or ends within margin_mm() of, but those
  /// that have one of the two as a corner. May allocate: for preparation.
  void all_hits(std::uint32_t from_vertex, std::uint32_t to_vertex, std::vector<std::uint32_t>& facets) const;
  /// Whether a facet lies within radius of p.
  [[nodiscard]] bool within(const Vec3& p, double radius_mm) const noexcept;
  /// The facet nearest to p within max_radius_mm, float accuracy: kNoFacet where there is none.
  [[nodiscard]] std::uint32_t nearest(const Vec3& p, double max_radius_mm) const noexcept;
  /// Puts the facets within radius of p into `found` and returns how many there are, in no order; where that
  /// is more than found.size(), it holds some of them and the count is one more than it holds.
  [[nodiscard]] std::size_t gather(const Vec3& p, double radius_mm,
                                   std::span<NearFacet> found) const noexcept;
  /// Step of the grid of end points: half extent x 2^-22 or up to twice that.
  [[nodiscard]] double quantum_mm() const noexcept;
  /// Bounds the distance between the float picture and the mesh: see kMarginQuanta.
  [[nodiscard]] double margin_mm() const noexcept;
  /// Held by Embree, as its memory monitor counted, and the vertices in float that it reads.
  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  struct State;
  explicit SegmentIndex(std::unique_ptr<State> state) noexcept;
  std::unique_ptr<State> state_;
};

}  // namespace palpate::baselines
