// Measures the quality of neighbour builders: against the surface's own neighbours, and across walls thinner
// than the spacing.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include <palpate/triangle_mesh.h>
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

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
