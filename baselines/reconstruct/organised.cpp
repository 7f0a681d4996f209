// PCL's organised mesh of points that stand in a scanner's raster.
#include "baselines/reconstruct/method_functions.h"

#include <pcl/point_types.h>
#include <pcl/surface/organized_fast_mesh.h>
#include <pcl/surface/impl/organized_fast_mesh.hpp>

namespace palpate::baselines {
namespace {

/// Row by row as PCL wants them; where the raster wraps around, its first column (row) once more at the end.
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

/// PCL looks at lengths only together with the direction of sight, which is not known.
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
  mesher.storeShadowedFaces(true);  // the direction of sight is not known
  std::vector<pcl::Vertices> polygons;
  mesher.reconstruct(polygons);
  geometry::TriangleMesh mesh = points_as_vertices(input.cloud);
  const auto longest = static_cast<float>(input.options.number("organised_longest"));
  for (const pcl::Vertices& polygon : polygons) {
    if (longest > 0.0F && has_longer_edge(*raster.points, polygon, longest)) continue;
    const auto at = [&](std::size_t i) {
      return raster.index[static_cast<std::size_t>(polygon.vertices[i])];
    };
    mesh.triangles.push_back({at(0), at(1), at(2)});
  }
  phases.end();
  return mesh;
}

}  // namespace palpate::baselines
