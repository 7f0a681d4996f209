#include "baselines/points/point_grid.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

#include <palpate/result.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/render/prepare.h"
#include "toolkit/search/knn.h"

namespace palpate::baselines {
namespace {

/// Bytes of a slot of the grid's table, and mean number of slots for an occupied cell, two to four.
constexpr double kSlotBytes = 16.0, kSlotsPerCell = 3.0;
/// Number of cells that a surface askew to them goes through for each that would lie flat in it.
constexpr double kAskew = 1.5;
/// Edge of a cell in spacings if nobody measured them: those of the usual proxy have eight.
constexpr double kUsualEdge = 8.0;

}  // namespace

double natural_spacing_mm(const cloud::Cloud& cloud, int threads) {
  const geometry::Aabb box = search::local_box(cloud, threads);
  if (box.extent_mm().maxCoeff() > 0.0) {
    const double spacing = search::mean_spacing_mm(cloud);
    if (spacing > 0.0) return spacing;
  }
  return cloud::fallback_spacing_mm(cloud);
}

PointGrid build_point_grid(const cloud::Cloud& cloud, double cell_mm, int threads) {
  search::PartitionOptions options;
  options.cell_mm = cell_mm;
  PointGrid made = build_points_in<search::UniformGrid>(cloud, options, threads);
  made.grid.drop_order();
  return made;
}

void report_spacing(double spacing_mm, render::ModelDecisions& out) {
  out.spacing_mm = spacing_mm;
  out.decisions.push_back({"spacing", fmt::format("{:.4g} mm", spacing_mm),
                           "the mean: the root of the occupied area per point, in which lengths are given"});
}

void report_grid(const cloud::Cloud& cloud, double spacing_mm, double cell_mm, render::ModelDecisions& out) {
  const double edge = spacing_mm > 0.0 ? cell_mm / spacing_mm : kUsualEdge;
  out.decisions.push_back({"partition", "grid",
                           fmt::format("cells of {:.4g} mm{}; memory follows the occupied ones", cell_mm,
                                       spacing_mm > 0.0 ? fmt::format(", {:.3g} spacings", edge) : "")});
  const double in_cell = std::max(1.0, edge * edge / kAskew);
  out.bytes +=
      static_cast<std::uint64_t>((sizeof(surface::OrientedPoint) + kSlotBytes * kSlotsPerCell / in_cell) *
                                 static_cast<double>(cloud.size()));
}

void report_normals(const cloud::Cloud& cloud, const std::string& neighbours, render::ModelDecisions& out) {
  points::PointModelOptions options;
  options.neighbours = neighbours;
  out.decisions.push_back({"normals", "planes of eight neighbours",
                           "found as cloud finds them, by " + points::neighbours_for(cloud, options)});
}

Result<OrientedGrid> build_oriented_grid(const render::ModelInput& input, double cell_mm,
                                         const std::string& neighbours, bool keep_neighbours,
                                         const render::PrepareContext& context,
                                         render::PrepareReport& report) {
  points::PointModelOptions options;
  options.neighbours = neighbours;
  options.resolution_mm = cell_mm;
  options.cell_per_resolution = 1.0;
  // The rival reports what it keeps itself.
  const std::size_t bytes = report.bytes;
  PALPATE_ASSIGN(points::PointModel built, points::build_point_model(*input.cloud, options, context, report));
  report.bytes = bytes;
  OrientedGrid made;
  made.points.points = std::move(built.points);
  made.points.grid = std::move(built.grid);
  made.closed = built.closed_components > 0;
  if (keep_neighbours) made.neighbours = std::move(built.neighbours);
  return made;
}

namespace {

constexpr std::size_t kNodesPerChunk = 256;

int levels_for(std::size_t points) noexcept {
  int levels = 0;
  while (levels < kMaxSphereLevels && (points >> levels) > kPointsPerSphere) ++levels;
  return levels;
}

}  // namespace

std::size_t SphereTree::bytes_for(std::size_t points) noexcept {
  return ((std::size_t{2} << levels_for(points)) - 1) * sizeof(Sphere);
}

void SphereTree::build(std::span<const surface::OrientedPoint> points, int threads) {
  points_ = points;
  levels_ = levels_for(points.size());
  spheres_.resize((std::size_t{2} << levels_) - 1);
  for (int level = 0; level <= levels_; ++level) {
    parallel_each(std::size_t{1} << level, kNodesPerChunk, threads, [&](std::size_t number) {
      const Node node{level, static_cast<std::uint32_t>(number)};
      geometry::Aabb box;
      for (std::uint32_t place = begin(node); place < end(node); ++place) box.add(points[place].at());
      const Vec3f middle = box.centre_mm().cast<float>();
      Sphere sphere{middle.x(), middle.y(), middle.z(), 0.0f};
      double most_sq = 0.0;
      for (std::uint32_t place = begin(node); place < end(node); ++place)
        most_sq = std::max(most_sq, (points[place].at() - sphere.at()).squaredNorm());
      sphere.radius =
          std::nextafter(static_cast<float>(std::sqrt(most_sq)), std::numeric_limits<float>::infinity());
      spheres_[index(node)] = sphere;
    });
  }
}

std::uint32_t SphereTree::nearest(const Vec3& at, double most_mm) const noexcept {
  if (points_.empty()) return kNoPlace;
  // A sphere holds nothing nearer than best if its centre is further than radius + best; in squares.
  struct Waiting {
    Node node;
    double centre_sq, radius;
  };
  const auto seen = [&](const Node& node) {
    const Sphere& sphere = spheres_[index(node)];
    return Waiting{node, (sphere.at() - at).squaredNorm(), static_cast<double>(sphere.radius)};
  };
  std::array<Waiting, kMaxSphereLevels + 1> stack;
  std::size_t waiting = 0;
  std::uint32_t best = kNoPlace;
  double best_mm = most_mm, best_sq = most_mm * most_mm;
  stack[waiting++] = seen({0, 0});
  while (waiting > 0) {
    const Waiting next = stack[--waiting];
    const double reach = next.radius + best_mm;
    if (next.centre_sq > reach * reach) continue;
    if (next.node.level < levels_) {
      Waiting near = seen({next.node.level + 1, 2 * next.node.number});
      Waiting far = seen({next.node.level + 1, 2 * next.node.number + 1});
      if (far.centre_sq < near.centre_sq) std::swap(near, far);
      stack[waiting++] = far;
      stack[waiting++] = near;
      continue;
    }
    for (std::uint32_t place = begin(next.node); place < end(next.node); ++place) {
      const double sq = (points_[place].at() - at).squaredNorm();
      if (sq > best_sq || (sq == best_sq && place > best)) continue;
      best_sq = sq;
      best_mm = std::sqrt(sq) * (1.0 + gamma(4));  // never below the root
      best = place;
    }
  }
  return best;
}

}  // namespace palpate::baselines
