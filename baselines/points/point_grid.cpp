#include "baselines/points/point_grid.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include <palpate/result.h>
#include "toolkit/cloud/statistics.h"
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

}  // namespace palpate::baselines
