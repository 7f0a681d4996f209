#include "toolkit/points/point_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/render/prepare.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/uniform_grid.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::points {

using namespace render;

namespace {

/// Enough for a median that is right to some percent.
constexpr std::size_t kSampledPoints = 4096;
/// A box is as long as the cloud's resolution: in smaller cells it would reach beyond the cells around.
constexpr double kMinCellPerResolution = 0.5;

// Bytes of the partitions for each point, estimates that no decision rests on. A grid has 16 bytes a slot and
// two to four slots an occupied cell; a surface goes through some 1.5 cells for each that would lie flat in
// it.
constexpr double kSlotBytes = 16.0, kSlotsPerCell = 3.0, kAskew = 1.5;
// A node of some ten points.
constexpr double kTreeBytes = 4.0;

/// Its links are mutual and go all ways already.
bool follows_scanner(const std::string& name) {
  const std::vector<search::NeighbourBuilder> all = search::neighbour_builders();
  return std::any_of(all.begin(), all.end(), [&](const search::NeighbourBuilder& builder) {
    return builder.name == name && builder.follows_scanner;
  });
}

Result<search::NeighbourTable> neighbours_of(const cloud::Cloud& cloud, const std::string& builder,
                                             const PointModelOptions& options, int threads,
                                             PrepareReport& report) {
  NamedOptions wanted{builder, {}};
  report.notes.push_back("neighbours: " + builder);
  if (builder == "modified-knn") wanted.options.set("complete", options.complete_to_eight ? "true" : "false");
  PALPATE_ASSIGN(search::NeighbourBuild built, search::build_neighbours(wanted, cloud, threads));
  report.notes.insert(report.notes.end(), built.notes.begin(), built.notes.end());
  return std::move(built.table);
}

/// The largest of value(i) over all points.
template <class Value>
auto largest(std::size_t n, int threads, const Value& value) {
  using Found = decltype(value(std::size_t{}));
  const auto worst = parallel_parts<Found>(
      n, kPointsPerChunk, threads, [&](std::size_t i, Found& here) { here = std::max(here, value(i)); });
  return *std::max_element(worst.begin(), worst.end());
}

/// The largest distance between immediate neighbours (section 1.6).
double worst_resolution(const cloud::Cloud& cloud, const search::NeighbourTable& table, int threads) {
  return std::sqrt(largest(cloud.size(), threads, [&](std::size_t i) {
    double square = 0.0;
    for (const std::uint32_t other : table.of[i])
      square = std::max(square, (cloud.local_mm(other) - cloud.local_mm(i)).squaredNorm());
    return square;
  }));
}

/// The median over points spread evenly through the file of a distance squared, as a distance.
template <class Square>
double median_of(const cloud::Cloud& cloud, const Square& square_of) {
  const std::size_t n = cloud.size(), count = std::min(n, kSampledPoints);
  std::vector<double> square(count, 0.0);
  for (std::size_t k = 0; k < count; ++k) square[k] = square_of(k * n / count);
  return std::sqrt(upper_median(std::move(square)));
}

/// To the last neighbour.
double median_local_resolution(const cloud::Cloud& cloud, const search::NeighbourTable& table) {
  return median_of(cloud, [&](std::size_t i) {
    double square = 0.0;
    for (const std::uint32_t other : table.of[i])
      square = std::max(square, (cloud.local_mm(other) - cloud.local_mm(i)).squaredNorm());
    return square;
  });
}

/// To the first that stands elsewhere.
double median_nearest(const cloud::Cloud& cloud, const search::NeighbourTable& table) {
  return median_of(cloud, [&](std::size_t i) {
    double square = 0.0;
    for (const std::uint32_t other : table.of[i]) {
      const double way = (cloud.local_mm(other) - cloud.local_mm(i)).squaredNorm();
      if (way > 0.0 && !(square > 0.0 && square <= way)) square = way;
    }
    return square;
  });
}

/// The thesis sizes cells by the resolution, which is that of the cloud's sparsest place. Where points
/// are unevenly spaced such cells hold thousands of them, and all are looked at while the HIP is near.
double cell_edge_mm(const cloud::Cloud& cloud, const PointModelOptions& options,
                    const search::NeighbourTable& table, double resolution_mm) {
  if (options.cell_per_resolution > 0.0) return options.cell_per_resolution * resolution_mm;
  return std::clamp(kCellPerResolution * median_local_resolution(cloud, table),
                    kMinCellPerResolution * resolution_mm, kCellPerResolution * resolution_mm);
}

/// The largest half lengths of boxes of a size per vertex.
Vec3 largest_half_box(const cloud::Cloud& cloud, const search::NeighbourTable& table, BoxSize box,
                      int threads) {
  Vec3 most = Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis)
    most[axis] = largest(cloud.size(), threads, [&](std::size_t i) {
      double half = 0.0;
      for (const std::uint32_t other : table.of[i])
        half = std::max(half, std::abs(cloud.local_mm(other)[axis] - cloud.local_mm(i)[axis]));
      return half;
    });
  if (box == BoxSize::kPerVertexCube) most.setConstant(most.maxCoeff());
  for (int axis = 0; axis < 3; ++axis) most[axis] = static_cast<double>(stored_half_box(most[axis]));
  return most;
}

const char* name_of(PartitionKind kind) {
  return kind == PartitionKind::kGrid ? "grid" : kind == PartitionKind::kOctree ? "octree" : "quadtree";
}

Decision neighbours_decision(const cloud::Cloud& cloud, const PointModelOptions& options,
                             const PointDecision& decision) {
  if (options.neighbours != "auto") return {"neighbours", decision.neighbours, "as given", true};
  if (decision.from_scan)
    return {"neighbours", decision.neighbours,
            fmt::format("the points stand in a scanner's order, {} rows of {}: nothing has to be searched",
                        cloud.raster->rows, cloud.raster->columns)};
  return {"neighbours", decision.neighbours, "the order of the points says nothing about neighbours"};
}

/// The reason why a cell is larger than requested.
const char* fewer_cells(const PointModelOptions& options, const PointDecision& decision) {
  const double asked = options.cell_per_resolution * decision.resolution_mm;
  return decision.cell_mm > asked ? ", as far as a box reaches: a frame looks at no more of finer ones" : "";
}

Decision partition_decision(const PointModelOptions& options, const PointDecision& decision) {
  const bool given = decision.partition != PartitionKind::kGrid;
  const char* const name = name_of(decision.partition);
  if (given)
    return {"partition", name,
            fmt::format("leaves of {} points choose their own sizes", search::kPointsPerLeaf), true};
  return {"partition", name,
          fmt::format("cells of {:.3g} mm, {:.3g} resolutions{}; memory follows the occupied ones",
                      decision.cell_mm, decision.cell_mm / decision.resolution_mm,
                      options.cell_per_resolution > 0.0 ? fewer_cells(options, decision)
                                                        : ", five times the median local resolution where "
                                                          "that is between half and five of them")};
}

Decision box_decision(const PointModelOptions& options, const PointDecision& decision) {
  if (decision.box == BoxSize::kGlobal)
    return {"boxes", fmt::format("one size, {:.3g} mm", decision.box_mm),
            options.box_mm > 0.0 ? "as given" : "the resolution: boxes of neighbours touch",
            options.box_mm > 0.0};
  return {"boxes", decision.box == BoxSize::kPerVertex ? "per vertex" : "per vertex, cubes",
          fmt::format("as large as the way to the neighbours, at most {:.3g} mm",
                      2.0 * decision.largest_half_box_mm.maxCoeff()),
          true};
}

}  // namespace

std::string neighbours_for(const cloud::Cloud& cloud, const PointModelOptions& options) {
  if (options.neighbours != "auto") return options.neighbours;
  return cloud.raster ? "scanner-path" : "modified-knn";
}

Result<PointSurvey> survey_points(const cloud::Cloud& cloud, const PointModelOptions& options,
                                  const PrepareContext& context, PrepareReport& report) {
  if (cloud.empty()) return Error{"the cloud has no points", "give a file with at least one point"};
  PointSurvey found;
  PointDecision& decided = found.decision;
  decided.neighbours = neighbours_for(cloud, options);
  decided.from_scan = follows_scanner(decided.neighbours);

  PreparePhases phases(report, context);
  phases.begin("neighbours");
  PALPATE_ASSIGN(found.neighbours,
                 neighbours_of(cloud, decided.neighbours, options, context.threads, report));
  phases.end();

  phases.begin("resolution");
  decided.max_spacing_mm = worst_resolution(cloud, found.neighbours, context.threads);
  decided.median_nearest_mm = median_nearest(cloud, found.neighbours);
  decided.resolution_mm = options.resolution_mm > 0.0 ? options.resolution_mm : decided.max_spacing_mm;
  decided.coincident = !(decided.resolution_mm > 0.0);
  if (decided.coincident) {
    decided.resolution_mm = cloud::fallback_spacing_mm(cloud);
    report.notes.push_back("all points coincide: the resolution is a stand-in");
  }
  phases.end();

  // The resolution is that of the nearest eight; links out of clumps may be longer. The scanner's path has a
  // link back for each of its own.
  decided.normals = options.normals;
  if (decided.normals && !decided.from_scan) {
    phases.begin("links");
    const search::WalkableReport repaired = search::make_walkable(cloud, found.neighbours, context.threads);
    if (repaired.spread + repaired.returned > 0)
      report.notes.push_back(fmt::format("neighbours spread at {} points, links back given to {}",
                                         repaired.spread, repaired.returned));
    phases.end();
  }

  decided.partition = options.partition;
  decided.cell_mm = cell_edge_mm(cloud, options, found.neighbours, decided.resolution_mm);
  if (decided.partition == PartitionKind::kGrid)
    decided.cell_mm = search::UniformGrid::cell_for(cloud, decided.cell_mm, context.threads);
  decided.box = options.box;
  decided.box_mm = options.box_mm > 0.0 ? options.box_mm : decided.resolution_mm;
  decided.largest_half_box_mm = decided.box == BoxSize::kGlobal
                                    ? Vec3(Vec3::Constant(0.5 * decided.box_mm))
                                    : largest_half_box(cloud, found.neighbours, decided.box, context.threads);
  if (options.swept_sphere)
    decided.sphere_mm = options.sphere_mm > 0.0 ? options.sphere_mm : decided.largest_half_box_mm.maxCoeff();
  // A frame looks at every cell within a box of its segment: finer ones would be more than it may. (Who makes
  // no promise takes them as they are given.)
  if (options.normals && decided.partition == PartitionKind::kGrid)
    decided.cell_mm =
        std::max(decided.cell_mm, decided.largest_half_box_mm.maxCoeff() + std::max(decided.sphere_mm, 0.0));
  decided.rounding_mm = coordinate_rounding_mm(cloud);
  return found;
}

Result<PointModelDecision> decide_point_model(const ModelInput& input, const PointModelOptions& options,
                                              const PrepareContext& context) {
  PrepareReport unused;
  PALPATE_ASSIGN(const PointSurvey survey, survey_points(*input.cloud, options, context, unused));
  PALPATE_ASSIGN(SurfaceDecision surface, decide_surface(input));
  return PointModelDecision{survey.decision, std::move(surface)};
}

void describe_points(const cloud::Cloud& cloud, const PointModelOptions& options,
                     const PointDecision& decision, ModelDecisions& out) {
  out.points = cloud.size();
  out.spacing_mm = decision.max_spacing_mm;
  std::vector<Decision>& say = out.decisions;
  say.push_back(neighbours_decision(cloud, options, decision));
  say.push_back(partition_decision(options, decision));
  say.push_back(box_decision(options, decision));
  if (options.swept_sphere)
    say.push_back({"box test", fmt::format("swept sphere, {:.3g} mm", decision.sphere_mm),
                   options.sphere_mm > 0.0 ? "as given" : "half the edge of the largest box", true});
  say.push_back(coordinates_decision(cloud, decision.median_nearest_mm));
  const double edge = decision.median_nearest_mm > 0.0 ? decision.cell_mm / decision.median_nearest_mm : 1.0;
  const double grid_bytes = kSlotBytes * kSlotsPerCell / std::max(1.0, edge * edge / kAskew);
  const double each = sizeof(surface::OrientedPoint) + sizeof(search::Neighbours) +
                      (decision.box == BoxSize::kGlobal ? 0.0 : sizeof(Vec3f)) +
                      (decision.partition == PartitionKind::kGrid ? grid_bytes : kTreeBytes);
  out.bytes += static_cast<std::uint64_t>(each * static_cast<double>(cloud.size()));
}

}  // namespace palpate::points
