// Ball pivoting by Open3D, only in builds with PALPATE_WITH_OPEN3D.
#include "baselines/reconstruct/method_functions.h"

#include <open3d/geometry/PointCloud.h>
#include <open3d/geometry/TriangleMesh.h>

namespace palpate::baselines {

Result<geometry::TriangleMesh> ball_pivoting(const MethodInput& input, render::PreparePhases& phases) {
  const OrientedPoints given = oriented_points(input, input.spacing, phases);
  open3d::geometry::PointCloud points;
  points.points_ = given.place;
  points.normals_ = given.normal;
  std::vector<double> radii = {input.options.number("ball_radius")};
  while (radii.size() < static_cast<std::size_t>(input.options.integer("ball_sizes")))
    radii.push_back(2.0 * radii.back());
  phases.begin("ball pivoting");
  const auto found = open3d::geometry::TriangleMesh::CreateFromPointCloudBallPivoting(points, radii);
  geometry::TriangleMesh mesh = points_as_vertices(input.cloud);
  for (const Eigen::Vector3i& triangle : found->triangles_) {
    const auto at = [&](int i) { return given.index[static_cast<std::size_t>(triangle[i])]; };
    mesh.triangles.push_back({at(0), at(1), at(2)});
  }
  phases.end();
  return mesh;
}

}  // namespace palpate::baselines
