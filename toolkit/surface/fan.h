// The facets between a point and its neighbours.
#pragma once

#include <Eigen/Geometry>  // cross products
#include <array>
#include <cmath>
#include <cstddef>

#include "toolkit/core/vec.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::surface {

/// The third corner of a facet stands at least 15 degrees off the line of the other two: sin 15 = 0.26.
inline constexpr double kFacetCosine = 0.26;
/// Of neighbours that lie within 15 degrees of each other as seen from the point the nearer one is a corner
/// of the fan: the facet between them would be a sliver, whose plane noise turns. cos 15 = 0.966; the sine is
/// that of kFacetCosine.
inline constexpr double kSameWayCosine = 0.966;

/// Neighbours around a point, counter-clockwise as seen from outside: corners of the facets that meet there.
struct Fan {
  std::array<Vec3, neighbourhood::kNeighbours> corner;  ///< relative to the point
  std::array<double, neighbourhood::kNeighbours> u, v, square, turn;
  std::size_t size = 0;

  /// Takes a corner unless one that was taken before, which is nearer, lies the same way.
  void take(const Vec3& d, double du, double dv) noexcept {
    const double in_plane = du * du + dv * dv;
    // On the normal line, or the point itself.
    if (!(in_plane > kFacetCosine * kFacetCosine * d.squaredNorm())) return;
    for (std::size_t i = 0; i < size; ++i) {
      const double same = u[i] * du + v[i] * dv;
      if (same > 0.0 && same * same > kSameWayCosine * kSameWayCosine * square[i] * in_plane) return;
    }
    // Grows with the angle, from -2 to 2.
    const double share = dv / (std::abs(du) + std::abs(dv));
    const double at = du >= 0.0 ? share : dv >= 0.0 ? 2.0 - share : -2.0 - share;
    std::size_t i = size++;
    for (; i > 0 && turn[i - 1] > at; --i) {
      corner[i] = corner[i - 1];
      u[i] = u[i - 1];
      v[i] = v[i - 1];
      square[i] = square[i - 1];
      turn[i] = turn[i - 1];
    }
    corner[i] = d;
    u[i] = du;
    v[i] = dv;
    square[i] = in_plane;
    turn[i] = at;
  }
  /// No gap of more than 165 degrees: a facet fits between any two that follow each other.
  [[nodiscard]] bool closed() const noexcept {
    if (size < 3) return false;
    for (std::size_t i = 0; i < size; ++i) {
      const std::size_t j = i + 1 == size ? 0 : i + 1;
      const double across = u[i] * v[j] - v[i] * u[j];
      if (!(across > 0.0 && across * across > kFacetCosine * kFacetCosine * square[i] * square[j]))
        return false;
    }
    return true;
  }
  /// The facets' areas as one vector, twice: along the mean normal of a closed fan, also where the surface is
  /// a spike there, whose points lie nearer to a line than to a plane.
  [[nodiscard]] Vec3 area() const noexcept {
    Vec3 sum = Vec3::Zero();
    for (std::size_t i = 0; i < size; ++i) sum += corner[i].cross(corner[i + 1 == size ? 0 : i + 1]);
    return sum;
  }
};

/// The fan around a point whose surface faces `outward` (unit). corner(k): its neighbour k relative to it,
/// the nearest first; the point itself where there is none. Allocates nothing.
template <class Corner>
[[nodiscard]] Fan fan_of(const Vec3& outward, Corner&& corner) noexcept {
  const Vec3 e = outward.unitOrthogonal(), f = outward.cross(e);
  Fan fan;
  for (std::size_t k = 0; k < neighbourhood::kNeighbours; ++k) {
    const Vec3 d = corner(k);
    fan.take(d, e.dot(d), f.dot(d));
  }
  return fan;
}

}  // namespace palpate::surface
