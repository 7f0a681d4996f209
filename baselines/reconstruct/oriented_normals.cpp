#include "baselines/reconstruct/oriented_normals.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <tuple>

#include "toolkit/neighbourhood/knn.h"
#include "toolkit/surface/planes.h"

namespace palpate::baselines {
namespace {

std::vector<Vec3> plane_normals(const MethodInput& input, render::PreparePhases& phases) {
  const cloud::Cloud& cloud = input.cloud;
  phases.begin(kNeighboursPhase);
  const neighbourhood::NeighbourTable neighbours = neighbourhood::exact_knn(cloud, input.threads);
  phases.end();
  phases.begin(kNormalsPhase);
  std::vector<surface::SurfacePoint> points = surface::surface_points(cloud);
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

/// The indices of the points, only the first of those at one place.
std::vector<std::uint32_t> distinct(const cloud::Cloud& cloud) {
  const auto place = [&](std::uint32_t i) { return std::tuple(cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]); };
  std::vector<std::uint32_t> order(cloud.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(),
            [&](auto a, auto b) { return std::tuple(place(a), a) < std::tuple(place(b), b); });
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

}  // namespace palpate::baselines
