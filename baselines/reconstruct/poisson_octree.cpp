// Screened Poisson reconstruction on an octree: the authors' own program as PCL carries it.
#include "baselines/reconstruct/poisson_octree.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "baselines/reconstruct/oriented_normals.h"

#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_types.h>
#include <pcl/surface/poisson.h>

namespace palpate::baselines {
namespace {

/// The cube of the octree, in extents of the points: the authors' default.
constexpr float kScale = 1.1F;
/// A point a node: as much detail as the points have, where noise would ask for more of them (the authors' 1
/// to 5 for clean points).
constexpr float kPointsPerNode = 1.0F;
/// Nodes are numbered by depth in a few bits; 4096 cells a side are more than a hundred million points have.
constexpr int kShallowest = 4, kDeepest = 12;

using Points = pcl::PointCloud<pcl::PointNormal>;

int depth_for(const OrientedPoints& given, double cell) {
  geometry::Aabb box;
  for (const Vec3& p : given.place) box.add(p);
  const double cells = static_cast<double>(kScale) * box.extent_mm().maxCoeff() / cell;
  return std::clamp(static_cast<int>(std::ceil(std::log2(std::max(cells, 1.0)))), kShallowest, kDeepest);
}

}  // namespace

Result<geometry::TriangleMesh> poisson_octree(const MethodInput& input, render::PreparePhases& phases) {
  const OrientedPoints given = oriented_points(input, input.spacing, phases);
  const Points::Ptr points(new Points);
  points->reserve(given.place.size());
  for (std::size_t i = 0; i < given.place.size(); ++i) {
    const Vec3f p = given.place[i].cast<float>(), n = given.normal[i].cast<float>();
    points->emplace_back(p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
  }
  geometry::TriangleMesh mesh;
  if (points->empty()) return mesh;
  phases.begin("Poisson function and its level set");
  const int depth = depth_for(given, input.options.number("poisson_cell"));
  pcl::Poisson<pcl::PointNormal> poisson;
  poisson.setDepth(depth);
  poisson.setScale(kScale);
  poisson.setSamplesPerNode(kPointsPerNode);
  poisson.setThreads(1);  // with more its sums, and so its mesh, differ from run to run
  poisson.setInputCloud(points);
  Points corners;
  std::vector<pcl::Vertices> polygons;
  poisson.performReconstruction(corners, polygons);
  phases.end();
  phases.begin("trimming");
  const double trim = input.options.number("poisson_trim");
  pcl::KdTreeFLANN<pcl::PointNormal> tree;
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

}  // namespace palpate::baselines
