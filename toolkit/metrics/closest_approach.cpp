#include "toolkit/metrics/closest_approach.h"

#include <cmath>

#include "toolkit/geometry/aabb_tree.h"

namespace palpate::metrics {
namespace {

// Points in a leaf: a tree of two nodes per 32 points stays small, and testing 32 is fast.
constexpr std::uint32_t kLeafPoints = 32;

}  // namespace

ClosestApproach closest_approach(const trace::ProbePath& path, std::span<const render::ModelInput> models) {
  ClosestApproach best;
  double best_sq = std::numeric_limits<double>::infinity();
  for (std::size_t m = 0; m < models.size(); ++m) {
    const cloud::Cloud& cloud = *models[m].cloud;
    const geometry::AabbTree tree(
        static_cast<std::uint32_t>(cloud.size()),
        [&](std::uint32_t i) {
          const Vec3 p = cloud.local_mm(i);
          return geometry::Aabb{p, p};
        },
        kLeafPoints);
    const geometry::RigidTransform model_from_world = models[m].world_from_model.inverse();
    for (std::size_t k = 0; k < path.size(); ++k) {
      const Vec3 hip = model_from_world * path.hip_mm[k] - cloud.origin_mm;
      tree.visit_nearest([&](const geometry::Aabb& box) { return box.distance_sq_mm2(hip); }, best_sq,
                         [&](std::uint32_t i) {
                           const double distance_sq = (cloud.local_mm(i) - hip).squaredNorm();
                           if (distance_sq < best_sq) {
                             best_sq = distance_sq;
                             best = {std::sqrt(distance_sq), k, m};
                           }
                           return best_sq;
                         });
    }
  }
  return best;
}

}  // namespace palpate::metrics
