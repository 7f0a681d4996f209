// A bounding sphere hierarchy over points: the swept-sphere volumes of the thesis's [52] for points.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>

#include "baselines/points/point_grid.h"

namespace palpate::baselines {

/// Most points of a leaf.
inline constexpr std::uint32_t kPointsPerSphere = 8;
/// Most levels: halving 2^32 points.
inline constexpr int kMaxSphereLevels = 32;

/// Over points in an order of near neighbours (a grid's). Ranges halve per level, so nodes need no links:
/// node i of level d covers the places [n i / 2^d, n (i + 1) / 2^d). 16 bytes a node, some 4 a point. The
/// points' local coordinates, mm. Immutable; thread-safe to read.
class SphereTree {
 public:
  /// Keeps a view of `points`. O(n log n), parallel; independent of the number of threads.
  void build(std::span<const surface::OrientedPoint> points, int threads);

  /// The nearest place to `at` within `most_mm`, ties by place; else kNoPlace. Allocates nothing. O(log n)
  /// near the points.
  [[nodiscard]] std::uint32_t nearest(const Vec3& at, double most_mm) const noexcept;

  /// Calls visit(place, distance_sq) for every point within `radius_mm` of `at`, in place order.
  template <class Visit>
  void within(const Vec3& at, double radius_mm, Visit&& visit) const noexcept {
    if (points_.empty()) return;
    const double most_sq = radius_mm * radius_mm;
    std::array<Node, kMaxSphereLevels + 1> stack;  // one node waits on each level
    std::size_t waiting = 0;
    stack[waiting++] = {0, 0};
    while (waiting > 0) {
      const Node node = stack[--waiting];
      const Sphere& sphere = spheres_[index(node)];
      const double reach = radius_mm + static_cast<double>(sphere.radius);
      if ((sphere.at() - at).squaredNorm() > reach * reach) continue;
      if (node.level < levels_) {
        stack[waiting++] = {node.level + 1, 2 * node.number + 1};
        stack[waiting++] = {node.level + 1, 2 * node.number};
        continue;
      }
      for (std::uint32_t place = begin(node); place < end(node); ++place) {
        const double sq = (points_[place].at() - at).squaredNorm();
        if (sq <= most_sq) visit(place, sq);
      }
    }
  }
  [[nodiscard]] int levels() const noexcept { return levels_; }
  /// The value of bytes(), before building.
  [[nodiscard]] static std::size_t bytes_for(std::size_t points) noexcept;
  [[nodiscard]] std::size_t bytes() const noexcept { return spheres_.capacity() * sizeof(Sphere); }

 private:
  struct Sphere {
    float x, y, z, radius;  ///< the radius rounded up
    [[nodiscard]] Vec3 at() const noexcept {
      return {static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)};
    }
  };
  struct Node {
    int level = 0;
    std::uint32_t number = 0;
  };
  [[nodiscard]] static std::size_t index(const Node& node) noexcept {
    return (std::size_t{1} << node.level) - 1 + node.number;
  }
  [[nodiscard]] std::uint32_t begin(const Node& node) const noexcept {
    return static_cast<std::uint32_t>((points_.size() * std::uint64_t{node.number}) >> node.level);
  }
  [[nodiscard]] std::uint32_t end(const Node& node) const noexcept {
    return static_cast<std::uint32_t>((points_.size() * (std::uint64_t{node.number} + 1)) >> node.level);
  }

  std::span<const surface::OrientedPoint> points_;
  LargePageVector<Sphere> spheres_;
  int levels_ = 0;  ///< the leaves' level
};

}  // namespace palpate::baselines
