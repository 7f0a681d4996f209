// CGAL's advancing front.
#include <fmt/format.h>

#include "baselines/reconstruct/fixed_order.h"
#include "baselines/reconstruct/method_functions.h"

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

}  // namespace

Result<geometry::TriangleMesh> advancing_front(const MethodInput& input, render::PreparePhases& phases) {
  const cloud::Cloud& cloud = input.cloud;
  geometry::TriangleMesh mesh = points_as_vertices(cloud);
  phases.begin("Delaunay triangulation");
  std::vector<std::pair<Kernel::Point_3, std::uint32_t>> points;
  points.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.local_mm(i);  // relative: as exact as stored
    points.emplace_back(Kernel::Point_3(p.x(), p.y(), p.z()), static_cast<std::uint32_t>(i));
  }
  Triangulation triangulation(points.begin(), points.end());
  phases.end();
  if (const std::size_t repeated = cloud.size() - triangulation.number_of_vertices(); repeated > 0)
    phases.note(fmt::format("advancing front: {} repeated points", repeated));
  phases.begin("advancing front");
  Reconstruction front(triangulation);
  front.run(input.options.number("front_radius_ratio"), input.options.number("front_beta"));
  const auto& surface = front.triangulation_data_structure_2();
  for (auto face = surface.faces_begin(); face != surface.faces_end(); ++face) {
    if (!face->is_on_surface()) continue;
    mesh.triangles.push_back({face->vertex(0)->vertex_3()->info(), face->vertex(1)->vertex_3()->info(),
                              face->vertex(2)->vertex_3()->info()});
  }
  phases.end();
  // CGAL's order and orientation follow where its faces lie in memory.
  phases.begin("one order");
  fix_order(mesh, input.threads);
  phases.end();
  return mesh;
}

}  // namespace palpate::baselines
