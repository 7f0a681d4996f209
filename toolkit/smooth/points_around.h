// Whether a place of the surface lies between points, or beyond where they end.
#pragma once

#include <array>
#include <vector>

#include "toolkit/smooth/smooth_points.h"

namespace palpate::render {

/// Scratch that is used again from cube to cube. Belongs to one thread.
class PointsAround {
 public:
  /// The points that may tell of places within `reach_mm` of the middle of a cube whose patches' points are
  /// `spacing` apart, mm.
  void gather(const SmoothPoints& points, const Vec3& middle, double reach_mm, double spacing);
  /// Of a place, from that middle, on a surface of unit normal n. O(points gathered), mostly four.
  [[nodiscard]] bool are_around(const Vec3& foot, const Vec3& n) const;

 private:
  /// A point from the middle of the cube, and how far it tells of the surface.
  struct Near {
    Vec3 at;
    double reach_sq;
  };
  std::vector<Near> near_;
  std::size_t count_ = 0;  ///< of them
  /// Their places and reaches in the order in which they are asked, filled up with points that tell nothing.
  std::array<std::vector<double>, 4> lanes_;
};

}  // namespace palpate::render
