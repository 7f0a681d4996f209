#include "baselines/reconstruct/advancing_front.h"

#include <fmt/format.h>

#include <exception>
#include <iterator>

#include "baselines/reconstruct/fixed_order.h"
#include "toolkit/core/clock.h"

#include <CGAL/Advancing_front_surface_reconstruction.h>
#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_data_structure_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

namespace palpate::baselines {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Vertex = CGAL::Triangulation_vertex_base_with_info_3<
    std::uint32_t, Kernel, CGAL::Advancing_front_surface_reconstruction_vertex_base_3<Kernel>>;
using Cell = CGAL::Advancing_front_surface_reconstruction_cell_base_3<Kernel>;
using Structure = CGAL::Triangulation_data_structure_3<Vertex, Cell>;
using Triangulation = CGAL::Delaunay_triangulation_3<Kernel, Structure>;
using Reconstruction = CGAL::Advancing_front_surface_reconstruction<Triangulation>;

Error stopped() {
  return Error{"reconstruction was stopped", "", {}, 0};
}

Result<geometry::TriangleMesh> reconstruct(const cloud::Cloud& cloud, Progress& progress,
                                           ReconstructionReport& report) {
  geometry::TriangleMesh mesh;
  mesh.vertices_mm.reserve(cloud.size());
  std::vector<std::pair<Kernel::Point_3, std::uint32_t>> points;
  points.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    mesh.vertices_mm.push_back(cloud.point_mm(i));
    const Vec3 p = cloud.local_mm(i);  // relative: as exact as stored
    points.emplace_back(Kernel::Point_3(p.x(), p.y(), p.z()), static_cast<std::uint32_t>(i));
  }
  progress.report("Delaunay triangulation", -1.0);
  Stopwatch watch;
  Triangulation triangulation(points.begin(), points.end());
  report.triangulation_ms = watch.ms();
  report.duplicates = cloud.size() - triangulation.number_of_vertices();
  if (triangulation.dimension() < 2)
    return Error{fmt::format("{} different points on a line or fewer than three span no surface",
                             triangulation.number_of_vertices()),
                 "use a cloud of a surface",
                 {},
                 0};
  if (progress.cancelled()) return stopped();
  progress.report("advancing front", -1.0);
  watch.restart();
  Reconstruction front(triangulation);
  front.run();
  const auto& surface = front.triangulation_data_structure_2();
  for (auto face = surface.faces_begin(); face != surface.faces_end(); ++face) {
    if (!face->is_on_surface()) continue;
    mesh.triangles.push_back({face->vertex(0)->vertex_3()->info(), face->vertex(1)->vertex_3()->info(),
                              face->vertex(2)->vertex_3()->info()});
  }
  // CGAL's order and orientation follow where its faces lie in memory.
  fix_order(mesh);
  report.front_ms = watch.ms();
  if (mesh.triangles.empty())
    return Error{
        "the advancing front found no triangle", "use a cloud sampled densely from a surface", {}, 0};
  return mesh;
}

}  // namespace

Result<geometry::TriangleMesh> advancing_front(const cloud::Cloud& cloud, Progress& progress,
                                               ReconstructionReport* report) {
  ReconstructionReport own;
  if (progress.cancelled()) return stopped();
  try {
    return reconstruct(cloud, progress, report != nullptr ? *report : own);
  } catch (const std::bad_alloc&) {
    return Error{fmt::format("not enough memory to reconstruct a surface from {} points", cloud.size()),
                 "use fewer points or a machine with more memory",
                 {},
                 0};
  } catch (const std::exception& failure) {
    return Error{
        fmt::format("CGAL could not reconstruct a surface: {}", failure.what()), "check the cloud", {}, 0};
  }
}

}  // namespace palpate::baselines
