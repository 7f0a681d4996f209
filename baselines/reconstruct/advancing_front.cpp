#include "baselines/reconstruct/advancing_front.h"

#include <CGAL/Advancing_front_surface_reconstruction.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <fmt/format.h>

#include <array>
#include <exception>
#include <iterator>

namespace palpate::baselines {

Result<geometry::TriangleMesh> advancing_front(const cloud::Cloud& cloud, Progress& progress) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  progress.report("advancing front", -1.0);
  geometry::TriangleMesh mesh;
  std::vector<Kernel::Point_3> points;
  points.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    // Local coordinates: a far origin would cost the predicates' filters their precision.
    const Vec3 p = cloud.local_mm(i);
    points.emplace_back(p.x(), p.y(), p.z());
    mesh.vertices_mm.push_back(cloud.point_mm(i));
  }
  try {
    std::vector<std::array<std::size_t, 3>> faces;
    CGAL::advancing_front_surface_reconstruction(points.begin(), points.end(), std::back_inserter(faces));
    mesh.triangles.reserve(faces.size());
    for (const auto& f : faces)
      mesh.triangles.push_back({static_cast<std::uint32_t>(f[0]), static_cast<std::uint32_t>(f[1]),
                                static_cast<std::uint32_t>(f[2])});
  } catch (const std::exception& error) {
    return Error{fmt::format("the advancing front failed: {}", error.what()),
                 "clean the cloud, or use mesh=original",
                 {},
                 0};
  }
  if (mesh.triangles.empty())
    return Error{
        "the advancing front found no surface in the cloud", "use a cloud that covers a surface", {}, 0};
  return mesh;
}

}  // namespace palpate::baselines
