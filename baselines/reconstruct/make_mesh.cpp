#include <palpate/result.h>
#include "baselines/reconstruct/method_functions.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <new>
#include <tuple>
#include <utility>

#include "toolkit/cloud/statistics.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"
#include "toolkit/search/knn.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::baselines {
namespace {

Result<geometry::TriangleMesh> either_poisson(const MethodInput& input, render::PreparePhases& phases) {
  return input.options.text("poisson_on") == "octree" ? poisson_octree(input, phases)
                                                      : poisson(input, phases);
}

struct Entry {
  const char* name;
  MethodFunction* make;
};
constexpr std::array kFunctions = {
    Entry{"advancing-front", advancing_front},
    Entry{"poisson", either_poisson},
    Entry{"scale-space", scale_space},
    Entry{"alpha-shape", alpha_shape},
    Entry{"power-crust", power_crust},
#ifdef PALPATE_WITH_OPEN3D
    Entry{"ball-pivoting", ball_pivoting},
#endif
    Entry{"greedy-projection", greedy_projection},
    Entry{"marching-cubes", marching_cubes},
    Entry{"organised", organised},
    Entry{"stars", stars_of_points},
};

/// Whether the points are not collinear: tests the first, the farthest from it, and the farthest from both,
/// up to the float rounding of stored coordinates.
bool span_a_plane(const cloud::Cloud& cloud) {
  constexpr double kRelative = 0x1p-23;
  const Vec3 first = cloud.local_mm(0);
  Vec3 along = Vec3::Zero();
  for (std::size_t i = 1; i < cloud.size(); ++i)
    if (const Vec3 to = cloud.local_mm(i) - first; to.squaredNorm() > along.squaredNorm()) along = to;
  const double length = along.norm();
  if (!(length > 0.0)) return false;
  along /= length;
  for (std::size_t i = 1; i < cloud.size(); ++i)
    if ((cloud.local_mm(i) - first).cross(along).norm() > kRelative * length) return true;
  return false;
}

/// A cloud as given to the libraries: centred, spacing from 1 to 2, so that their absolute tolerances fit. A
/// power of two scales it without rounding.
struct OwnFrame {
  cloud::Cloud cloud;
  double spacing = 1.0;
  int exponent = 0;
  Vec3 origin_mm = Vec3::Zero();

  explicit OwnFrame(const cloud::Cloud& given) : origin_mm(given.origin_mm) {
    const double spacing_mm = search::mean_spacing_mm(given);
    exponent = std::ilogb(spacing_mm);
    spacing = std::ldexp(spacing_mm, -exponent);
    cloud.raster = given.raster;
    const auto scaled = [&](const std::vector<float>& from) {
      std::vector<float> to(from);
      for (float& x : to) x = std::ldexp(x, -exponent);
      return to;
    };
    cloud.x_mm = scaled(given.x_mm);
    cloud.y_mm = scaled(given.y_mm);
    cloud.z_mm = scaled(given.z_mm);
  }
  [[nodiscard]] Vec3 to_model(const Vec3& p) const {
    return origin_mm + p.unaryExpr([&](double x) { return std::ldexp(x, exponent); });
  }
};

/// Flips all triangles if they enclose a negative volume about their centre. For an open sheet the result is
/// arbitrary.
void turn_outward(geometry::TriangleMesh& mesh) {
  Vec3 middle = Vec3::Zero();
  for (const auto& t : mesh.triangles)
    middle += mesh.vertices_mm[t[0]] / static_cast<double>(mesh.triangles.size());
  double volume = 0.0;
  for (const auto& t : mesh.triangles)
    volume += (mesh.vertices_mm[t[0]] - middle)
                  .dot((mesh.vertices_mm[t[1]] - middle).cross(mesh.vertices_mm[t[2]] - middle));
  if (volume < 0.0)
    for (auto& t : mesh.triangles) std::swap(t[1], t[2]);
}

Result<geometry::TriangleMesh> checked(const Method& method, const MethodInput& input,
                                       render::PreparePhases& phases) {
  for (const Entry& entry : kFunctions) {
    if (entry.name != method.name) continue;
    Result<geometry::TriangleMesh> mesh = entry.make(input, phases);
    if (mesh && mesh->empty())
      return Error{fmt::format("{} found no triangle", method.name),
                   "use a cloud sampled densely from a surface, or other options"};
    if (mesh) turn_outward(*mesh);
    return mesh;
  }
  return Error{fmt::format("this build does not have the reconstruction '{}'", method.name),
               method.not_built};
}

}  // namespace

geometry::TriangleMesh points_as_vertices(const cloud::Cloud& cloud) {
  geometry::TriangleMesh mesh;
  mesh.vertices_mm.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) mesh.vertices_mm.push_back(cloud.point_mm(i));
  return mesh;
}

Result<geometry::TriangleMesh> make_mesh(const Method& method, const cloud::Cloud& cloud,
                                         const Options& options, int threads, render::PreparePhases& phases) {
  constexpr std::size_t kTriangle = 3;
  if (cloud.size() < kTriangle || !span_a_plane(cloud))
    return Error{
        fmt::format("{} points, fewer than three of them different or all on a line, span no surface",
                    cloud.size()),
        "use a cloud of a surface"};
  if (method.raster_only && !cloud.raster)
    return Error{fmt::format("{} needs points in the full raster of a scanner", method.name),
                 "take another reconstruction, for example advancing-front"};
  try {
    seed_cgal();
    const OwnFrame own(cloud);
    Result<geometry::TriangleMesh> mesh = checked(method, {own.cloud, options, threads, own.spacing}, phases);
    if (mesh)
      for (Vec3& v : mesh->vertices_mm) v = own.to_model(v);
    return mesh;
  } catch (const std::bad_alloc&) {
    Error error{fmt::format("{}: not enough memory for {} points", method.name, cloud.size()),
                "use fewer points or allow more memory"};
    error.gave_up = true;
    return error;
  } catch (const std::exception& thrown) {
    return Error{fmt::format("{} failed: {}", method.name, thrown.what()),
                 "check the cloud, or take another reconstruction"};
  }
}

namespace {

std::vector<Vec3> plane_normals(const MethodInput& input, render::PreparePhases& phases) {
  const cloud::Cloud& cloud = input.cloud;
  phases.begin(kNeighboursPhase);
  const search::NeighbourTable neighbours = search::exact_knn(cloud, input.threads);
  phases.end();
  phases.begin(kNormalsPhase);
  std::vector<surface::OrientedPoint> points = surface::surface_points(cloud);
  surface::fit_planes(points, neighbours.of, input.threads);
  phases.end();
  phases.begin(kOrientationPhase);
  const surface::OrientReport found = surface::orient_planes(points, neighbours.of, input.threads);
  std::vector<Vec3> normals = surface::normals_of(points);
  phases.end();
  phases.note(fmt::format("normals: {} connected piece{}, {} points in pieces that enclose a volume",
                          found.pieces, found.pieces == 1 ? "" : "s", found.one_sided_points));
  return normals;
}

/// Indices of the points, only the first at each place.
std::vector<std::uint32_t> distinct(const cloud::Cloud& cloud) {
  const auto place = [&](std::uint32_t i) { return std::tuple(cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]); };
  std::vector<std::uint32_t> order = cloud::indices_by_place(cloud);
  order.erase(std::unique(order.begin(), order.end(), [&](auto a, auto b) { return place(a) == place(b); }),
              order.end());
  std::sort(order.begin(), order.end());
  return order;
}

}  // namespace

std::vector<Vec3> oriented_normals(const MethodInput& input, render::PreparePhases& phases) {
  const std::string& how = input.options.text("normals");
  if (how == "planes") return plane_normals(input, phases);
  return cgal_normals(input, how == "jet", static_cast<unsigned>(input.options.integer("normal_neighbours")),
                      phases);
}

OrientedPoints oriented_points(const MethodInput& input, double unit_mm, render::PreparePhases& phases) {
  const std::vector<Vec3> normals = oriented_normals(input, phases);
  phases.begin("distinct points");
  OrientedPoints points;
  points.unit_mm = unit_mm;
  for (const std::uint32_t i : distinct(input.cloud)) {
    if (normals[i] == Vec3::Zero()) continue;
    points.index.push_back(i);
    points.place.push_back(input.cloud.local_mm(i) / unit_mm);
    points.normal.push_back(normals[i]);
  }
  phases.end();
  if (const std::size_t left = input.cloud.size() - points.index.size(); left > 0)
    phases.note(fmt::format("{} points left out: repeated, or without a normal", left));
  return points;
}

Result<geometry::TriangleMesh> stars_of_points(const MethodInput& input, render::PreparePhases& phases) {
  phases.begin("stars");
  geometry::TriangleMesh mesh =
      local_delaunay::LocalDelaunayMesh::build(input.cloud, input.threads).as_mesh();
  phases.end();
  return mesh;
}

}  // namespace palpate::baselines
