#include "baselines/reconstruct/make_mesh.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <exception>
#include <new>
#include <utility>

#include "baselines/reconstruct/method_functions.h"
#include "baselines/reconstruct/poisson_octree.h"
#include "toolkit/neighbourhood/knn.h"

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

/// Whether three points are no line: the first, the one farthest from it, and the one farthest from both.
/// Exact to the rounding of the stored coordinates, whose relative size is the unit roundoff of float.
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

/// A cloud as the libraries get it: about its own middle, its spacing from 1 to 2. Their absolute tolerances
/// then see the same numbers however large a model is and wherever it stands. By a power of two, so that
/// nothing is rounded.
struct OwnFrame {
  cloud::Cloud cloud;
  double spacing = 1.0;
  int exponent = 0;
  Vec3 origin_mm = Vec3::Zero();

  explicit OwnFrame(const cloud::Cloud& given) : origin_mm(given.origin_mm) {
    const double spacing_mm = neighbourhood::mean_spacing_mm(given);
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

/// Turns all triangles where they enclose a negative volume about their middle. An open sheet has no outside:
/// there it decides nothing that matters.
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
                   "use a cloud sampled densely from a surface, or other options",
                   {},
                   0};
    if (mesh) turn_outward(*mesh);
    return mesh;
  }
  return Error{
      fmt::format("this build does not have the reconstruction '{}'", method.name), method.not_built, {}, 0};
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
        "use a cloud of a surface",
        {},
        0};
  if (method.raster_only && !cloud.raster)
    return Error{fmt::format("{} needs points in the full raster of a scanner", method.name),
                 "take another reconstruction, for example advancing-front",
                 {},
                 0};
  try {
    seed_cgal();
    const OwnFrame own(cloud);
    Result<geometry::TriangleMesh> mesh = checked(method, {own.cloud, options, threads, own.spacing}, phases);
    if (mesh)
      for (Vec3& v : mesh->vertices_mm) v = own.to_model(v);
    return mesh;
  } catch (const std::bad_alloc&) {
    Error error{fmt::format("{}: not enough memory for {} points", method.name, cloud.size()),
                "use fewer points or allow more memory",
                {},
                0};
    error.gave_up = true;
    return error;
  } catch (const std::exception& failure) {
    return Error{fmt::format("{} failed: {}", method.name, failure.what()),
                 "check the cloud, or take another reconstruction",
                 {},
                 0};
  }
}

}  // namespace palpate::baselines
