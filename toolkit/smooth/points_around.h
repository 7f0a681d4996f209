// Whether a place of the surface lies between points, or beyond where they end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/smooth/smooth_points.h"

namespace palpate::render {

/// Scratch that is used again from cube to cube. Belongs to one thread.
class PointsAround {
 public:
  /// Begins with the places within `reach_mm` of the middle of a cube whose patches' points are `spacing`
  /// apart, mm. Keeps a reference.
  void begin(const SmoothPoints& points, const Vec3& middle, double reach_mm, double spacing);
  /// Of a place, from that middle, on a surface of unit normal n. O(points around it), mostly of the nearest.
  [[nodiscard]] bool are_around(const Vec3& foot, const Vec3& n);

 private:
  /// A point from the middle of the cube, and how far it tells of the surface.
  struct Near {
    Vec3 at;
    double reach_sq;
  };
  [[nodiscard]] double reach_sq(std::uint32_t point) const;
  [[nodiscard]] bool nearest_are(const Vec3& foot, const Vec3& n, const Vec3& u, const Vec3& v) const;
  void gather();

  const SmoothPoints* points_ = nullptr;
  Vec3 middle_ = Vec3::Zero();
  double reach_mm_ = 0.0, spacing_ = 0.0;
  std::vector<Near> near_;  ///< of the cube, once a place's nearest ones have not told
  std::size_t count_ = 0;   ///< of them
  bool gathered_ = false;
};

}  // namespace palpate::render
