// What the point-based rivals read in a frame: points in the order of a grid, and the search around a place.
// Shared by all of them, so that none is faster or slower for its bookkeeping.
#pragma once

#include <cstdint>
#include <limits>
#include <string>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/large_pages.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/result.h"
#include "toolkit/partition/point_search.h"
#include "toolkit/partition/uniform_grid.h"
#include "toolkit/points/point_model.h"
#include "toolkit/render/renderer.h"
#include "toolkit/surface/planes.h"

namespace palpate::baselines {

inline constexpr std::uint32_t kNoPlace = 0xFFFFFFFFu;

/// Points by place with the partition that finds them; 16 bytes a point beside the partition. Everything
/// local to the cloud's origin, mm. Immutable after building; safe to read from many threads.
template <class Grid>
struct PointsIn {
  LargeVector<surface::SurfacePoint> points;
  Grid grid;

  /// partition::visit_within over these points.
  template <class Visit>
  void within(const Vec3& at, double radius_mm, Visit&& visit) const {
    const auto position = [this](std::uint32_t place) { return points[place].at(); };
    partition::visit_within(grid, position, at, radius_mm, visit);
  }
  [[nodiscard]] double cell_mm() const noexcept { return grid.cell_mm(); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return points.capacity() * sizeof(surface::SurfacePoint) + grid.bytes();
  }
};
using PointGrid = PointsIn<partition::UniformGrid>;

/// The length that the rivals' radii are given in: the cloud's mean spacing; a stand-in where all points
/// coincide. O(n).
[[nodiscard]] double natural_spacing_mm(const cloud::Cloud& cloud, int threads);

/// Points without normals. O(n); the same for any number of threads.
template <class Grid>
[[nodiscard]] PointsIn<Grid> build_points_in(const cloud::Cloud& cloud,
                                             const partition::PartitionOptions& options, int threads) {
  PointsIn<Grid> made;
  made.grid = Grid::build(cloud, options, threads);
  const auto order = made.grid.order();
  made.points.resize(cloud.size());
  parallel_chunks(cloud.size(), kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t place = begin; place < end; ++place) {
      const std::uint32_t i = order[place];
      made.points[place] = {cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i], surface::kNoNormal};
    }
  });
  return made;
}
[[nodiscard]] PointGrid build_point_grid(const cloud::Cloud& cloud, double cell_mm, int threads);

/// Says the mean spacing, in which a rival's lengths are given.
void say_spacing(double spacing_mm, render::ModelDecisions& out);
/// Says a grid, and expects the bytes of build_point_grid(): two to four slots an occupied cell. `spacing_mm`
/// 0: not measured.
void say_grid(const cloud::Cloud& cloud, double spacing_mm, double cell_mm, render::ModelDecisions& out);
/// Says how build_oriented_grid() finds neighbours and normals.
/// `neighbours`: one of neighbourhood::builders(), or "auto".
void say_normals(const cloud::Cloud& cloud, const std::string& neighbours, render::ModelDecisions& out);

/// Points with the normals of their local planes, on a side that the surface agrees on; found as the point
/// renderers find them, phases and notes included. `closed` is set where some points enclose a volume.
struct OrientedGrid {
  PointGrid points;
  bool closed = false;
  LargeVector<neighbourhood::Neighbours> neighbours;  ///< by place; empty unless asked for
};
[[nodiscard]] Result<OrientedGrid> build_oriented_grid(const render::ModelInput& input, double cell_mm,
                                                       const std::string& neighbours, bool keep_neighbours,
                                                       const render::PrepareContext& context,
                                                       render::PrepareReport& report);

}  // namespace palpate::baselines
