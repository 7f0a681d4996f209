#include "toolkit/search/neighbour_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/clock.h>
#include <palpate/generate.h>
#include <palpate/result.h>
#include "toolkit/cloud/height_field.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/knn_kernels.h"

namespace palpate::search {
namespace {

Percentiles percentiles(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  return {values.front(), nearest_rank(values, 50.0), nearest_rank(values, 99.0), nearest_rank(values, 99.9),
          values.back()};
}

}  // namespace

Spacing describe_spacing(const cloud::Cloud& cloud, const NeighbourTable& table) {
  Spacing found;
  std::vector<double> nearest, eighth, index_distance;
  nearest.reserve(table.size());
  eighth.reserve(table.size());
  index_distance.reserve(table.size());
  double longest_sq = 0.0, longest_plan_sq = 0.0;
  for (std::size_t i = 0; i < table.size(); ++i) {
    const Vec3 p = cloud.local_mm(i);
    double nearest_sq = 0.0, last_sq = 0.0;
    std::size_t closest_in_order = cloud.size();
    bool repeated = false;  // coincides with an earlier point
    for (const std::uint32_t other : table.of[i]) {
      if (other == i) continue;
      const Vec3 offset = cloud.local_mm(other) - p;
      const double sq = offset.squaredNorm();
      last_sq = std::max(last_sq, sq);
      longest_plan_sq = std::max(longest_plan_sq, offset.head<2>().squaredNorm());
      if (sq == 0.0) {
        repeated = repeated || other < i;
      } else {
        if (nearest_sq == 0.0 || sq < nearest_sq) nearest_sq = sq;
        closest_in_order = std::min(closest_in_order, other > i ? other - i : i - other);
      }
    }
    longest_sq = std::max(longest_sq, last_sq);
    eighth.push_back(std::sqrt(last_sq));
    if (repeated) continue;
    if (nearest_sq > 0.0) {
      nearest.push_back(std::sqrt(nearest_sq));
      index_distance.push_back(static_cast<double>(closest_in_order));
    } else {
      ++found.without_nearest;
    }
  }
  found.resolution_mm = std::sqrt(longest_sq);
  found.plan_resolution_mm = std::sqrt(longest_plan_sq);
  found.nearest_mm = percentiles(std::move(nearest));
  found.eighth_mm = percentiles(std::move(eighth));
  found.median_index_distance = percentiles(std::move(index_distance)).p50;
  found.high_resolution = found.resolution_mm <= kHighResolutionMm;
  return found;
}

Agreement agreement(const NeighbourTable& a, const NeighbourTable& b) {
  Agreement sum;
  const std::size_t n = std::min(a.size(), b.size());
  const auto compare = [&](std::size_t i, Agreement& part) {
    Neighbours x = a.of[i], y = b.of[i];
    std::sort(x.begin(), x.end());
    std::sort(y.begin(), y.end());
    const bool equal = x == y;
    const bool interior = a.count(i) == kNeighbours && b.count(i) == kNeighbours;
    ++part.points;
    part.equal_sets += equal;
    part.interior_points += interior;
    part.interior_equal += interior && equal;
  };
  for (const auto& part : parallel_parts<Agreement>(n, kPointsPerChunk, 0, compare)) {
    sum.points += part.points;
    sum.equal_sets += part.equal_sets;
    sum.interior_points += part.interior_points;
    sum.interior_equal += part.interior_equal;
  }
  return sum;
}

namespace {

constexpr double kPercent = 100.0;
/// Width of the rim in spacings or thicknesses; eight neighbours reach less far.
constexpr double kRim = 3.0;
/// Spacing of thin walls; only ratios matter.
constexpr double kWallSpacingMm = 0.25;

/// The ends of a mesh's edges at every vertex.
NeighbourTable edges_of(const cloud::Cloud& cloud, const geometry::TriangleMesh& mesh) {
  std::vector<std::array<std::uint32_t, 2>> edges;
  edges.reserve(6 * mesh.triangles.size());
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      if (a == b) continue;
      edges.push_back({a, b});
      edges.push_back({b, a});
    }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  NeighbourTable table;
  table.of.resize(cloud.size());
  auto at = edges.begin();
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    NearestEight nearest;
    for (; at != edges.end() && (*at)[0] == i; ++at)
      nearest.offer((cloud.local_mm((*at)[1]) - cloud.local_mm(i)).squaredNorm(), (*at)[1]);
    nearest.store(i, table.of[i]);
  }
  return table;
}

/// The position that a scanner on each side of a slab would give the point; the rim is a third, unordered
/// scan.
ScanPosition position_on(const cloud::BoxLattice& lattice, std::uint32_t through, std::size_t index) {
  const auto at = lattice.coordinates(index);
  if (at[2] == 0 || at[2] == through) return {at[2] == 0 ? 1u : 0u, at[1], at[0]};
  return {2u, static_cast<std::uint32_t>(2 * index), 0u};
}

}  // namespace

SurfaceNeighbours surface_neighbours(const cloud::Cloud& cloud, const geometry::TriangleMesh* mesh,
                                     int threads) {
  if (cloud.raster)
    if (Result<NeighbourTable> path = scanner_path(cloud, threads))
      return {*std::move(path), "the scanner's order"};
  if (mesh != nullptr && !mesh->empty() && mesh->vertices_mm.size() == cloud.size())
    return {edges_of(cloud, *mesh), "the edges of its own mesh"};
  return {exact_knn(cloud, threads), "the eight nearest points, for want of better"};
}

double LinkAgreement::found_percent() const noexcept {
  return true_links == 0 ? kPercent
                         : kPercent * static_cast<double>(shared) / static_cast<double>(true_links);
}

LinkAgreement link_agreement(const NeighbourTable& table, const NeighbourTable& truth) {
  LinkAgreement sum;
  for (std::size_t i = 0; i < std::min(table.size(), truth.size()); ++i) {
    const Neighbours& row = table.of[i];
    sum.links += table.count(i);
    for (const std::uint32_t other : truth.of[i]) {
      if (other == i) continue;
      ++sum.true_links;
      sum.shared += std::find(row.begin(), row.end(), other) != row.end();
    }
  }
  return sum;
}

Result<ThinWall> make_thin_wall(const ThinWallOptions& options) {
  ThinWall wall;
  wall.spacing_mm = kWallSpacingMm;
  wall.thickness_spacings = options.thickness_spacings;
  const double extent_mm = kWallSpacingMm * options.across;
  const double thickness_mm = options.thickness_spacings * kWallSpacingMm;
  PALPATE_ASSIGN(const NamedOptions spec,
                 parse_named_options(fmt::format(
                     "slab:extent_mm={}:spacing_mm={}:thickness_mm={}:jitter={}:seed={}:mesh=false",
                     extent_mm, kWallSpacingMm, thickness_mm, options.jitter, options.seed)));
  PALPATE_ASSIGN(cloud::GeneratedModel model, cloud::generate(spec));
  wall.cloud = std::move(model.cloud);
  const auto through = static_cast<std::uint32_t>(std::max(1.0, std::round(options.thickness_spacings)));
  const cloud::BoxLattice lattice(options.across, options.across, through);
  if (lattice.size() != wall.cloud.size())
    return Error{fmt::format("a slab of {} points was made where {} were asked for", wall.cloud.size(),
                             lattice.size()),
                 "give a whole number of cells"};
  const double inner_mm = 0.5 * extent_mm - kRim * std::max(kWallSpacingMm, thickness_mm);
  cloud::Property scan{"scan", {}}, row{"row", {}}, column{"column", {}};
  wall.side.resize(wall.cloud.size());
  for (std::size_t i = 0; i < wall.cloud.size(); ++i) {
    const Vec3 p = wall.cloud.point_mm(i);
    const ScanPosition at = position_on(lattice, through, i);
    scan.values.push_back(static_cast<float>(at.scan));
    row.values.push_back(static_cast<float>(at.row));
    column.values.push_back(static_cast<float>(at.column));
    const bool inner = std::max(std::abs(p.x()), std::abs(p.y())) < inner_mm;
    const Vec3 normal = model.surface->closest(p).normal;
    wall.side[i] = static_cast<std::int8_t>(!inner ? 0 : normal.z() > 0.0 ? 1 : -1);
  }
  wall.cloud.properties = {std::move(scan), std::move(row), std::move(column)};
  return wall;
}

double WallLinks::wrong_percent() const noexcept {
  return links == 0 ? 0.0 : kPercent * static_cast<double>(wrong) / static_cast<double>(links);
}

WallLinks links_through_wall(const ThinWall& wall, const NeighbourTable& table) {
  WallLinks sum;
  for (std::uint32_t i = 0; i < table.size(); ++i) {
    if (wall.side[i] == 0) continue;
    std::uint64_t wrong = 0;
    for (const std::uint32_t other : table.of[i]) {
      if (other == i || wall.side[other] == 0) continue;
      ++sum.links;
      wrong += wall.side[other] != wall.side[i];
    }
    ++sum.points;
    sum.points_wrong += wrong > 0;
    sum.wrong += wrong;
  }
  return sum;
}

namespace {

/// The best time of the repeats; the table of the last.
Result<NeighbourBuild> timed(const std::string& builder, const cloud::Cloud& cloud, int threads,
                             const CompareNeighboursOptions& options, double& best_ms) {
  Result<NeighbourBuild> built = Error{};
  for (int k = 0; k < std::max(options.repeats, 1); ++k) {
    const Stopwatch watch;
    built = build_neighbours(builder, cloud, threads);
    const double ms = watch.ms();
    if (k == 0 || ms < best_ms) best_ms = ms;
    if (!built || ms > options.long_ms) break;
  }
  return built;
}

BuilderScore score_of(const std::string& builder, const cloud::Cloud& cloud, const NeighbourTable& truth,
                      std::span<const ThinWall> walls, const CompareNeighboursOptions& options) {
  BuilderScore score;
  score.builder = builder;
  const std::vector<NeighbourBuilder> known = neighbour_builders();
  const bool one_thread = std::any_of(known.begin(), known.end(), [&](const NeighbourBuilder& b) {
    return b.one_thread && builder.substr(0, builder.find(':')) == b.name;
  });
  if (Result<NeighbourBuild> built = timed(builder, cloud, 1, options, score.one_thread_ms)) {
    score.notes = std::move(built->notes);
    score.agreement = link_agreement(built->table, truth);
    double all_ms = 0.0;
    if (!one_thread && timed(builder, cloud, 0, options, all_ms)) score.all_threads_ms = all_ms;
  } else {
    score.failure = built.error().message();
  }
  for (const ThinWall& wall : walls) {
    const Result<NeighbourBuild> built = build_neighbours(builder, wall.cloud, 0);
    score.walls.push_back(built ? links_through_wall(wall, built->table) : WallLinks{});
    score.wall_failures.push_back(built ? std::string() : built.error().message());
  }
  return score;
}

}  // namespace

std::vector<BuilderScore> compare_neighbours(std::span<const std::string> builders, const cloud::Cloud& cloud,
                                             const NeighbourTable& truth, std::span<const ThinWall> walls,
                                             const CompareNeighboursOptions& options, Progress& progress) {
  std::vector<BuilderScore> scores;
  for (std::size_t b = 0; b < builders.size() && !progress.cancelled(); ++b) {
    progress.report("building neighbours: " + builders[b],
                    static_cast<double>(b) / static_cast<double>(builders.size()));
    scores.push_back(score_of(builders[b], cloud, truth, walls, options));
  }
  return scores;
}

}  // namespace palpate::search
