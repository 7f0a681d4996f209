// How good neighbours are: against those that the surface itself knows, and across walls so thin that the
// nearest point may be on the other side.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

/// The neighbours along the surface, and how they are known.
struct SurfaceNeighbours {
  NeighbourTable table;
  std::string from;  ///< "the scanner's order", ...
};

/// Of a raster, the points around in the scanner's order; else with a mesh whose vertex i is point i, the
/// ends of its edges (the nearest eight where there are more); else the eight nearest points, which are true
/// only where no other sheet is near. `mesh` may be null. O(n).
[[nodiscard]] SurfaceNeighbours surface_neighbours(const cloud::Cloud& cloud,
                                                   const geometry::TriangleMesh* mesh, int threads);

/// Links shared by two tables.
struct LinkAgreement {
  std::uint64_t links = 0;       ///< of the table
  std::uint64_t true_links = 0;  ///< of the truth
  std::uint64_t shared = 0;
  /// Percent of the true links that were found; 100 where there are none.
  [[nodiscard]] double found_percent() const noexcept;
};
[[nodiscard]] LinkAgreement link_agreement(const NeighbourTable& table, const NeighbourTable& truth);

/// A closed slab of which every point's side is known from its formula.
struct ThinWall {
  cloud::Cloud cloud;             ///< with properties scan, row and column: each face is one scan
  std::vector<std::int8_t> side;  ///< 1 above, -1 below, 0 on the rim or near it
  double spacing_mm = 0.0;
  double thickness_spacings = 0.0;
};

struct ThinWallOptions {
  double thickness_spacings = 1.0;
  std::uint32_t across = 150;  ///< cells a side
  double jitter = 0.3;         ///< of the spacing; without it both faces' points stand exactly opposite
  std::uint64_t seed = 1;
};

/// A point is near the rim within three spacings or three thicknesses, where links may lead round the edge.
/// An Error where the slab would be thicker than wide.
[[nodiscard]] Result<ThinWall> make_thin_wall(const ThinWallOptions& options);

/// Links from face to face, none of which are along the surface.
struct WallLinks {
  std::uint64_t points = 0;        ///< away from the rim
  std::uint64_t points_wrong = 0;  ///< with at least one link through the wall
  std::uint64_t links = 0;         ///< between points away from the rim
  std::uint64_t wrong = 0;
  [[nodiscard]] double wrong_percent() const noexcept;  ///< of the links
};
[[nodiscard]] WallLinks links_through(const ThinWall& wall, const NeighbourTable& table);

struct BuilderScore {
  std::string builder;
  std::string failure;  ///< why there is no table; else empty
  std::vector<std::string> notes;
  double one_thread_ms = 0.0;            ///< best of the repeats
  std::optional<double> all_threads_ms;  ///< none where the builder knows one thread only
  LinkAgreement agreement;
  std::vector<WallLinks> walls;            ///< one per wall
  std::vector<std::string> wall_failures;  ///< one per wall: empty, or why there is no table
};

struct CompareOptions {
  int repeats = 3;
  double long_ms = 3000.0;  ///< what takes longer is not repeated
};

/// Builds with every builder named (a name, or a name with options) and says how each did; a builder that
/// cannot read a cloud is a row with its failure. Cancelled between builders. All but the times is the same
/// on every run.
[[nodiscard]] std::vector<BuilderScore> compare_neighbours(std::span<const std::string> builders,
                                                           const cloud::Cloud& cloud,
                                                           const NeighbourTable& truth,
                                                           std::span<const ThinWall> walls,
                                                           const CompareOptions& options, Progress& progress);

}  // namespace palpate::neighbourhood
