#include "baselines/points/point_grid.h"

#include <utility>

#include "toolkit/cloud/statistics.h"
#include "toolkit/neighbourhood/knn.h"

namespace palpate::baselines {
double natural_spacing_mm(const cloud::Cloud& cloud, int threads) {
  const geometry::Aabb box = partition::local_box(cloud, threads);
  if (box.extent_mm().maxCoeff() > 0.0) {
    const double spacing = neighbourhood::mean_spacing_mm(cloud);
    if (spacing > 0.0) return spacing;
  }
  return cloud::stand_in_spacing_mm(cloud);
}

PointGrid build_point_grid(const cloud::Cloud& cloud, double cell_mm, int threads) {
  partition::PartitionOptions options;
  options.cell_mm = cell_mm;
  PointGrid made = build_points_in<partition::UniformGrid>(cloud, options, threads);
  made.grid.drop_order();
  return made;
}

Result<OrientedGrid> build_oriented_grid(const render::ModelInput& input, double cell_mm,
                                         bool keep_neighbours, const render::PrepareContext& context,
                                         render::PrepareReport& report) {
  render::PointModelOptions options;
  options.resolution_mm = cell_mm;
  options.cell_per_resolution = 1.0;
  // The rival reports what it keeps itself.
  const std::size_t bytes = report.bytes;
  Result<render::PointModel> built = render::build_point_model(*input.cloud, options, context, report);
  if (!built) return std::move(built).error();
  report.bytes = bytes;
  OrientedGrid made;
  made.points.points = std::move(built->points);
  made.points.grid = std::move(built->grid);
  made.closed = built->closed_pieces > 0;
  if (keep_neighbours) made.neighbours = std::move(built->neighbours);
  return made;
}

}  // namespace palpate::baselines
