// Axis-aligned boxes.
//
// First:
//   palpate::geometry::Aabb box;
//   for (std::size_t i = 0; i < cloud.size(); ++i) box.add(cloud.point_mm(i));
//   const Vec3 above_mm = box.centre_mm() + Vec3(0.0, 0.0, box.extent_mm().z());
#pragma once

#include <algorithm>
#include <limits>

#include <palpate/vec.h>

namespace palpate::geometry {

/// The closed box [low, high] per axis, mm. Empty until something is added (low > high).
struct Aabb {
  Vec3 low_mm = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 high_mm = Vec3::Constant(-std::numeric_limits<double>::infinity());

  [[nodiscard]] bool empty() const noexcept { return !(low_mm.x() <= high_mm.x()); }
  void add(const Vec3& p) noexcept {
    low_mm = low_mm.cwiseMin(p);
    high_mm = high_mm.cwiseMax(p);
  }
  void add(const Aabb& other) noexcept {
    low_mm = low_mm.cwiseMin(other.low_mm);
    high_mm = high_mm.cwiseMax(other.high_mm);
  }
  [[nodiscard]] Vec3 extent_mm() const noexcept { return empty() ? Vec3::Zero() : Vec3(high_mm - low_mm); }
  [[nodiscard]] Vec3 centre_mm() const noexcept {
    return empty() ? Vec3::Zero() : Vec3(0.5 * (low_mm + high_mm));
  }
  [[nodiscard]] bool contains(const Vec3& p) const noexcept {
    return (p.array() >= low_mm.array()).all() && (p.array() <= high_mm.array()).all();
  }
  /// Boxes that only touch overlap; an empty box overlaps nothing.
  [[nodiscard]] bool overlaps(const Aabb& other) const noexcept {
    return !empty() && !other.empty() && (low_mm.array() <= other.high_mm.array()).all() &&
           (other.low_mm.array() <= high_mm.array()).all();
  }
  /// Squared distance of a point to the box, 0 inside; infinite for an empty box.
  [[nodiscard]] double distance_sq_mm2(const Vec3& p) const noexcept {
    return (low_mm - p).cwiseMax(p - high_mm).cwiseMax(0.0).squaredNorm();
  }
  [[nodiscard]] Aabb grown(double by_mm) const noexcept {
    return {low_mm - Vec3::Constant(by_mm), high_mm + Vec3::Constant(by_mm)};
  }
};

}  // namespace palpate::geometry
