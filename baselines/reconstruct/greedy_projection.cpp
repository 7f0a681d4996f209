// PCL's greedy projection triangulation.
#include "baselines/reconstruct/oriented_normals.h"

#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/surface/gp3.h>

namespace palpate::baselines {
namespace {

// PCL's tutorial: at most so many neighbours looked at, angles at which a triangle is given up, in degrees.
constexpr int kNeighbours = 100;
constexpr double kSurfaceAngle = 45.0, kSmallestAngle = 10.0, kLargestAngle = 120.0;
constexpr double kRadians = 3.14159265358979323846 / 180.0;

}  // namespace

Result<geometry::TriangleMesh> greedy_projection(const MethodInput& input, render::PreparePhases& phases) {
  const OrientedPoints given = oriented_points(input, input.spacing, phases);
  const pcl::PointCloud<pcl::PointNormal>::Ptr points(new pcl::PointCloud<pcl::PointNormal>);
  points->reserve(given.place.size());
  for (std::size_t i = 0; i < given.place.size(); ++i) {
    const Vec3f p = given.place[i].cast<float>(), n = given.normal[i].cast<float>();
    points->emplace_back(p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
  }
  phases.begin("greedy projection");
  pcl::GreedyProjectionTriangulation<pcl::PointNormal> greedy;
  greedy.setSearchRadius(input.options.number("greedy_radius"));
  greedy.setMu(input.options.number("greedy_mu"));
  greedy.setMaximumNearestNeighbors(kNeighbours);
  greedy.setMaximumSurfaceAngle(kSurfaceAngle * kRadians);
  greedy.setMinimumAngle(kSmallestAngle * kRadians);
  greedy.setMaximumAngle(kLargestAngle * kRadians);
  greedy.setNormalConsistency(true);
  greedy.setConsistentVertexOrdering(true);
  greedy.setInputCloud(points);
  greedy.setSearchMethod(
      pcl::search::KdTree<pcl::PointNormal>::Ptr(new pcl::search::KdTree<pcl::PointNormal>));
  std::vector<pcl::Vertices> polygons;
  greedy.reconstruct(polygons);
  geometry::TriangleMesh mesh = points_as_vertices(input.cloud);
  for (const pcl::Vertices& polygon : polygons) {
    const auto at = [&](std::size_t i) { return given.index[static_cast<std::size_t>(polygon.vertices[i])]; };
    mesh.triangles.push_back({at(0), at(1), at(2)});
  }
  phases.end();
  return mesh;
}

}  // namespace palpate::baselines
