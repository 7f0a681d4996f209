// Marching cubes on Hoppe's distance, by PCL. PCL's own class looks for the nearest point from every corner
// of the grid; here only from those within reach of a point, with the same answer there.
#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <unordered_map>

#include "baselines/reconstruct/oriented_normals.h"
#include "toolkit/core/parallel.h"

#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_types.h>
#include <pcl/surface/marching_cubes.h>
#include <pcl/surface/impl/marching_cubes.hpp>

namespace palpate::baselines {
namespace {

using Point = pcl::PointNormal;
using Index = Eigen::Matrix<std::int64_t, 3, 1>;

/// Lengths are in cubes and the grid's corners are whole numbers, so that two cubes compute their common
/// corners alike.
class NearPoints final : public pcl::MarchingCubes<Point> {
 public:
  NearPoints(const Index& low, const Index& size, double reach, int threads)
      : low_(low), reach_(reach), threads_(threads) {
    setGridResolution(static_cast<int>(size.x()), static_cast<int>(size.y()), static_cast<int>(size.z()));
  }

 private:
  void voxelizeData() override {
    lower_boundary_ = low_.cast<float>().array();
    size_voxel_ = Eigen::Array3f::Ones();
    upper_boundary_ = lower_boundary_ + Eigen::Array3f(static_cast<float>(res_x_), static_cast<float>(res_y_),
                                                       static_cast<float>(res_z_));
    mark();
    pcl::KdTreeFLANN<Point> tree;
    tree.setInputCloud(input_);
    const auto plane = static_cast<std::size_t>(res_y_) * static_cast<std::size_t>(res_z_);
    constexpr std::size_t kPlanes = 1;
    parallel_chunks(static_cast<std::size_t>(res_x_), kPlanes, threads_,
                    [&](std::size_t begin, std::size_t end) {
                      for (std::size_t i = begin * plane; i < end * plane; ++i)
                        if (grid_[i] == kMarked) grid_[i] = distance(tree, i);
                    });
  }

  /// Marks every corner within reach of a point along each axis.
  void mark() {
    const auto r = static_cast<std::int64_t>(std::ceil(reach_));
    const Index size(res_x_, res_y_, res_z_);
    for (const Point& p : *input_) {
      const Index at = p.getVector3fMap().array().floor().cast<std::int64_t>().matrix() - low_;
      const Index from = (at.array() - r + 1).max(0).matrix();
      const Index to = (at.array() + r).min(size.array() - 1).matrix();
      for (std::int64_t x = from.x(); x <= to.x(); ++x)
        for (std::int64_t y = from.y(); y <= to.y(); ++y) {
          const auto row = static_cast<std::size_t>((x * size.y() + y) * size.z());
          std::fill(grid_.begin() + static_cast<std::ptrdiff_t>(row) + from.z(),
                    grid_.begin() + static_cast<std::ptrdiff_t>(row) + to.z() + 1, kMarked);
        }
    }
  }

  /// Hoppe et al. 1992, section 4.1: from the tangent plane of the nearest point.
  float distance(const pcl::KdTreeFLANN<Point>& tree, std::size_t i) const {
    const auto nz = static_cast<std::size_t>(res_z_), ny = static_cast<std::size_t>(res_y_);
    Point corner;
    corner.getVector3fMap() = lower_boundary_.matrix() + Eigen::Vector3f(static_cast<float>(i / (ny * nz)),
                                                                         static_cast<float>(i / nz % ny),
                                                                         static_cast<float>(i % nz));
    pcl::Indices nearest(1);
    std::vector<float> distance_sq(1);
    tree.nearestKSearch(corner, 1, nearest, distance_sq);
    if (distance_sq[0] > static_cast<float>(reach_ * reach_)) return std::numeric_limits<float>::quiet_NaN();
    const Point& p = (*input_)[static_cast<std::size_t>(nearest[0])];
    return p.getNormalVector3fMap().dot(corner.getVector3fMap() - p.getVector3fMap());
  }

  /// No distance is infinite.
  static constexpr float kMarked = std::numeric_limits<float>::infinity();
  Index low_;
  double reach_;
  int threads_;
};

/// PCL gives every triangle corners of its own. Two corners are one where they lie on the same edge of the
/// grid, or at the same of its corners: at most one crossing an edge.
class Weld {
 public:
  std::uint32_t operator()(const Eigen::Vector3f& p, const MethodInput& input, double unit_mm,
                           geometry::TriangleMesh& mesh) {
    std::array<std::int64_t, 4> key{};
    for (int axis = 0; axis < 3; ++axis) {
      const float whole = std::floor(p[axis]);
      key[static_cast<std::size_t>(axis)] = static_cast<std::int64_t>(whole);
      if (whole != p[axis]) key[3] |= 1 << axis;
    }
    const auto [at, fresh] = vertices_.try_emplace(key, static_cast<std::uint32_t>(mesh.vertices_mm.size()));
    if (fresh) mesh.vertices_mm.push_back(input.cloud.origin_mm + p.cast<double>() * unit_mm);
    return at->second;
  }

 private:
  struct HashKey {
    std::size_t operator()(const std::array<std::int64_t, 4>& key) const noexcept {
      // Large odd factors spread neighbouring cells (Teschner et al. 2003).
      constexpr std::array<std::uint64_t, 4> kFactors = {73856093u, 19349663u, 83492791u, 2654435761u};
      std::uint64_t sum = 0;
      for (std::size_t i = 0; i < key.size(); ++i) sum ^= static_cast<std::uint64_t>(key[i]) * kFactors[i];
      return sum;
    }
  };
  std::unordered_map<std::array<std::int64_t, 4>, std::uint32_t, HashKey> vertices_;
};

}  // namespace

Result<geometry::TriangleMesh> marching_cubes(const MethodInput& input, render::PreparePhases& phases) {
  const double cell = input.options.number("cubes_cell");
  const double reach = std::max(1.0, input.options.number("cubes_reach") / cell);
  const OrientedPoints given = oriented_points(input, cell * input.spacing, phases);
  const pcl::PointCloud<Point>::Ptr points(new pcl::PointCloud<Point>);
  points->reserve(given.place.size());
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (std::size_t i = 0; i < given.place.size(); ++i) {
    const Vec3f p = given.place[i].cast<float>(), n = given.normal[i].cast<float>();
    points->emplace_back(p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
    low = low.cwiseMin(given.place[i]);
    high = high.cwiseMax(given.place[i]);
  }
  geometry::TriangleMesh mesh;
  if (points->empty()) return mesh;
  // PCL leaves out the outermost cubes: two more on either side than the surface can reach.
  const double margin = std::ceil(reach) + 2.0;
  const Index first = (low.array() - margin).floor().cast<std::int64_t>().matrix();
  const Index size = (high.array() + margin).ceil().cast<std::int64_t>().matrix() - first;
  const double corners = size.cast<double>().prod();
  if (corners > std::numeric_limits<int>::max())
    return Error{fmt::format("the grid would have {:.3g} corners, more than PCL can count", corners),
                 "make cubes_cell larger",
                 {},
                 0};
  phases.begin("marching cubes");
  NearPoints cubes(first, size, reach, input.threads);
  cubes.setInputCloud(points);
  pcl::PointCloud<Point> soup;
  std::vector<pcl::Vertices> polygons;
  cubes.reconstruct(soup, polygons);
  phases.end();
  phases.begin("joining corners");
  Weld weld;
  for (const pcl::Vertices& polygon : polygons) {
    const auto at = [&](std::size_t i) {
      return weld(soup[static_cast<std::size_t>(polygon.vertices[i])].getVector3fMap(), input, given.unit_mm,
                  mesh);
    };
    const std::array<std::uint32_t, 3> triangle = {at(0), at(1), at(2)};
    if (triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0])
      mesh.triangles.push_back(triangle);
  }
  phases.end();
  phases.note(fmt::format("marching cubes: a grid of {} x {} x {}", size.x(), size.y(), size.z()));
  return mesh;
}

}  // namespace palpate::baselines
