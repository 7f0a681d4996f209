// A triangle mesh prepared for walking: welded vertices, flat facets, half-facet neighbours, feature normals,
// crossing facets; interpolation over its facets.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include "baselines/mesh/facet.h"
#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"

namespace palpate::baselines {

/// Items grouped by key with a counting sort: facets around each vertex, facets of each lowest vertex. Items
/// of key k, ascending: items[begin[k]] to items[begin[k + 1]].
struct Buckets {
  LargePageUninitializedVector<std::uint32_t> begin, items;
};

/// keys_of(item, visit) calls visit(key), key < `keys`, for each key of an item < `count`; it runs twice, in
/// several threads. O(count + keys) for bounded buckets, at worst O(n log n). Buckets are sorted, so results
/// do not depend on `threads`.
template <class KeysOf>
[[nodiscard]] Buckets group_by_key(std::size_t keys, std::size_t count, int threads, const KeysOf& keys_of) {
  using Slot = std::atomic_ref<std::uint32_t>;
  constexpr auto kRelaxed = std::memory_order_relaxed;  // each pass ends with a join of the threads
  Buckets made;
  made.begin.resize(keys + 1);
  std::fill(made.begin.begin(), made.begin.end(), 0u);
  const auto for_items = [&](const auto& visit) {
    parallel_each(count, kPointsPerChunk, threads, [&](std::size_t item) {
      keys_of(item, [&](std::uint32_t key) { visit(static_cast<std::uint32_t>(item), key); });
    });
  };
  // Holds bucket ends first; filling from the back turns them into beginnings.
  for_items([&](std::uint32_t, std::uint32_t key) { Slot(made.begin[key]).fetch_add(1, kRelaxed); });
  std::uint32_t sum = 0;
  for (std::uint32_t& end : made.begin) end = sum += end;
  made.items.resize(sum);
  for_items([&](std::uint32_t item, std::uint32_t key) {
    made.items[Slot(made.begin[key]).fetch_sub(1, kRelaxed) - 1] = item;
  });
  parallel_each(keys, kPointsPerChunk, threads, [&](std::size_t key) {
    std::sort(made.items.begin() + made.begin[key], made.items.begin() + made.begin[key + 1]);
  });
  return made;
}

/// Most facets around a vertex that a frame examines. Scans have about 6, CAD fans up to some hundreds. A
/// frame circles a vertex in each of kMaxFlights flights, up to five times: 20 x 1,024 looks of 30 ns take
/// less than a millisecond. The rest of a larger fan is ignored; preparation warns.
inline constexpr std::uint32_t kMaxFan = 1024;

struct SurfaceMeshCounts {
  std::size_t vertices = 0;          ///< after welding
  std::size_t welded_vertices = 0;   ///< merged with an earlier vertex at exactly the same place
  std::size_t collapsed_facets = 0;  ///< with two corners at one vertex: dropped, neighbours close over them
  std::size_t repeated_facets = 0;   ///< with the corners of an earlier one, in any order: dropped
  std::size_t two_sided_facets = 0;  ///< kept facets whose reversed copy was dropped
  std::size_t fins = 0;              ///< two-sided, sticking out of a surface with a free edge: dropped
  std::size_t flat_facets = 0;       ///< no area: kept, walked as edges
  std::size_t edges = 0;
  std::size_t boundary_edges = 0;
  std::size_t radial_edges = 0;   ///< of three or more facets
  std::size_t flipped_edges = 0;  ///< between facets of opposite orientation
  std::size_t largest_fan = 0;    ///< facets around one vertex
};

/// Points row by row, relative to the mesh's origin, and where they form a sheet.
struct RasterSheet {
  std::size_t columns = 0;
  std::vector<Vec3> at_mm;
  std::vector<std::uint8_t> measured;  ///< 1: there is a point; all parallel
  /// 1: the point, the next in its row and the two below them lie on one sheet. 0 in the last row and column.
  std::vector<std::uint8_t> square;
};

/// Numbering of vertices and facets.
enum class MeshOrder : std::uint8_t {
  kGiven,
  kCurve,  ///< vertices along a Morton curve, facets by lowest vertex: near in space, near in memory
};

enum class MeshFrame : std::uint8_t {
  kLocal,  ///< centre of the box: single precision resolves the mesh wherever it lies
  kWorld,  ///< as in the file: what a single-precision library gets from the raw file
};

/// Immutable; concurrent reads are safe. Coordinates in mm, double, relative to origin_mm (box centre, or
/// zero in the world frame). Const noexcept members do not allocate.
class SurfaceMesh {
 public:
  /// Welds, numbers and connects. O(n), at worst O(n log n), parallel, the same for any `threads`. Errors:
  /// indices out of range, non-finite vertices, no usable facet.
  [[nodiscard]] static Result<SurfaceMesh> build(const geometry::TriangleMesh& mesh, int threads,
                                                 MeshOrder order = MeshOrder::kGiven,
                                                 MeshFrame frame = MeshFrame::kLocal);
  /// Two facets for each square, in raster order, with side 0 towards a camera whose rows run down.
  /// O(points), one thread. A sheet without squares gives a mesh without facets.
  [[nodiscard]] static SurfaceMesh of_raster(const RasterSheet& sheet, const Vec3& origin_mm);
  /// The mesh as walked, in the model frame: welded and renumbered, coordinates within one rounding. O(n).
  [[nodiscard]] geometry::TriangleMesh as_mesh() const;

  [[nodiscard]] const Vec3& origin_mm() const noexcept { return origin_mm_; }
  /// Relative to the origin.
  [[nodiscard]] const geometry::Aabb& local_box_mm() const noexcept { return box_; }
  [[nodiscard]] const LargePageUninitializedVector<Facet>& facets() const noexcept { return facets_; }
  [[nodiscard]] const Facet& facet(std::uint32_t i) const noexcept { return facets_[i]; }
  [[nodiscard]] const LargePageUninitializedVector<Vec3>& vertices() const noexcept { return vertices_; }
  [[nodiscard]] const SurfaceMeshCounts& counts() const noexcept { return counts_; }
  [[nodiscard]] std::size_t bytes() const noexcept;
  /// Facets around a vertex, ascending.
  [[nodiscard]] std::span<const std::uint32_t> star(std::uint32_t vertex) const noexcept {
    return {stars_.items.data() + stars_.begin[vertex], stars_.begin[vertex + 1] - stars_.begin[vertex]};
  }
  /// Bound on the rounding of double computations on local coordinates: 64 operations on numbers as large as
  /// the box (gamma(64) x half diagonal x 2).
  [[nodiscard]] double rounding_mm() const noexcept { return rounding_mm_; }

  /// Next half-facet from `half` over its edge on the same side: the other facet of two, the next of several
  /// in rotation, kNoFacet at a boundary, the facet's own other side at a free edge of a two-sided facet.
  [[nodiscard]] HalfFacet neighbour(HalfFacet half, std::uint32_t edge) const noexcept {
    const std::uint32_t across = facets_[facet_of(half)].across[edge];
    if (across < kRadialBase) return across ^ side_of(half);
    return across == kNoFacet ? kNoFacet : radial_[across - kRadialBase][side_of(half)];
  }
  /// Squared longest edge. At the rim of an open mesh a HIP behind the facet is held up to this length beyond
  /// it, so that pinholes of a facet or two do not swallow it.
  [[nodiscard]] double longest_edge_sq(std::uint32_t facet) const noexcept;
  /// Unit normal of the half-facet; zero without area.
  [[nodiscard]] Vec3 normal(HalfFacet half) const noexcept;
  /// Whether the god object can pass around this free edge or corner to the facet's other side; everything in
  /// front of such an edge is free.
  [[nodiscard]] bool is_free_edge(HalfFacet half, Feature feature) const noexcept;
  /// Outward unit vector of a feature: the facet's normal, the sum over an edge's two facets, or the
  /// angle-weighted sum around a corner (Baerentzen and Aanaes 2005); zero if it vanishes. `boundary`:
  /// nothing is behind the feature.
  [[nodiscard]] Vec3 pseudonormal(HalfFacet half, Feature feature, bool* boundary) const noexcept;

  /// Calls visit(HalfFacet) for the other half-facets around the corner on the same side, up to kMaxFan.
  /// True: open fan (boundary corner).
  template <class Visit>
  bool around_corner(HalfFacet half, std::uint32_t corner, Visit&& visit) const noexcept {
    std::uint32_t seen = 0;
    const std::uint32_t vertex = facets_[facet_of(half)].vertex[corner];
    if (turn(half, vertex, corner, half, seen, visit)) return false;
    turn(half, vertex, before(corner), half, seen, visit);
    return true;
  }

 private:
  /// Facets around a point of a raster: two for each of its squares but the upper left and the lower right.
  static constexpr std::size_t kRasterFan = 6;
  /// Of numbers as large as this box.
  [[nodiscard]] static double rounding_of(const geometry::Aabb& numbers) noexcept;
  /// Facet numbers are below 2^29, so 2 * facet + side is below this.
  static constexpr std::uint32_t kRadialBase = 0x40000000u;

  /// Walks from `from` over `edge` around `vertex`; true if it returned to `start`.
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

  /// Number of each given vertex; fills vertices_.
  [[nodiscard]] std::vector<std::uint32_t> weld(const std::vector<Vec3>& given, const geometry::Aabb& used,
                                                int threads, MeshOrder order);
  void fill_facets(const geometry::TriangleMesh& mesh, const std::vector<std::uint32_t>& welded, int threads,
                   MeshOrder order);
  void connect(int threads);
  /// True: coincident facets were dropped, so connecting must be repeated.
  bool connect_edges(const std::vector<bool>& two_sided, int threads);
  using Starts = std::vector<std::uint32_t>;
  using Uses = std::vector<std::uint64_t>;
  /// Adds the uses of edges with lower end `vertex`, sorted.
  void add_uses(std::uint32_t vertex, Uses& uses) const;
  /// Keeps the first of facets with equal corners; true if there were others. `uses`: sorted uses of each
  /// vertex's edges, starting at `begin`.
  bool drop_repeated(const Starts& begin, const Uses& uses, std::vector<bool>& two_sided);
  /// Drops facets with their reversed copies at edges that other facets close: remains of simplification
  /// where a closed surface met itself. True if any.
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
  LargePageUninitializedVector<Vec3> vertices_;
  LargePageUninitializedVector<Facet> facets_;
  Buckets stars_;  ///< by vertex
  std::vector<std::array<HalfFacet, 2>> radial_;
  SurfaceMeshCounts counts_;
};

/// Area-weighted unit mean over each vertex's fan, on side 0 of its first facet; zero if it vanishes.
/// O(facets).
[[nodiscard]] std::vector<Vec3f> interpolation_normals(const SurfaceMesh& mesh);

/// Barycentric weights of a point of the facet, summing to 1; all at the first corner if there is no area.
[[nodiscard]] std::array<double, 3> corner_shares(const Facet& f, const Vec3& point) noexcept;

/// Normal interpolated at a point of the facet from corner normals on the side of `side`, or `side` itself if
/// they cancel. Unit if `side` is.
[[nodiscard]] Vec3 interpolated_normal(const Facet& f, std::span<const Vec3f> vertex_normals,
                                       const Vec3& point, const Vec3& side) noexcept;

/// `count` places spread evenly over the mesh's area, one in each equal part of it, the same on every run.
/// Empty without area.
[[nodiscard]] std::vector<Vec3> places_on(const geometry::TriangleMesh& mesh, std::size_t count);

}  // namespace palpate::baselines
