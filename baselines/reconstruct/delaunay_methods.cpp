// Advancing front and alpha shape, by CGAL.

#include <CGAL/Advancing_front_surface_reconstruction.h>
#include <CGAL/Alpha_shape_3.h>
#include <CGAL/Alpha_shape_cell_base_3.h>
#include <CGAL/Alpha_shape_vertex_base_3.h>
#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Fixed_alpha_shape_3.h>
#include <CGAL/Fixed_alpha_shape_cell_base_3.h>
#include <CGAL/Fixed_alpha_shape_vertex_base_3.h>
#include <CGAL/Triangulation_data_structure_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>
#include <fmt/format.h>

#include <palpate/result.h>
#include "baselines/reconstruct/method_functions.h"

namespace palpate::baselines {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using FrontStructure = CGAL::Triangulation_data_structure_3<
    CGAL::Triangulation_vertex_base_with_info_3<
        std::uint32_t, Kernel, CGAL::Advancing_front_surface_reconstruction_vertex_base_3<Kernel>>,
    CGAL::Advancing_front_surface_reconstruction_cell_base_3<Kernel>>;
using FrontTriangulation = CGAL::Delaunay_triangulation_3<Kernel, FrontStructure>;

/// Lengths divided by `unit`; 1 leaves the coordinates exact as stored.
template <class Triangulation>
Triangulation delaunay(const MethodInput& input, double unit, render::PreparePhases& phases) {
  phases.begin("Delaunay triangulation");
  std::vector<std::pair<Kernel::Point_3, std::uint32_t>> points;
  points.reserve(input.cloud.size());
  for (std::size_t i = 0; i < input.cloud.size(); ++i) {
    const Vec3 p = input.cloud.local_mm(i) / unit;
    points.emplace_back(Kernel::Point_3(p.x(), p.y(), p.z()), static_cast<std::uint32_t>(i));
  }
  Triangulation triangulation(points.begin(), points.end());
  phases.end();
  return triangulation;
}

}  // namespace

Result<geometry::TriangleMesh> advancing_front(const MethodInput& input, render::PreparePhases& phases) {
  geometry::TriangleMesh mesh = points_as_vertices(input.cloud);
  auto triangulation = delaunay<FrontTriangulation>(input, 1.0, phases);
  if (const std::size_t repeated = input.cloud.size() - triangulation.number_of_vertices(); repeated > 0)
    phases.note(fmt::format("advancing front: {} repeated points", repeated));
  phases.begin("advancing front");
  CGAL::Advancing_front_surface_reconstruction<FrontTriangulation> front(triangulation);
  front.run(input.options.number("front_radius_ratio"), input.options.number("front_beta"));
  const auto& surface = front.triangulation_data_structure_2();
  for (auto face = surface.faces_begin(); face != surface.faces_end(); ++face) {
    if (!face->is_on_surface()) continue;
    mesh.triangles.push_back({face->vertex(0)->vertex_3()->info(), face->vertex(1)->vertex_3()->info(),
                              face->vertex(2)->vertex_3()->info()});
  }
  phases.end();
  // CGAL's order and orientation depend on memory addresses.
  phases.begin("one order");
  fix_order(mesh, input.threads);
  phases.end();
  return mesh;
}

namespace {

using Info = CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel>;
using FixedStructure =
    CGAL::Triangulation_data_structure_3<CGAL::Fixed_alpha_shape_vertex_base_3<Kernel, Info>,
                                         CGAL::Fixed_alpha_shape_cell_base_3<Kernel>>;
using FixedTriangulation = CGAL::Delaunay_triangulation_3<Kernel, FixedStructure>;
using FixedShape = CGAL::Fixed_alpha_shape_3<FixedTriangulation>;
using FreeStructure = CGAL::Triangulation_data_structure_3<CGAL::Alpha_shape_vertex_base_3<Kernel, Info>,
                                                           CGAL::Alpha_shape_cell_base_3<Kernel>>;
using FreeTriangulation = CGAL::Delaunay_triangulation_3<Kernel, FreeStructure>;
using FreeShape = CGAL::Alpha_shape_3<FreeTriangulation>;

/// Corners of a facet, counter-clockwise from outside its cell.
template <class Facet>
std::array<std::uint32_t, 3> corners(const Facet& facet) {
  const auto& [cell, opposite] = facet;
  const auto at = [&](int i) {
    return cell->vertex(CGAL::Triangulation_utils_3::vertex_triple_index(opposite, i))->info();
  };
  return {at(0), at(1), at(2)};
}

template <class Shape>
void collect(const Shape& shape, geometry::TriangleMesh& mesh, render::PreparePhases& phases) {
  std::size_t single = 0;
  for (auto facet = shape.finite_facets_begin(); facet != shape.finite_facets_end(); ++facet) {
    const auto kind = shape.classify(*facet);
    if (kind != Shape::REGULAR && kind != Shape::SINGULAR) continue;
    single += kind == Shape::SINGULAR;
    // A border facet is seen from outside if its cell is the inner one.
    const bool turn = kind == Shape::REGULAR && shape.classify(facet->first) == Shape::EXTERIOR;
    mesh.triangles.push_back(corners(turn ? shape.mirror_facet(*facet) : *facet));
  }
  phases.note(fmt::format("alpha shape: {} facets on the border of solid parts, {} single ones",
                          mesh.triangles.size() - single, single));
}

/// Coplanar points have no cells: takes the triangles of their planar Delaunay triangulation with a small
/// enough circle.
void collect_flat(const FixedTriangulation& flat, double radius, geometry::TriangleMesh& mesh) {
  for (auto facet = flat.finite_facets_begin(); facet != flat.finite_facets_end(); ++facet) {
    const auto& cell = facet->first;
    const auto at = [&](int i) { return cell->vertex(i); };
    if (CGAL::squared_radius(at(0)->point(), at(1)->point(), at(2)->point()) <= radius * radius)
      mesh.triangles.push_back({at(0)->info(), at(1)->info(), at(2)->info()});
  }
}

}  // namespace

Result<geometry::TriangleMesh> alpha_shape(const MethodInput& input, render::PreparePhases& phases) {
  constexpr int kSpace = 3;
  const double radius = input.options.number("alpha_radius");
  geometry::TriangleMesh mesh = points_as_vertices(input.cloud);
  if (radius > 0.0) {
    auto triangulation = delaunay<FixedTriangulation>(input, input.spacing, phases);
    phases.begin("alpha shape");
    if (triangulation.dimension() < kSpace)
      collect_flat(triangulation, radius, mesh);
    else
      collect(FixedShape(triangulation, radius * radius), mesh, phases);
    phases.end();
    return mesh;
  }
  auto triangulation = delaunay<FreeTriangulation>(input, input.spacing, phases);
  if (triangulation.dimension() < kSpace)
    return Error{"points in a plane have no optimal alpha shape", "give alpha_radius a value"};
  phases.begin("alpha shape");
  FreeShape shape(triangulation, 0.0, FreeShape::GENERAL);
  const auto optimal = shape.find_optimal_alpha(1);
  if (optimal == shape.alpha_end()) return Error{"no alpha leaves one solid", "give alpha_radius a value"};
  shape.set_alpha(*optimal);
  collect(shape, mesh, phases);
  phases.end();
  phases.note(fmt::format("alpha shape: optimal radius {:.4g} spacings", std::sqrt(*optimal)));
  return mesh;
}

}  // namespace palpate::baselines
