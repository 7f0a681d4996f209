// A triangle mesh prepared for walking: welded vertices, flat facets, neighbourhood between half-facets,
// normals of features, and the facets that cross others.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baselines/mesh/buckets.h"
#include "baselines/mesh/facet.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

/// Facets around one vertex that a frame looks at, at most. Scans have some 6, fans in CAD files up to some
/// hundreds: the tip of a turned body. A frame goes round a vertex in each of kMaxFlights flights, some five
/// times: 20 x 1,024 looks of 30 ns stay under a millisecond. Of a larger fan the rest does not count,
/// neither for the way on nor for the side: preparation warns of it.
inline constexpr std::uint32_t kMaxFan = 1024;

/// What preparing found.
struct SurfaceMeshCounts {
  std::size_t vertices = 0;         ///< after welding
  std::size_t welded_vertices = 0;  ///< given vertices at exactly the place of an earlier one, merged with it
  std::size_t collapsed_facets = 0;  ///< with two corners at one vertex: dropped, their edges close over them
  std::size_t repeated_facets = 0;   ///< with the corners of an earlier one, whichever way round: dropped
  std::size_t two_sided_facets = 0;  ///< of these, kept ones of which one that ran the other way was dropped
  std::size_t fins = 0;              ///< two-sided ones that stick out of a surface with a free edge: dropped
  std::size_t flat_facets = 0;       ///< three vertices without area: kept, they are walked as edges
  std::size_t edges = 0;
  std::size_t boundary_edges = 0;
  std::size_t radial_edges = 0;   ///< edges of three or more facets
  std::size_t flipped_edges = 0;  ///< between two facets of opposite orientation
  std::size_t largest_fan = 0;    ///< facets around one vertex
};

/// How vertices and facets are numbered.
enum class MeshOrder : std::uint8_t {
  kGiven,  ///< as they come
  kCurve,  ///< vertices along a Morton curve, facets by their lowest vertex: near in space, near in memory
};

/// Where the coordinates of a mesh begin.
enum class MeshFrame : std::uint8_t {
  kLocal,  ///< in the middle of its box: single precision resolves the mesh, wherever it lies
  kWorld,  ///< where the file says: what a library in single precision gets that is handed the file as it is
};

/// Immutable after building; safe to read from many threads. Everything in mm relative to origin_mm (the
/// middle of the box, or zero in the world's frame), in double. Nothing in the const noexcept members
/// allocates.
class SurfaceMesh {
 public:
  /// Welds, numbers and connects. O(n log n) at worst, O(n) in practice, parallel. Indices out of range,
  /// non-finite vertices and meshes without a usable facet are Errors. The same result for any number of
  /// threads.
  [[nodiscard]] static Result<SurfaceMesh> build(const geometry::TriangleMesh& mesh, int threads,
                                                 MeshOrder order = MeshOrder::kGiven,
                                                 MeshFrame frame = MeshFrame::kLocal);
  /// The mesh as it is walked, model frame: welded, in the order of its numbers, each coordinate within a
  /// rounding of the given one. O(n).
  [[nodiscard]] geometry::TriangleMesh as_mesh() const;

  [[nodiscard]] const Vec3& origin_mm() const noexcept { return origin_mm_; }
  /// Relative to the origin.
  [[nodiscard]] const geometry::Aabb& local_box_mm() const noexcept { return box_; }
  [[nodiscard]] const UnfilledVector<Facet>& facets() const noexcept { return facets_; }
  [[nodiscard]] const Facet& facet(std::uint32_t i) const noexcept { return facets_[i]; }
  [[nodiscard]] const UnfilledVector<Vec3>& vertices() const noexcept { return vertices_; }
  [[nodiscard]] const SurfaceMeshCounts& counts() const noexcept { return counts_; }
  [[nodiscard]] std::size_t bytes() const noexcept;
  /// The facets around a vertex, in order of their number.
  [[nodiscard]] std::span<const std::uint32_t> star(std::uint32_t vertex) const noexcept {
    return {stars_.items.data() + stars_.begin[vertex], stars_.begin[vertex + 1] - stars_.begin[vertex]};
  }
  /// Length that bounds the rounding of any double computation on local coordinates here: 64 operations on
  /// numbers as large as the box (gamma(64) x half diagonal x 2).
  [[nodiscard]] double rounding_mm() const noexcept { return rounding_mm_; }

  /// The half-facet that one comes to from `half` over its edge without leaving its side: at an edge of two
  /// facets the other one, at an edge of several the next one in rotation, kNoFacet at a boundary; the
  /// facet's own other side at a free edge of a facet that was given twice, once either way round.
  [[nodiscard]] HalfFacet neighbour(HalfFacet half, std::uint32_t edge) const noexcept {
    const std::uint32_t across = facets_[facet_of(half)].across[edge];
    if (across < kRadialBase) return across ^ side_of(half);
    return across == kNoFacet ? kNoFacet : radial_[across - kRadialBase][side_of(half)];
  }
  /// Square of the facet's longest edge. At the rim of an open mesh a HIP that is behind the facet and no
  /// further than this edge beyond it is still held, so that reconstructions with pinholes of a facet or two
  /// do not swallow it.
  [[nodiscard]] double longest_edge_sq(std::uint32_t facet) const noexcept;
  /// Of the facet's given side, unit; zero for a facet without area.
  [[nodiscard]] Vec3 normal(HalfFacet half) const noexcept;
  /// Whether the feature is a free edge, or a corner, around which the god object comes from one side of
  /// `half`'s facet to the other: in front of such an edge everything is free.
  [[nodiscard]] bool goes_round(HalfFacet half, Feature feature) const noexcept;
  /// Towards the free side at a feature: the facet's normal, the sum over the two facets of an edge, the
  /// angle-weighted sum over the half-facets around a corner (Baerentzen and Aanaes 2005), unit; zero where
  /// it vanishes. `boundary` says that the feature lies on a boundary, where nothing is behind it.
  [[nodiscard]] Vec3 pseudonormal(HalfFacet half, Feature feature, bool* boundary) const noexcept;

  /// Calls visit(HalfFacet) for every other half-facet around the corner, on the same side, until it has seen
  /// kMaxFan. Returns true where the fan is open (the corner lies on a boundary).
  template <class Visit>
  bool around_corner(HalfFacet half, std::uint32_t corner, Visit&& visit) const noexcept {
    std::uint32_t seen = 0;
    const std::uint32_t vertex = facets_[facet_of(half)].vertex[corner];
    if (turn(half, vertex, corner, half, seen, visit)) return false;
    turn(half, vertex, before(corner), half, seen, visit);
    return true;
  }

 private:
  /// Facet numbers stay under 2^29, so that 2 * facet + side stays under this.
  static constexpr std::uint32_t kRadialBase = 0x40000000u;

  /// Walks from `from` over `edge` around `vertex`; true when it came back to `start`.
  template <class Visit>
  bool turn(HalfFacet from, std::uint32_t vertex, std::uint32_t edge, HalfFacet start, std::uint32_t& seen,
            Visit& visit) const noexcept {
    while (seen < kMaxFan) {
      const Facet& here = facets_[facet_of(from)];
      const std::uint32_t other_end =
          here.vertex[edge] == vertex ? here.vertex[after(edge)] : here.vertex[edge];
      const HalfFacet next = neighbour(from, edge);
      if (next == kNoFacet) return false;
      if (next == start) return true;
      visit(next);
      ++seen;
      const Facet& there = facets_[facet_of(next)];
      std::uint32_t corner = 0;
      while (corner < 2 && there.vertex[corner] != vertex) ++corner;
      edge = there.vertex[after(corner)] == other_end ? before(corner) : corner;
      from = next;
    }
    return true;
  }

  /// Of each given vertex its number; fills vertices_.
  [[nodiscard]] std::vector<std::uint32_t> weld(const std::vector<Vec3>& given, const geometry::Aabb& used,
                                                int threads, MeshOrder order);
  void fill_facets(const geometry::TriangleMesh& mesh, const std::vector<std::uint32_t>& welded, int threads,
                   MeshOrder order);
  void connect(int threads);
  /// True where facets lie on others: then they are dropped, and all is to be connected again.
  bool connect_edges(const std::vector<bool>& two_sided, int threads);
  using Starts = std::vector<std::uint32_t>;
  using Uses = std::vector<std::uint64_t>;
  /// The uses of the edges whose lower end is `vertex`, added to `uses` and sorted.
  void add_uses(std::uint32_t vertex, Uses& uses) const;
  /// Of facets with the same corners the first stays; true where there were others. `uses`: of the edges from
  /// each vertex, sorted, starting at `begin`.
  bool drop_repeated(const Starts& begin, const Uses& uses, std::vector<bool>& two_sided);
  /// What simplification left of a closed surface where it met itself: a facet and its back, with nothing in
  /// between, at an edge that others close without it. True where there were such.
  bool drop_fins(const Starts& begin, const Uses& uses, std::vector<bool>& two_sided);
  void drop(const std::vector<bool>& gone, std::vector<bool>& two_sided);
  void count_flat(int threads);
  void find_largest_fan();
  struct Found;
  void connect_edge(std::span<const std::uint64_t> uses, const std::vector<bool>& two_sided, Found& found);
  void connect_radial(std::span<const std::uint64_t> uses);

  Vec3 origin_mm_ = Vec3::Zero();
  geometry::Aabb box_;
  double rounding_mm_ = 0.0;
  UnfilledVector<Vec3> vertices_;
  UnfilledVector<Facet> facets_;
  Buckets stars_;  ///< facets by vertex
  std::vector<std::array<HalfFacet, 2>> radial_;
  SurfaceMeshCounts counts_;
};

}  // namespace palpate::baselines
