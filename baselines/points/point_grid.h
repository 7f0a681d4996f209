// Points in grid order, with a search, for rivals. All share it, so that none differs in speed by its
// bookkeeping; normals have an outward side.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <string>

#include <palpate/cloud.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"
#include "toolkit/points/point_model.h"
#include "toolkit/search/point_search.h"
#include "toolkit/search/uniform_grid.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::baselines {

inline constexpr std::uint32_t kNoPlace = 0xFFFFFFFFu;

/// Points by place with their partition; 16 bytes a point besides the partition. Local to the cloud's origin,
/// mm. Immutable after building; thread-safe to read.
template <class Grid>
struct PointsIn {
  LargePageVector<surface::OrientedPoint> points;
  Grid grid;

  /// search::visit_within over these points.
  template <class Visit>
  void within(const Vec3& at, double radius_mm, Visit&& visit) const {
    const auto position = [this](std::uint32_t place) { return points[place].at(); };
    search::visit_within(grid, position, at, radius_mm, visit);
  }
  [[nodiscard]] double cell_mm() const noexcept { return grid.cell_mm(); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return points.capacity() * sizeof(surface::OrientedPoint) + grid.bytes();
  }
};
using PointGrid = PointsIn<search::UniformGrid>;

/// The unit of the rivals' radii: the cloud's mean spacing, or a substitute if all points coincide. O(n).
[[nodiscard]] double natural_spacing_mm(const cloud::Cloud& cloud, int threads);

/// Points without normals. O(n); independent of the number of threads.
template <class Grid>
[[nodiscard]] PointsIn<Grid> build_points_in(const cloud::Cloud& cloud,
                                             const search::PartitionOptions& options, int threads) {
  PointsIn<Grid> made;
  made.grid = Grid::build(cloud, options, threads);
  const auto order = made.grid.order();
  made.points.resize(cloud.size());
  parallel_each(cloud.size(), kPointsPerChunk, threads, [&](std::size_t place) {
    const std::uint32_t i = order[place];
    made.points[place] = {cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i], surface::kNoNormal};
  });
  return made;
}
[[nodiscard]] PointGrid build_point_grid(const cloud::Cloud& cloud, double cell_mm, int threads);

/// Reports the mean spacing, the unit of a rival's lengths.
void report_spacing(double spacing_mm, render::ModelDecisions& out);
/// Reports a grid and estimates build_point_grid()'s bytes: two to four slots an occupied cell. `spacing_mm`
/// 0: unknown.
void report_grid(const cloud::Cloud& cloud, double spacing_mm, double cell_mm, render::ModelDecisions& out);
/// Reports how build_oriented_grid() finds neighbours and normals. `neighbours`: one of
/// search::neighbour_builders(), or "auto".
void report_normals(const cloud::Cloud& cloud, const std::string& neighbours, render::ModelDecisions& out);

/// Points with consistently oriented normals of local planes, found as by the point renderers, with phases
/// and notes. `closed` is set if some points enclose a volume.
struct OrientedGrid {
  PointGrid points;
  bool closed = false;
  LargePageVector<search::Neighbours> neighbours;  ///< by place; empty unless requested
};
[[nodiscard]] Result<OrientedGrid> build_oriented_grid(const render::ModelInput& input, double cell_mm,
                                                       const std::string& neighbours, bool keep_neighbours,
                                                       const render::PrepareContext& context,
                                                       render::PrepareReport& report);

/// The sign (+1 or -1) of open pieces' normals for rivals without a path: outside is where most of them
/// point, along the axis of best agreement. O(n).
[[nodiscard]] inline double open_sign(std::span<const surface::OrientedPoint> points) noexcept {
  Vec3 sum = Vec3::Zero();
  for (const surface::OrientedPoint& point : points)
    if (point.normal != surface::kNoNormal && !surface::is_one_sided(point.normal))
      sum += surface::decode_normal(point.normal);
  Eigen::Index axis = 0;
  sum.cwiseAbs().maxCoeff(&axis);
  return sum[axis] < 0.0 ? -1.0 : 1.0;
}

/// The unit normal outwards, with the sign of open pieces; zero for a point without a plane.
[[nodiscard]] inline Vec3 outward_normal(surface::NormalCode code, double open_sign) noexcept {
  if (code == surface::kNoNormal) return Vec3::Zero();
  return surface::decode_normal(code) * (surface::is_one_sided(code) ? 1.0 : open_sign);
}

/// Belongs to one thread. Closed surfaces are touched from outside. Normals of open pieces agree with each
/// other but have no side: it is chosen when the HIP comes near and kept until it is free; pieces of a model
/// share it.
class OutwardSide {
 public:
  void release() noexcept { open_side_ = 0.0; }
  [[nodiscard]] bool chosen() const noexcept { return open_side_ != 0.0; }
  /// Sets the side of a HIP at `away` from the point (HIP - point), unless it is set.
  void choose(surface::NormalCode code, const Vec3& away) noexcept {
    if (open_side_ != 0.0 || code == surface::kNoNormal) return;
    open_side_ = surface::decode_normal(code).dot(away) < 0.0 ? -1.0 : 1.0;
  }
  /// +1 or -1, the factor that makes the stored normal outward.
  [[nodiscard]] double sign(surface::NormalCode code) const noexcept {
    return surface::is_one_sided(code) || open_side_ >= 0.0 ? 1.0 : -1.0;
  }
  /// Unit, or zero for a point without a plane.
  [[nodiscard]] Vec3 normal(surface::NormalCode code) const noexcept {
    return code == surface::kNoNormal ? Vec3(Vec3::Zero()) : Vec3(sign(code) * surface::decode_normal(code));
  }

 private:
  double open_side_ = 0.0;  ///< 0: not chosen
};

// A bounding sphere hierarchy over points: the swept-sphere volumes of the thesis's [52] for points.

/// Most points of a leaf.
inline constexpr std::uint32_t kPointsPerSphere = 8;
/// Most levels: halving 2^32 points.
inline constexpr int kMaxSphereLevels = 32;

/// Over points in an order of near neighbours (a grid's). Ranges halve per level, so nodes need no links:
/// node i of level d covers the places [n i / 2^d, n (i + 1) / 2^d). 16 bytes a node, some 4 a point. The
/// points' local coordinates, mm. Immutable; thread-safe to read.
class SphereTree {
 public:
  /// Keeps a view of `points`. O(n log n), parallel; independent of the number of threads.
  void build(std::span<const surface::OrientedPoint> points, int threads);

  /// The nearest place to `at` within `most_mm`, ties by place; else kNoPlace. Allocates nothing. O(log n)
  /// near the points.
  [[nodiscard]] std::uint32_t nearest(const Vec3& at, double most_mm) const noexcept;

  /// Calls visit(place, distance_sq) for every point within `radius_mm` of `at`, in place order.
  template <class Visit>
  void within(const Vec3& at, double radius_mm, Visit&& visit) const noexcept {
    if (points_.empty()) return;
    const double most_sq = radius_mm * radius_mm;
    std::array<Node, kMaxSphereLevels + 1> stack;  // one node waits on each level
    std::size_t waiting = 0;
    stack[waiting++] = {0, 0};
    while (waiting > 0) {
      const Node node = stack[--waiting];
      const Sphere& sphere = spheres_[index(node)];
      const double reach = radius_mm + static_cast<double>(sphere.radius);
      if ((sphere.at() - at).squaredNorm() > reach * reach) continue;
      if (node.level < levels_) {
        stack[waiting++] = {node.level + 1, 2 * node.number + 1};
        stack[waiting++] = {node.level + 1, 2 * node.number};
        continue;
      }
      for (std::uint32_t place = begin(node); place < end(node); ++place) {
        const double sq = (points_[place].at() - at).squaredNorm();
        if (sq <= most_sq) visit(place, sq);
      }
    }
  }
  [[nodiscard]] int levels() const noexcept { return levels_; }
  /// The value of bytes(), before building.
  [[nodiscard]] static std::size_t bytes_for(std::size_t points) noexcept;
  [[nodiscard]] std::size_t bytes() const noexcept { return spheres_.capacity() * sizeof(Sphere); }

 private:
  struct Sphere {
    float x, y, z, radius;  ///< the radius rounded up
    [[nodiscard]] Vec3 at() const noexcept {
      return {static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)};
    }
  };
  struct Node {
    int level = 0;
    std::uint32_t number = 0;
  };
  [[nodiscard]] static std::size_t index(const Node& node) noexcept {
    return (std::size_t{1} << node.level) - 1 + node.number;
  }
  [[nodiscard]] std::uint32_t begin(const Node& node) const noexcept {
    return static_cast<std::uint32_t>((points_.size() * std::uint64_t{node.number}) >> node.level);
  }
  [[nodiscard]] std::uint32_t end(const Node& node) const noexcept {
    return static_cast<std::uint32_t>((points_.size() * (std::uint64_t{node.number} + 1)) >> node.level);
  }

  std::span<const surface::OrientedPoint> points_;
  LargePageVector<Sphere> spheres_;
  int levels_ = 0;  ///< the leaves' level
};

}  // namespace palpate::baselines
