#include "baselines/reference/mesh_distance.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "baselines/reference/facet_tree.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/random.h"
#include "toolkit/geometry/facet_picker.h"
#include "toolkit/partition/point_search.h"

namespace palpate::baselines {
namespace {

constexpr std::uint64_t kSeed = 1;

/// Places spread evenly over the triangles' area: one in each of `count` equal parts of the running sum.
std::vector<Vec3> places_on(const geometry::TriangleMesh& mesh, std::size_t count) {
  const geometry::FacetPicker picker(mesh);
  std::vector<Vec3> places;
  Random random(kSeed);
  for (std::size_t i = 0; i < count; ++i) {
    const double at =
        picker.area() * (static_cast<double>(i) + random.uniform()) / static_cast<double>(count);
    places.push_back(picker.pick_at(at, random).point);
  }
  return places;
}

/// Root mean square and largest of distance(i), 0 <= i < count.
std::pair<double, double> summary(std::size_t count, int threads,
                                  const std::function<double(std::size_t)>& distance) {
  constexpr std::size_t kGrain = 256;
  std::vector<double> all(count);
  parallel_chunks(count, kGrain, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) all[i] = distance(i);
  });
  double squares = 0.0, most = 0.0;
  for (const double d : all) {
    squares += d * d;
    most = std::max(most, d);
  }
  return {std::sqrt(squares / static_cast<double>(count)), most};
}

}  // namespace

Result<MeshDistance> mesh_distance(const geometry::TriangleMesh& mesh, const cloud::Cloud& cloud,
                                   std::size_t samples, int threads) {
  if (mesh.empty() || cloud.empty()) return Error{"a distance needs triangles and points", {}, {}, 0};
  const Result<SurfaceMesh> surface = SurfaceMesh::build(mesh, threads);
  if (!surface) return surface.error();
  const FacetTree tree(*surface);
  MeshDistance d;
  d.samples = std::max<std::size_t>(1, std::min(samples, cloud.size()));
  std::tie(d.points_rms_mm, d.points_max_mm) = summary(d.samples, threads, [&](std::size_t i) {
    const Vec3 p = cloud.point_mm(i * cloud.size() / d.samples) - surface->origin_mm();
    return (tree.closest(p).point.point - p).norm();
  });
  const std::vector<Vec3> places = places_on(mesh, d.samples);
  const partition::PointSearch points(cloud);
  std::tie(d.mesh_rms_mm, d.mesh_max_mm) = summary(d.samples, threads, [&](std::size_t i) {
    return (cloud.point_mm(points.nearest(places[i])) - places[i]).norm();
  });
  return d;
}

}  // namespace palpate::baselines
