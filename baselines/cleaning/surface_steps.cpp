// Cleaning steps of CGAL that fit a surface: smooth and fill-holes, with Eigen as their solver.

#define CGAL_EIGEN3_ENABLED 1  // for the least squares, and the sparse solver of fairing

#include <CGAL/Eigen_svd.h>
#include <CGAL/Polygon_mesh_processing/border.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/repair_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/triangulate_hole.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/bilateral_smooth_point_set.h>
#include <CGAL/jet_smooth_point_set.h>
#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <numeric>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include "baselines/cleaning/steps.h"
#include "baselines/reconstruct/cgal_points.h"
#include "baselines/reconstruct/reconstruct.h"

namespace palpate::baselines {
namespace {

/// Coincident neighbours give a non-finite matrix, on which Eigen's solver would read out of bounds. The
/// point gets a non-finite place and is kept.
struct GuardedSvd : CGAL::Eigen_svd {
  static FT solve(const Matrix& matrix, Vector& right) {
    if (matrix.eigen_object().allFinite() && right.eigen_object().allFinite())
      return CGAL::Eigen_svd::solve(matrix, right);
    right.eigen_object().setConstant(std::numeric_limits<double>::quiet_NaN());
    return std::numeric_limits<double>::infinity();
  }
};

/// Number of coefficients of a bivariate polynomial of this degree; a jet needs as many points.
unsigned coefficients(unsigned degree) {
  return (degree + 1) * (degree + 2) / 2;
}

void jets(const scene::CleaningStepInput& input, unsigned k, std::vector<CgalPoint>& points) {
  const auto degree = static_cast<unsigned>(input.options.integer("degree"));
  const auto parameters = CGAL::parameters::point_map(CgalPlaceMap())
                              .svd_traits(GuardedSvd())
                              .degree_fitting(degree)
                              .degree_monge(std::min(degree, 2u))  // minimum of CGAL's Monge frame
                              .callback(Advance{&input.progress, "smoothing by jets"});
  CGAL::jet_smooth_point_set<CGAL::Sequential_tag>(points, k, parameters);
}

/// Moves the points with a normal; returns the number of the others.
std::size_t bilateral(const scene::CleaningStepInput& input, unsigned k, std::vector<CgalPoint>& points) {
  const std::vector<Vec3> normals = plane_normals(input);
  std::vector<CgalPoint> with = with_normals(points, normals);
  if (with.size() <= k) return points.size();
  const auto parameters = CGAL::parameters::point_map(CgalPlaceMap())
                              .normal_map(CgalNormalMap())
                              .sharpness_angle(input.options.number("sharpness_deg"))
                              .callback(Advance{&input.progress, "smoothing bilaterally"});
  for (long long i = 0; i < input.options.integer("iterations") && !input.progress.cancelled(); ++i)
    CGAL::bilateral_smooth_point_set<CGAL::Sequential_tag>(with, k, parameters);
  for (const CgalPoint& p : with) points[p.index].place = p.place;
  return points.size() - with.size();
}

bool is_finite(const Vec3& p) {
  return std::isfinite(p.x()) && std::isfinite(p.y()) && std::isfinite(p.z());
}

}  // namespace

Result<scene::CleaningStepOutput> smooth(const scene::CleaningStepInput& input) {
  const auto k = static_cast<unsigned>(input.options.integer("neighbours"));
  const bool jet = input.options.text("method") == "jet";
  const auto degree = static_cast<unsigned>(input.options.integer("degree"));
  if (jet && k < coefficients(degree))
    return Error{
        fmt::format("a jet of degree {} needs {} neighbours, not {}", degree, coefficients(degree), k),
        "give it more neighbours, or a lower degree"};
  PALPATE_TRY(enough_points(input, k + 1));
  std::vector<CgalPoint> points = cgal_points(input.cloud, input.spacing_mm);
  std::size_t left = 0;
  if (!jet) left = bilateral(input, k, points);
  for (long long i = 0; jet && i < input.options.integer("iterations") && !input.progress.cancelled(); ++i)
    jets(input, k, points);
  scene::CleaningStepOutput output;
  for (const CgalPoint& p : points) {
    // Coincident or collinear neighbours determine no polynomial: the point is kept.
    const Vec3 place = place_of(p.place) * input.spacing_mm;
    const bool finite = is_finite(place);
    left += finite ? 0 : 1;
    output.from.push_back(p.index);
    output.new_points_mm.push_back(finite ? place : input.cloud.local_mm(p.index));
  }
  if (left > 0) output.note = fmt::format("{} of them could not be fitted and stayed", left);
  return output;
}

namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using Mesh = CGAL::Surface_mesh<CgalKernel::Point_3>;
using Halfedge = Mesh::Halfedge_index;

// A border at least half as wide as its piece is the rim of a sheet; a hole leaves a margin, even in a figure
// of eight.
constexpr double kRimShare = 0.5;

// CGAL's refinement factor. Measured: a hole of about 67 points cut from a grid gets 75 with 2.5, 19 with the
// default, root two.
constexpr double kDensity = 2.5;

double width_of(const geometry::Aabb& box) {
  return box.extent_mm().norm();
}

/// The mesh in spacings, oriented, at most two faces per edge. Omits faces with an edge longer than
/// `longest`, with which the reconstruction spanned holes.
Mesh mesh_of(const geometry::TriangleMesh& triangles, double longest, const scene::CleaningStepInput& input) {
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

/// One half-edge of every border that is a hole up to `limit` wide; `wide` counts the wider ones that are no
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

Result<scene::CleaningStepOutput> fill_holes(const scene::CleaningStepInput& input) {
  ReconstructRequest request;
  request.method = "advancing-front";
  request.limits.time_s = input.options.number("time_limit_s");
  request.threads = input.threads;
  PALPATE_ASSIGN(const Reconstruction made, reconstruct(request, input.cloud, input.progress));
  Mesh mesh = mesh_of(made.mesh, input.options.number("edge"), input);
  std::size_t wide = 0, filled = 0, refused = 0;
  scene::CleaningStepOutput output;
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
      output.new_points_mm.push_back(place_of(mesh.point(v)) * input.spacing_mm);
      output.from.push_back(scene::kNearestInputPoint);
    }
  }
  output.note =
      fmt::format("{} hole{} filled, {} wider than the limit", filled, filled == 1 ? "" : "s", wide);
  if (refused > 0) output.note += fmt::format(", {} could not be", refused);
  return output;
}

}  // namespace palpate::baselines
