// The methods of PCL: greedy projection, the organised mesh of a scanner's raster, screened Poisson on an
// octree (the authors' program), and marching cubes on Hoppe's distance, limited to grid corners near a point
// (PCL's own class visits all, with equal results near points).

#include <fmt/format.h>
#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/surface/gp3.h>
#include <pcl/surface/marching_cubes.h>
#include <pcl/surface/organized_fast_mesh.h>
#include <pcl/surface/poisson.h>
#include <pcl/surface/impl/marching_cubes.hpp>
#include <pcl/surface/impl/organized_fast_mesh.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_map>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include "baselines/reconstruct/method_functions.h"
#include "toolkit/core/parallel.h"

namespace palpate::baselines {
namespace {

using Point = pcl::PointNormal;
using Points = pcl::PointCloud<Point>;

Points::Ptr pcl_points(const OrientedPoints& given) {
  Points::Ptr points(new Points);
  points->reserve(given.place.size());
  for (std::size_t i = 0; i < given.place.size(); ++i) {
    const Vec3f p = given.place[i].cast<float>(), n = given.normal[i].cast<float>();
    points->emplace_back(p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
  }
  return points;
}

/// The polygon's corners, by their index in the cloud.
std::array<std::uint32_t, 3> triangle_of(const pcl::Vertices& polygon,
                                         const std::vector<std::uint32_t>& index) {
  const auto at = [&](std::size_t i) { return index[static_cast<std::size_t>(polygon.vertices[i])]; };
  return {at(0), at(1), at(2)};
}

// From PCL's tutorial: most neighbours, and the angles in degrees beyond which a triangle is given up.
constexpr int kNeighbours = 100;
constexpr double kSurfaceAngle = 45.0, kSmallestAngle = 10.0, kLargestAngle = 120.0;
constexpr double kRadians = 3.14159265358979323846 / 180.0;

}  // namespace

Result<geometry::TriangleMesh> greedy_projection(const MethodInput& input, render::PreparePhases& phases) {
  const OrientedPoints given = oriented_points(input, input.spacing, phases);
  const Points::Ptr points = pcl_points(given);
  phases.begin("greedy projection");
  pcl::GreedyProjectionTriangulation<Point> greedy;
  greedy.setSearchRadius(input.options.number("greedy_radius"));
  greedy.setMu(input.options.number("greedy_mu"));
  greedy.setMaximumNearestNeighbors(kNeighbours);
  greedy.setMaximumSurfaceAngle(kSurfaceAngle * kRadians);
  greedy.setMinimumAngle(kSmallestAngle * kRadians);
  greedy.setMaximumAngle(kLargestAngle * kRadians);
  greedy.setNormalConsistency(true);
  greedy.setConsistentVertexOrdering(true);
  greedy.setInputCloud(points);
  greedy.setSearchMethod(pcl::search::KdTree<Point>::Ptr(new pcl::search::KdTree<Point>));
  std::vector<pcl::Vertices> polygons;
  greedy.reconstruct(polygons);
  geometry::TriangleMesh mesh = points_as_vertices(input.cloud);
  for (const pcl::Vertices& polygon : polygons) mesh.triangles.push_back(triangle_of(polygon, given.index));
  phases.end();
  return mesh;
}

namespace {

/// Row by row, as PCL needs; a wrapping raster repeats its first column (row) at the end.
struct Raster {
  pcl::PointCloud<pcl::PointXYZ>::Ptr points{new pcl::PointCloud<pcl::PointXYZ>};
  std::vector<std::uint32_t> index;  ///< in the cloud

  Raster(const cloud::Cloud& cloud, const cloud::ScanRaster& raster, double unit_mm) {
    const std::size_t rows = raster.rows + (raster.rows_wrap ? 1u : 0u);
    const std::size_t columns = raster.columns + (raster.columns_wrap ? 1u : 0u);
    for (std::size_t row = 0; row < rows; ++row)
      for (std::size_t column = 0; column < columns; ++column) {
        const std::size_t i = raster.index(row % raster.rows, column % raster.columns);
        const Vec3f p = (cloud.local_mm(i) / unit_mm).cast<float>();
        points->emplace_back(p.x(), p.y(), p.z());
        index.push_back(static_cast<std::uint32_t>(i));
      }
    points->width = static_cast<std::uint32_t>(columns);
    points->height = static_cast<std::uint32_t>(rows);
  }
};

/// PCL checks lengths only together with the view direction, which is unknown.
bool has_longer_edge(const pcl::PointCloud<pcl::PointXYZ>& points, const pcl::Vertices& polygon,
                     float longest) {
  for (std::size_t k = 0; k < 3; ++k) {
    const auto one = static_cast<std::size_t>(polygon.vertices[k]);
    const auto other = static_cast<std::size_t>(polygon.vertices[(k + 1) % 3]);
    if ((points[one].getVector3fMap() - points[other].getVector3fMap()).norm() > longest) return true;
  }
  return false;
}

}  // namespace

Result<geometry::TriangleMesh> organised(const MethodInput& input, render::PreparePhases& phases) {
  using Mesher = pcl::OrganizedFastMesh<pcl::PointXYZ>;
  phases.begin("organised mesh");
  const Raster raster(input.cloud, *input.cloud.raster, input.spacing);
  Mesher mesher;
  mesher.setInputCloud(raster.points);
  mesher.setTriangulationType(Mesher::TRIANGLE_ADAPTIVE_CUT);
  mesher.storeShadowedFaces(true);  // the view direction is unknown
  std::vector<pcl::Vertices> polygons;
  mesher.reconstruct(polygons);
  geometry::TriangleMesh mesh = points_as_vertices(input.cloud);
  const auto longest = static_cast<float>(input.options.number("organised_longest"));
  for (const pcl::Vertices& polygon : polygons) {
    if (longest > 0.0F && has_longer_edge(*raster.points, polygon, longest)) continue;
    mesh.triangles.push_back(triangle_of(polygon, raster.index));
  }
  phases.end();
  return mesh;
}

namespace {

/// Size of the octree's cube in extents of the points: the authors' default.
constexpr float kScale = 1.1F;
/// Full detail: one point per node; the authors use 1 to 5 for clean points, more for noisy ones.
constexpr float kPointsPerNode = 1.0F;
/// Nodes are numbered by depth in a few bits; a hundred million points need fewer than 4096 cells a side.
constexpr int kShallowest = 4, kDeepest = 12;

int depth_for(const OrientedPoints& given, double cell) {
  geometry::Aabb box;
  for (const Vec3& p : given.place) box.add(p);
  const double cells = static_cast<double>(kScale) * box.extent_mm().maxCoeff() / cell;
  return std::clamp(static_cast<int>(std::ceil(std::log2(std::max(cells, 1.0)))), kShallowest, kDeepest);
}

}  // namespace

Result<geometry::TriangleMesh> poisson_octree(const MethodInput& input, render::PreparePhases& phases) {
  const OrientedPoints given = oriented_points(input, input.spacing, phases);
  const Points::Ptr points = pcl_points(given);
  geometry::TriangleMesh mesh;
  if (points->empty()) return mesh;
  phases.begin("Poisson function and its level set");
  const int depth = depth_for(given, input.options.number("poisson_cell"));
  pcl::Poisson<Point> poisson;
  poisson.setDepth(depth);
  poisson.setScale(kScale);
  poisson.setSamplesPerNode(kPointsPerNode);
  poisson.setThreads(1);  // with more, sums and mesh vary from run to run
  poisson.setInputCloud(points);
  Points corners;
  std::vector<pcl::Vertices> polygons;
  poisson.performReconstruction(corners, polygons);
  phases.end();
  phases.begin("trimming");
  const double trim = input.options.number("poisson_trim");
  pcl::KdTreeFLANN<Point> tree;
  tree.setInputCloud(points);
  std::vector<bool> near(corners.size(), true);
  pcl::Indices nearest(1);
  std::vector<float> distance_sq(1);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    mesh.vertices_mm.push_back(input.cloud.origin_mm +
                               corners[i].getVector3fMap().cast<double>() * given.unit_mm);
    if (trim == 0.0) continue;
    tree.nearestKSearch(corners[i], 1, nearest, distance_sq);
    near[i] = static_cast<double>(distance_sq[0]) <= trim * trim;
  }
  for (const pcl::Vertices& polygon : polygons) {
    const auto at = [&](std::size_t i) { return static_cast<std::uint32_t>(polygon.vertices[i]); };
    if (near[at(0)] && near[at(1)] && near[at(2)]) mesh.triangles.push_back({at(0), at(1), at(2)});
  }
  phases.end();
  phases.note(fmt::format("poisson: an octree of depth {}; {} of {} facets far from every point left out",
                          depth, polygons.size() - mesh.triangles.size(), polygons.size()));
  return mesh;
}

namespace {

using Index = Eigen::Matrix<std::int64_t, 3, 1>;

/// Lengths are in cubes and grid corners are integers, so two cubes compute a shared corner alike.
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

  /// Hoppe et al. 1992, section 4.1: distance to the tangent plane of the nearest point.
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

  /// Distances are finite.
  static constexpr float kMarked = std::numeric_limits<float>::infinity();
  Index low_;
  double reach_;
  int threads_;
};

/// Merges PCL's corners per triangle: those on the same grid edge, or at the same grid corner, are one, since
/// at most one crosses an edge.
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
  const Points::Ptr points = pcl_points(given);
  geometry::Aabb box;
  for (const Vec3& place : given.place) box.add(place);
  geometry::TriangleMesh mesh;
  if (points->empty()) return mesh;
  // PCL skips the outermost cubes: adds two on each side beyond the surface's reach.
  const double margin = std::ceil(reach) + 2.0;
  const Index first = (box.low_mm.array() - margin).floor().cast<std::int64_t>().matrix();
  const Index size = (box.high_mm.array() + margin).ceil().cast<std::int64_t>().matrix() - first;
  const double corners = size.cast<double>().prod();
  if (corners > std::numeric_limits<int>::max())
    return Error{fmt::format("the grid would have {:.3g} corners, more than PCL can count", corners),
                 "make cubes_cell larger"};
  phases.begin("marching cubes");
  NearPoints cubes(first, size, reach, input.threads);
  cubes.setInputCloud(points);
  Points soup;
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
