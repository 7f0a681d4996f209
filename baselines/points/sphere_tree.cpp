#include "baselines/points/sphere_tree.h"

#include <limits>
#include <utility>

#include "toolkit/core/tolerances.h"

namespace palpate::baselines {
namespace {

constexpr std::size_t kNodesPerChunk = 256;

int levels_for(std::size_t points) noexcept {
  int levels = 0;
  while (levels < kMaxSphereLevels && (points >> levels) > kPointsPerSphere) ++levels;
  return levels;
}

}  // namespace

std::size_t SphereTree::bytes_for(std::size_t points) noexcept {
  return ((std::size_t{2} << levels_for(points)) - 1) * sizeof(Sphere);
}

void SphereTree::build(std::span<const surface::OrientedPoint> points, int threads) {
  points_ = points;
  levels_ = levels_for(points.size());
  spheres_.resize((std::size_t{2} << levels_) - 1);
  for (int level = 0; level <= levels_; ++level) {
    parallel_each(std::size_t{1} << level, kNodesPerChunk, threads, [&](std::size_t number) {
      const Node node{level, static_cast<std::uint32_t>(number)};
      geometry::Aabb box;
      for (std::uint32_t place = begin(node); place < end(node); ++place) box.add(points[place].at());
      const Vec3f middle = box.centre_mm().cast<float>();
      Sphere sphere{middle.x(), middle.y(), middle.z(), 0.0f};
      double most_sq = 0.0;
      for (std::uint32_t place = begin(node); place < end(node); ++place)
        most_sq = std::max(most_sq, (points[place].at() - sphere.at()).squaredNorm());
      sphere.radius =
          std::nextafter(static_cast<float>(std::sqrt(most_sq)), std::numeric_limits<float>::infinity());
      spheres_[index(node)] = sphere;
    });
  }
}

std::uint32_t SphereTree::nearest(const Vec3& at, double most_mm) const noexcept {
  if (points_.empty()) return kNoPlace;
  // A sphere holds nothing nearer than best if its centre is further than radius + best; in squares.
  struct Waiting {
    Node node;
    double centre_sq, radius;
  };
  const auto seen = [&](const Node& node) {
    const Sphere& sphere = spheres_[index(node)];
    return Waiting{node, (sphere.at() - at).squaredNorm(), static_cast<double>(sphere.radius)};
  };
  std::array<Waiting, kMaxSphereLevels + 1> stack;
  std::size_t waiting = 0;
  std::uint32_t best = kNoPlace;
  double best_mm = most_mm, best_sq = most_mm * most_mm;
  stack[waiting++] = seen({0, 0});
  while (waiting > 0) {
    const Waiting next = stack[--waiting];
    const double reach = next.radius + best_mm;
    if (next.centre_sq > reach * reach) continue;
    if (next.node.level < levels_) {
      Waiting near = seen({next.node.level + 1, 2 * next.node.number});
      Waiting far = seen({next.node.level + 1, 2 * next.node.number + 1});
      if (far.centre_sq < near.centre_sq) std::swap(near, far);
      stack[waiting++] = far;
      stack[waiting++] = near;
      continue;
    }
    for (std::uint32_t place = begin(next.node); place < end(next.node); ++place) {
      const double sq = (points_[place].at() - at).squaredNorm();
      if (sq > best_sq || (sq == best_sq && place > best)) continue;
      best_sq = sq;
      best_mm = std::sqrt(sq) * (1.0 + gamma(4));  // never below the root
      best = place;
    }
  }
  return best;
}

}  // namespace palpate::baselines
