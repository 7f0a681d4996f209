// Neighbour tables of a cloud (section 3.2.2). Builders make them and walks read them. They give the spacing
// of a cloud, and are scored against the surface's own neighbours and across walls thinner than the spacing.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/progress.h>
#include <palpate/result.h>

namespace palpate::search {

/// Section 3.2.2.5: eight neighbours a point.
inline constexpr std::size_t kNeighbours = 8;

/// Up to eight neighbours of a point, nearest first, ties by index. Unused places hold the point's own index,
/// so a walk needs no count: moving to oneself never improves.
using Neighbours = std::array<std::uint32_t, kNeighbours>;

/// One entry per point, in the cloud's order.
struct NeighbourTable {
  std::vector<Neighbours> of;

  [[nodiscard]] std::size_t size() const noexcept { return of.size(); }
  /// The number of used places.
  [[nodiscard]] std::size_t count(std::size_t point) const noexcept {
    std::size_t n = 0;
    for (const std::uint32_t other : of[point]) n += other != point;
    return n;
  }
};

/// Nearest-rank percentiles, mm.
struct Percentiles {
  double min = 0.0, p50 = 0.0, p99 = 0.0, p999 = 0.0, max = 0.0;
};

struct Spacing {
  /// Section 1.6: the largest distance between immediate neighbours, over all pairs of the table, mm.
  double resolution_mm = 0.0;
  /// The same without z, as the thesis prints for height fields (table 7: 0.1414 against 0.288 in 3D).
  double plan_resolution_mm = 0.0;
  /// From every distinct position to the nearest other.
  Percentiles nearest_mm;
  /// From every point to its last neighbour: the local resolution.
  Percentiles eighth_mm;
  /// Positions repeated so often that the table has no other neighbour; not in nearest_mm.
  std::uint64_t without_nearest = 0;
  /// Median over distinct positions of the smallest |i - j| to a non-coincident neighbour: 1 in scanner
  /// order, large if shuffled.
  double median_index_distance = 0.0;
  /// resolution_mm <= kHighResolutionMm: the thesis's "highly detailed".
  bool high_resolution = false;
};

/// `table` belongs to `cloud`. For a raster use the scanner-path table (the source of the printed values),
/// else exact nearest neighbours. O(n log n); zeros without neighbours.
[[nodiscard]] Spacing describe_spacing(const cloud::Cloud& cloud, const NeighbourTable& table);

/// The share of points with equal neighbour sets, in any order.
struct Agreement {
  std::uint64_t points = 0;
  std::uint64_t equal_sets = 0;
  std::uint64_t interior_points = 0;  ///< points with eight neighbours in both
  std::uint64_t interior_equal = 0;
};
[[nodiscard]] Agreement agreement(const NeighbourTable& a, const NeighbourTable& b);

/// The neighbours along the surface and their origin.
struct SurfaceNeighbours {
  NeighbourTable table;
  std::string from;  ///< "the scanner's order", ...
};

/// The true neighbours: of a raster, those in the scanner's order; with a mesh whose vertex i is point i, the
/// ends of its edges (the nearest eight); else the eight nearest points, true only without a near second
/// sheet. `mesh` may be null. O(n).
[[nodiscard]] SurfaceNeighbours surface_neighbours(const cloud::Cloud& cloud,
                                                   const geometry::TriangleMesh* mesh, int threads);

/// Links that two tables share.
struct LinkAgreement {
  std::uint64_t links = 0;       ///< of the table
  std::uint64_t true_links = 0;  ///< of the truth
  std::uint64_t shared = 0;
  /// Percent of the true links found; 100 without any.
  [[nodiscard]] double found_percent() const noexcept;
};
[[nodiscard]] LinkAgreement link_agreement(const NeighbourTable& table, const NeighbourTable& truth);

/// A closed slab on which the formula gives every point's side.
struct ThinWall {
  cloud::Cloud cloud;             ///< with properties scan, row and column: each face is one scan
  std::vector<std::int8_t> side;  ///< 1 above, -1 below, 0 on or near the rim
  double spacing_mm = 0.0;
  double thickness_spacings = 0.0;
};

struct ThinWallOptions {
  double thickness_spacings = 1.0;
  std::uint32_t across = 150;  ///< cells a side
  double jitter = 0.3;         ///< in spacings; without it the faces' points are exactly opposite
  std::uint64_t seed = 1;
};

/// Points within three spacings or thicknesses of the rim count as near it, because links may go round the
/// edge. An Error if the slab is thicker than wide.
[[nodiscard]] Result<ThinWall> make_thin_wall(const ThinWallOptions& options);

/// Links from face to face, all of which are wrong.
struct WallLinks {
  std::uint64_t points = 0;        ///< away from the rim
  std::uint64_t points_wrong = 0;  ///< with at least one link through the wall
  std::uint64_t links = 0;         ///< between points away from the rim
  std::uint64_t wrong = 0;
  [[nodiscard]] double wrong_percent() const noexcept;  ///< of the links
};
[[nodiscard]] WallLinks links_through_wall(const ThinWall& wall, const NeighbourTable& table);

struct BuilderScore {
  std::string builder;
  std::string failure;  ///< why there is no table, or empty
  std::vector<std::string> notes;
  double one_thread_ms = 0.0;            ///< best of the repeats
  std::optional<double> all_threads_ms;  ///< empty for single-threaded builders
  LinkAgreement agreement;
  std::vector<WallLinks> walls;            ///< one per wall
  std::vector<std::string> wall_failures;  ///< one per wall: why there is no table, or empty
};

struct CompareNeighboursOptions {
  int repeats = 3;
  double long_ms = 3000.0;  ///< slower builds are not repeated
};

/// Runs every named builder (a name, or a name with options). A builder that cannot read a cloud gives a row
/// with its failure. Cancellable between builders. Everything but the times is reproducible.
[[nodiscard]] std::vector<BuilderScore> compare_neighbours(
    std::span<const std::string> builders, const cloud::Cloud& cloud, const NeighbourTable& truth,
    std::span<const ThinWall> walls, const CompareNeighboursOptions& options, Progress& progress);

}  // namespace palpate::search
