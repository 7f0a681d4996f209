#include "baselines/proximity/mesh_gap.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/parallel.h"

namespace palpate::baselines {
namespace {

/// Places a chunk, for parallel work; sums are formed chunk by chunk.
constexpr std::size_t kChunk = 4096;
/// Steps of the additive sequence that fills the unit square evenly: the inverse powers of the plastic
/// number.
constexpr double kStepU = 0.7548776662466927;
constexpr double kStepV = 0.5698402909980532;

}  // namespace

MeshGap gap_to(const SurfaceMesh& mesh, const SegmentIndex& index, std::span<const Vec3> places,
               int threads) {
  struct Part {
    double sum_sq = 0.0, most_sq = 0.0;
  };
  std::vector<Part> parts((places.size() + kChunk - 1) / kChunk);
  const geometry::Aabb& box = mesh.local_box_mm();
  parallel_chunks(places.size(), kChunk, threads, [&](std::size_t begin, std::size_t end) {
    Part& part = parts[begin / kChunk];
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3 p = places[i] - mesh.origin_mm();
      const double reach = (p - box.centre_mm()).norm() + box.extent_mm().norm();
      const std::uint32_t facet = index.nearest(p, reach);
      if (facet == kNoFacet) continue;
      const double distance_sq = closest_on_facet(mesh.facet(facet), p).distance_sq;
      part.sum_sq += distance_sq;
      part.most_sq = std::max(part.most_sq, distance_sq);
    }
  });
  Part all;
  for (const Part& part : parts) {
    all.sum_sq += part.sum_sq;
    all.most_sq = std::max(all.most_sq, part.most_sq);
  }
  const double count = static_cast<double>(std::max<std::size_t>(places.size(), 1));
  return {std::sqrt(all.sum_sq / count), std::sqrt(all.most_sq), places.size()};
}

std::vector<Vec3> places_on(const geometry::TriangleMesh& mesh, std::size_t count) {
  std::vector<double> until;
  until.reserve(mesh.triangles.size());
  double area = 0.0;
  const auto corner = [&](std::size_t facet, std::size_t i) -> const Vec3& {
    return mesh.vertices_mm[mesh.triangles[facet][i]];
  };
  for (std::size_t f = 0; f < mesh.triangles.size(); ++f) {
    area += (corner(f, 1) - corner(f, 0)).cross(corner(f, 2) - corner(f, 0)).norm();
    until.push_back(area);
  }
  std::vector<Vec3> places;
  if (!(area > 0.0)) return places;
  places.reserve(count);
  for (std::size_t k = 0; k < count; ++k) {
    const double at = area * (static_cast<double>(k) + 0.5) / static_cast<double>(count);
    const auto f = static_cast<std::size_t>(std::lower_bound(until.begin(), until.end(), at) - until.begin());
    double u = std::fmod(static_cast<double>(k) * kStepU, 1.0),
           v = std::fmod(static_cast<double>(k) * kStepV, 1.0);
    if (u + v > 1.0) {
      u = 1.0 - u;
      v = 1.0 - v;
    }
    const std::size_t facet = std::min(f, mesh.triangles.size() - 1);
    places.push_back(corner(facet, 0) + u * (corner(facet, 1) - corner(facet, 0)) +
                     v * (corner(facet, 2) - corner(facet, 0)));
  }
  return places;
}

}  // namespace palpate::baselines
