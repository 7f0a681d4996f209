// Builders of a cloud's neighbour tables (section 3.2.2), by name. All but connect() are parallel and
// independent of the number of threads; neighbours are ordered by (distance, index), with squared distances
// in double from stored coordinates.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/options.h>
#include <palpate/result.h>
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

/// The eight nearest other points of every point; coincident points are neighbours at distance 0. The
/// reference for all other builders. O(n) for clouds of bounded density variation.
[[nodiscard]] NeighbourTable exact_knn(const cloud::Cloud& cloud, int threads);

/// sqrt(occupied area / points), the unit of start_size. The area is counted in cells of about six points, so
/// it is that of a surface; O(n).
[[nodiscard]] double mean_spacing_mm(const cloud::Cloud& cloud);

/// Section 3.2.2.5.
struct ModifiedKnnOptions {
  bool complete_to_eight = true;  ///< ours; false is the printed form, which may find fewer than eight
  double start_size = 1.0;        ///< first cube edge, in units of mean_spacing_mm(); not printed
  double refinement =
      0.70710678118654752;     ///< factor between sizes, in (0, 1); not printed. Halves a cube's face
  double growth_limit = 64.0;  ///< largest cube edge in units of the first: the second stopping rule
};

struct ModifiedKnnReport {
  std::uint64_t stopped_at_nine = 0;   ///< points whose block held at most nine
  std::uint64_t stopped_at_limit = 0;  ///< points whose cube reached the growth limit (second rule)
  std::uint64_t fewer_than_eight = 0;
};

[[nodiscard]] NeighbourTable modified_knn(const cloud::Cloud& cloud, const ModifiedKnnOptions& options,
                                          int threads, ModifiedKnnReport* report = nullptr);

struct FixedDistanceOptions {
  /// mm, inclusive. 0: 1.68 mean spacings, the geometric middle between a square grid's eighth neighbour at
  /// 1.41 and ninth at 2. The thesis prints no distance.
  double distance_mm = 0.0;
};

struct FixedDistanceReport {
  double distance_mm = 0.0;                                 ///< as used
  std::uint64_t more_than_eight = 0, fewer_than_eight = 0;  ///< points
  /// Total neighbours within the distance, which unbounded lists would hold (four bytes each). Of coincident
  /// points nine are counted.
  std::uint64_t within = 0;
};

/// Rows hold the nearest eight within the distance. O(points within the distance, summed).
[[nodiscard]] NeighbourTable fixed_distance(const cloud::Cloud& cloud, const FixedDistanceOptions& options,
                                            int threads, FixedDistanceReport* report = nullptr);

/// Section 3.2.2.1: a point may know "its nearest neighbor in some general direction", the local space being
/// divided into partitions; figure 39 names eight directions. The division is not printed. Ours: eight
/// 45-degree wedges around the normal of a plane through the point, centred on the directions. East is the x
/// axis in the plane (y if the normal is nearest to x); north is left of east seen from the tip of the
/// normal, whose largest component is positive.
struct DirectionalKnnOptions {
  enum class Frame : std::uint8_t {
    kTangent,  ///< the best-fitting plane of the point and its eight nearest
    kPlan      ///< the plane z = const: east is x, north is y
  };
  Frame frame = Frame::kTangent;
  /// Search range of a direction, in distances to the eighth non-coincident neighbour; a direction without
  /// points stays empty. On a square grid the eighth is 1.41 spacings away, so the default bridges three
  /// missing points.
  double reach = 3.0;
  /// Points off the plane by a larger angle are above or below, in no direction.
  double steepest_deg = 45.0;
};

struct DirectionalKnnReport {
  std::uint64_t all_eight = 0;         ///< points with a neighbour in every direction
  std::uint64_t empty_directions = 0;  ///< over all points
  std::uint64_t without_plane = 0;     ///< the eight nearest are collinear, or fewer than two
};

/// Rows hold at most one point per direction, nearest first, ties by index. Coincident points are never
/// neighbours here. O(n) for clouds of bounded density variation; independent of the number of threads.
[[nodiscard]] NeighbourTable directional_knn(const cloud::Cloud& cloud, const DirectionalKnnOptions& options,
                                             int threads, DirectionalKnnReport* report = nullptr);

struct ConnectReport {
  std::uint64_t pieces = 0;       ///< components of the links, ignoring direction
  std::uint64_t unreached = 0;    ///< points not reachable along links from the first point
  std::uint64_t links_given = 0;  ///< links added, in free slots or those of unused links
  double longest_link_mm = 0.0;   ///< of the added links
};

/// Makes the neighbour graph connected. Section 3.2.2.1: "ensuring that the resulting neighborhood map is
/// completely connected (by compiling the neighborhood information recursively rather than iteratively)". Our
/// reading: the map grows from the first point, and every point must be reachable along links. Reached points
/// give a link to the nearest unreached point that lists them; unlinked pieces are joined both ways at their
/// closest pairs (the shortest set of joints). A new link takes a free slot, or that of the farthest unused
/// link; rows stay ordered by (distance, index). O(n log n), single-threaded.
ConnectReport connect(const cloud::Cloud& cloud, NeighbourTable& table);

/// exact_knn, connected.
[[nodiscard]] NeighbourTable connected_knn(const cloud::Cloud& cloud, int threads,
                                           ConnectReport* report = nullptr);

struct CutOffReport {
  std::uint64_t links_cut = 0;
  std::uint64_t points_cut = 0;      ///< points that lost a link
  std::uint64_t points_without = 0;  ///< points that lost all links
};

/// Removes neighbours farther than `factor` local spacings: the threshold of section 3.2.2.1, "related to the
/// point cloud's density in the area being examined". The relation is not printed. Ours: the local spacing is
/// the median, over the point and its neighbours, of the distance to their fourth neighbour (one spacing on a
/// square grid). Rows keep their order. Parallel; independent of the number of threads. O(n).
CutOffReport cut_off_by_density(const cloud::Cloud& cloud, NeighbourTable& table, double factor, int threads);

struct WalkableReport {
  std::size_t spread = 0;    ///< points whose eight nearest were in a row or on one side
  std::size_t returned = 0;  ///< points that received links back
};

/// Repairs rows that trap a walk: all eight nearest in one scan line or dense clump. Neither repair changes
/// evenly spaced points. First, rows in a line or on one side choose eight of the 24 nearest in different
/// directions: a candidate drops back if a kept one is nearer to it than the point is, and the nearest
/// dropped ones fill up. Second, if p lists q, q does not list p, and no neighbour of q is nearer to p, then
/// q gets the link and chooses likewise. Rows stay ordered by (distance, index). Parallel; independent of the
/// number of threads. O(n).
WalkableReport make_walkable(const cloud::Cloud& cloud, NeighbourTable& table, int threads);

/// Section 3.2.2.4: the eight neighbours of (row, column) in a full raster of any order; fewer at borders
/// that do not wrap. Needs cloud.raster.
[[nodiscard]] Result<NeighbourTable> scanner_path(const cloud::Cloud& cloud, int threads);
/// The same for a raster that was recognised (cloud::find_raster) or is known otherwise.
[[nodiscard]] Result<NeighbourTable> scanner_path(const cloud::Cloud& cloud, const cloud::ScanRaster& raster,
                                                  int threads);

/// Least rows or columns of a whole turn; with fewer, next and previous coincide.
inline constexpr std::uint32_t kMinWrapCount = 3;

struct ScanPosition {
  std::uint32_t scan = 0, row = 0, column = 0;
  friend bool operator==(const ScanPosition&, const ScanPosition&) = default;
};

/// One position per point, in the cloud's order; all distinct.
struct ScanTable {
  std::vector<ScanPosition> of;
  /// Columns (rows) of a whole turn, where the first follows the last; 0: no wrap.
  std::uint32_t columns_wrap = 0, rows_wrap = 0;
};

/// From cloud.raster. An Error without one, or if it does not match the number of points.
[[nodiscard]] Result<ScanTable> scan_table_of_raster(const cloud::Cloud& cloud);

/// From the properties `row`, `column` and optionally `scan` (text columns, PLY properties, or those left by
/// reading an organised PCD or raster PLY with holes). Integers from 0 to 2^24, else an Error that names the
/// point.
[[nodiscard]] Result<ScanTable> scan_table_of_properties(const cloud::Cloud& cloud);

/// From the raster if there is one, else from the properties.
[[nodiscard]] Result<ScanTable> scan_table_of(const cloud::Cloud& cloud);

struct LookupOptions {
  /// Missing positions that a link may skip, per direction; 0: only adjacent ones. Links are mutual. The
  /// thesis says nothing on holes.
  std::uint32_t across = 2;
};

struct LookupReport {
  std::uint64_t links_across_holes = 0;
  std::uint64_t fewer_than_eight = 0;  ///< points
};

/// Neighbours at the eight positions around, or the next beyond holes, within one scan. An Error if the table
/// does not match the cloud or two points share a position. O(n); independent of the number of threads.
[[nodiscard]] Result<NeighbourTable> lookup_table(const cloud::Cloud& cloud, const ScanTable& table,
                                                  const LookupOptions& options, int threads,
                                                  LookupReport* report = nullptr);

/// A table with remarks, one sentence each.
struct NeighbourBuild {
  NeighbourTable table;
  std::vector<std::string> notes;
};

struct NeighbourBuilder {
  std::string name;
  std::string summary;  ///< one line
  std::string source;   ///< thesis section
  std::vector<OptionSpec> options;
  /// Needs a non-empty cloud and options completed by validate(). Independent of the number of threads (0 =
  /// all). An Error if the cloud lacks what the builder reads.
  std::function<Result<NeighbourBuild>(const cloud::Cloud&, const Options&, int threads)> build;
  /// Follows the scanner instead of searching: needs a scan's order; links are mutual.
  bool follows_scanner = false;
  bool one_thread = false;  ///< always single-threaded
};

/// All builders: those here in the order of section 3.2.2, then those added. A copy; thread-safe.
[[nodiscard]] std::vector<NeighbourBuilder> neighbour_builders();

/// Adds another module's builder, replacing one of the same name. Call before threads use
/// neighbour_builders().
void add_neighbour_builder(NeighbourBuilder builder);

/// Builds by name ("directional-knn"), with options if wanted ("fixed-distance:distance_mm=0.3"). Errors for
/// unknown names and options list the known ones.
[[nodiscard]] Result<NeighbourBuild> build_neighbours(std::string_view name_and_options,
                                                      const cloud::Cloud& cloud, int threads);
[[nodiscard]] Result<NeighbourBuild> build_neighbours(const NamedOptions& wanted, const cloud::Cloud& cloud,
                                                      int threads);

}  // namespace palpate::search
