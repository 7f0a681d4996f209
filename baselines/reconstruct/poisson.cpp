// Poisson reconstruction by CGAL: the function on a Delaunay refinement of the points, its level set meshed
// by a second refinement.
#define CGAL_EIGEN3_ENABLED 1  // for the conjugate gradient
#include <fmt/format.h>

#include <palpate/result.h>
#include "baselines/reconstruct/method_functions.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/facets_in_complex_2_to_triangle_mesh.h>
#include <CGAL/Implicit_surface_3.h>
#include <CGAL/Orthogonal_k_neighbor_search.h>
#include <CGAL/Poisson_reconstruction_function.h>
#include <CGAL/Search_traits_3.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_default_triangulation_3.h>
#include <CGAL/make_surface_mesh.h>
#include <CGAL/property_map.h>

namespace palpate::baselines {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using PointWithNormal = std::pair<Kernel::Point_3, Kernel::Vector_3>;
using Function = CGAL::Poisson_reconstruction_function<Kernel>;
using Triangulation = CGAL::Surface_mesh_default_triangulation_3;
using Complex = CGAL::Surface_mesh_complex_2_in_triangulation_3<Triangulation>;
using Surface = CGAL::Implicit_surface_3<Kernel, Function>;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Search = CGAL::Orthogonal_k_neighbor_search<CGAL::Search_traits_3<Kernel>>;

/// From CGAL's manual: radius of the surface's sphere in radii of the points' sphere; accuracy of the level
/// set along a segment in allowed distances.
constexpr double kSphereRadii = 5.0, kDichotomy = 1e-3;

Result<Mesh> level_set(const std::vector<PointWithNormal>& points, const Options& options,
                       render::PreparePhases& phases) {
  phases.begin("Poisson function");
  Function function(points.begin(), points.end(), CGAL::First_of_pair_property_map<PointWithNormal>(),
                    CGAL::Second_of_pair_property_map<PointWithNormal>());
  if (!function.compute_implicit_function())
    return Error{"the Poisson equation could not be solved", "check the normals of the cloud"};
  phases.end();
  phases.begin("surface meshing");
  const double radius = kSphereRadii * std::sqrt(function.bounding_sphere().squared_radius());
  const double distance = options.number("poisson_distance");
  const Surface surface(function, Kernel::Sphere_3(function.get_inner_point(), radius * radius),
                        kDichotomy * distance / radius);
  Triangulation triangulation;
  Complex complex(triangulation);
  CGAL::make_surface_mesh(complex, surface,
                          CGAL::Surface_mesh_default_criteria_3<Triangulation>(
                              options.number("poisson_angle"), options.number("poisson_radius"), distance),
                          CGAL::Manifold_with_boundary_tag());
  Mesh mesh;
  if (triangulation.number_of_vertices() > 0) CGAL::facets_in_complex_2_to_triangle_mesh(complex, mesh);
  phases.end();
  return mesh;
}

/// Corners within `trim` of a point; all if `trim` is 0.
std::vector<bool> near_points(const Mesh& mesh, const std::vector<PointWithNormal>& points, double trim) {
  std::vector<bool> near(mesh.number_of_vertices(), true);
  if (trim == 0.0) return near;
  Search::Tree tree;
  for (const PointWithNormal& p : points) tree.insert(p.first);
  tree.build();
  for (const Mesh::Vertex_index v : mesh.vertices())
    near[v] = Search(tree, mesh.point(v), 1).begin()->second <= trim * trim;
  return near;
}

}  // namespace

Result<geometry::TriangleMesh> poisson(const MethodInput& input, render::PreparePhases& phases) {
  const OrientedPoints given = oriented_points(input, input.spacing, phases);
  std::vector<PointWithNormal> points;
  points.reserve(given.place.size());
  for (std::size_t i = 0; i < given.place.size(); ++i) {
    const Vec3 &p = given.place[i], &n = given.normal[i];
    points.emplace_back(Kernel::Point_3(p.x(), p.y(), p.z()), Kernel::Vector_3(n.x(), n.y(), n.z()));
  }
  PALPATE_ASSIGN(Mesh found, level_set(points, input.options, phases));
  phases.begin("trimming");
  const std::vector<bool> near = near_points(found, points, input.options.number("poisson_trim"));
  geometry::TriangleMesh mesh;
  for (const Mesh::Vertex_index v : found.vertices()) {
    const Kernel::Point_3& p = found.point(v);
    mesh.vertices_mm.push_back(input.cloud.origin_mm + Vec3(p.x(), p.y(), p.z()) * given.unit_mm);
  }
  std::size_t trimmed = 0;
  for (const Mesh::Face_index face : found.faces()) {
    std::array<std::uint32_t, 3> corners{};
    std::size_t k = 0;
    for (const Mesh::Vertex_index v : CGAL::vertices_around_face(found.halfedge(face), found))
      corners[k++] = static_cast<std::uint32_t>(v);
    if (near[corners[0]] && near[corners[1]] && near[corners[2]])
      mesh.triangles.push_back(corners);
    else
      ++trimmed;
  }
  phases.end();
  if (trimmed > 0) phases.note(fmt::format("poisson: {} facets far from every point left out", trimmed));
  return mesh;
}

}  // namespace palpate::baselines
