#define CGAL_EIGEN3_ENABLED 1  // its sparse solver, for fairing
#include <CGAL/Polygon_mesh_processing/border.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/repair_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/triangulate_hole.h>
#include <CGAL/Surface_mesh.h>
#include <fmt/format.h>

#include <numeric>

#include "baselines/cleaning/steps.h"
#include "baselines/reconstruct/cgal_points.h"
#include "baselines/reconstruct/reconstruct.h"
#include "toolkit/geometry/aabb.h"

namespace palpate::baselines {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using Mesh = CGAL::Surface_mesh<CgalKernel::Point_3>;
using Halfedge = Mesh::Halfedge_index;

// A border is the rim of a sheet, not a hole in it, where it is at least half as wide as its whole piece: a
// hole leaves a margin, so that even one of two in a figure of eight is narrower.
constexpr double kRimShare = 0.5;

// CGAL's factor of refinement. Measured: a hole of some 67 points that was cut out of a grid gets 75
// with 2.5, 19 with CGAL's own root of two.
constexpr double kDensity = 2.5;

double width_of(const geometry::Aabb& box) {
  return box.extent_mm().norm();
}

/// In spacings, oriented, each edge between at most two faces. Without faces that have an edge longer than
/// `longest`: the reconstruction has spanned a hole with them.
Mesh mesh_of(const geometry::TriangleMesh& triangles, double longest, const scene::StepInput& input) {
  std::vector<CgalKernel::Point_3> places;
  for (const Vec3& v : triangles.vertices_mm) {
    const Vec3 p = (v - input.cloud.origin_mm) / input.spacing_mm;
    places.emplace_back(p.x(), p.y(), p.z());
  }
  std::vector<std::vector<std::size_t>> faces;
  for (const auto& t : triangles.triangles) {
    bool spans = false;
    for (std::size_t e = 0; e < t.size(); ++e)
      spans =
          spans || CGAL::squared_distance(places[t[e]], places[t[(e + 1) % t.size()]]) > longest * longest;
    if (!spans) faces.push_back({t[0], t[1], t[2]});
  }
  pmp::repair_polygon_soup(places, faces);
  pmp::orient_polygon_soup(places, faces);
  Mesh mesh;
  pmp::polygon_soup_to_polygon_mesh(places, faces, mesh);
  return mesh;
}

/// How wide the connected piece of every face is.
std::vector<double> widths_of_pieces(Mesh& mesh) {
  auto [piece, made] = mesh.add_property_map<Mesh::Face_index, std::size_t>("f:piece", 0);
  const std::size_t count = pmp::connected_components(mesh, piece);
  std::vector<geometry::Aabb> boxes(count);
  for (const Mesh::Face_index f : mesh.faces())
    for (const Mesh::Vertex_index v : mesh.vertices_around_face(mesh.halfedge(f)))
      boxes[piece[f]].add(place_of(mesh.point(v)));
  std::vector<double> widths;
  for (const Mesh::Face_index f : mesh.faces()) widths.push_back(width_of(boxes[piece[f]]));
  return widths;
}

/// One half-edge of every border that is a hole no wider than `limit`; `wide` counts the others that are not
/// rims.
std::vector<Halfedge> holes_of(Mesh& mesh, double limit, std::size_t& wide) {
  const std::vector<double> pieces = widths_of_pieces(mesh);
  std::vector<Halfedge> borders, holes;
  pmp::extract_boundary_cycles(mesh, std::back_inserter(borders));
  for (const Halfedge border : borders) {
    geometry::Aabb box;
    for (const Mesh::Vertex_index v : mesh.vertices_around_face(border)) box.add(place_of(mesh.point(v)));
    const double width = width_of(box);
    if (width >= kRimShare * pieces[mesh.face(mesh.opposite(border))]) continue;
    if (width <= limit)
      holes.push_back(border);
    else
      ++wide;
  }
  return holes;
}

}  // namespace

Result<scene::StepOutput> fill_holes(const scene::StepInput& input) {
  ReconstructRequest request;
  request.method = "advancing-front";
  request.limits.time_s = input.options.number("time_limit_s");
  request.threads = input.threads;
  const Result<Reconstruction> made = reconstruct(request, input.cloud, input.progress);
  if (!made) return made.error();
  Mesh mesh = mesh_of(made->mesh, input.options.number("edge"), input);
  std::size_t wide = 0, filled = 0, refused = 0;
  scene::StepOutput output;
  output.from.resize(input.cloud.size());
  std::iota(output.from.begin(), output.from.end(), 0u);
  const std::vector<Halfedge> holes = holes_of(mesh, input.options.number("width"), wide);
  for (const Halfedge hole : holes) {
    if (input.progress.cancelled()) break;
    input.progress.report("filling holes", static_cast<double>(filled) / static_cast<double>(holes.size()));
    std::vector<Mesh::Face_index> faces;
    std::vector<Mesh::Vertex_index> added;
    pmp::triangulate_refine_and_fair_hole(mesh, hole, std::back_inserter(faces), std::back_inserter(added),
                                          CGAL::parameters::density_control_factor(kDensity));
    ++(faces.empty() ? refused : filled);
    for (const Mesh::Vertex_index v : added) {
      output.placed_mm.push_back(place_of(mesh.point(v)) * input.spacing_mm);
      output.from.push_back(scene::kFromNearest);
    }
  }
  output.note =
      fmt::format("{} hole{} filled, {} wider than the limit", filled, filled == 1 ? "" : "s", wide);
  if (refused > 0) output.note += fmt::format(", {} could not be", refused);
  return output;
}

}  // namespace palpate::baselines
