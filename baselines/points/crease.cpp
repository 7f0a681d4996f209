#include "baselines/points/sheet.h"

#include <Eigen/Geometry>  // cross products

#include <array>
#include <cmath>
#include <cstddef>

#include <palpate/vec.h>
#include "toolkit/search/neighbour_table.h"

namespace palpate::baselines::vertices {
namespace {

/// The nearer of two neighbours within 15 degrees of each other (cos 0.966; the sine is kMinFacetSine) is a
/// corner; a facet between them would be a sliver with a noisy plane.
constexpr double kSameDirectionCosine = 0.966;

/// Neighbours around a point, counter-clockwise from outside: corners of the facets there.
struct TriangleFan {
  std::array<Vec3, search::kNeighbours> corner;  ///< relative to the point
  std::array<double, search::kNeighbours> u, v, square, turn;
  std::size_t size = 0;

  /// Adds a corner unless a nearer one in the same direction was added.
  void take(const Vec3& d, double du, double dv) noexcept {
    const double in_plane = du * du + dv * dv;
    // The place is on the normal line, or the point itself.
    if (!(in_plane > kMinFacetSine * kMinFacetSine * d.squaredNorm())) return;
    for (std::size_t i = 0; i < size; ++i) {
      const double same = u[i] * du + v[i] * dv;
      if (same > 0.0 && same * same > kSameDirectionCosine * kSameDirectionCosine * square[i] * in_plane)
        return;
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
  /// No gap over 165 degrees: a facet fits between successive corners.
  [[nodiscard]] bool closed() const noexcept {
    if (size < 3) return false;
    for (std::size_t i = 0; i < size; ++i) {
      const std::size_t j = i + 1 == size ? 0 : i + 1;
      const double across = u[i] * v[j] - v[i] * u[j];
      if (!(across > 0.0 && across * across > kMinFacetSine * kMinFacetSine * square[i] * square[j]))
        return false;
    }
    return true;
  }
};

/// The fan around a point with outward unit normal `outward`. corner(k): its neighbour k relative to it,
/// nearest first; the point itself if absent. Allocates nothing.
template <class Corner>
TriangleFan triangle_fan(const Vec3& outward, Corner&& corner) noexcept {
  const Vec3 e = outward.unitOrthogonal(), f = outward.cross(e);
  TriangleFan fan;
  for (std::size_t k = 0; k < search::kNeighbours; ++k) {
    const Vec3 d = corner(k);
    fan.take(d, e.dot(d), f.dot(d));
  }
  return fan;
}

/// The vector from r to the nearest place on the fan.
Vec3 pull_to(const TriangleFan& fan, const Vec3& r) noexcept {
  double least = r.squaredNorm();
  Vec3 best = -r;
  std::array<Vec3, search::kNeighbours> aside;  // corner x r
  for (std::size_t i = 0; i < fan.size; ++i) {
    const Vec3& d = fan.corner[i];
    aside[i] = d.cross(r);
    const double along = d.dot(r);
    if (!(along > 0.0)) continue;
    const Vec3 to_line = (along / d.squaredNorm()) * d - r;
    const double square = to_line.squaredNorm();
    if (!(square < least)) continue;
    least = square;
    best = to_line;
  }
  for (std::size_t i = 0; i < fan.size; ++i) {
    const std::size_t j = i + 1 == fan.size ? 0 : i + 1;
    const Vec3 n = fan.corner[i].cross(fan.corner[j]);
    if (!(n.dot(aside[i]) >= 0.0 && n.dot(aside[j]) <= 0.0)) continue;  // the foot is beside the facet
    const double height = n.dot(r), area_sq = n.squaredNorm();
    if (!(height * height < least * area_sq)) continue;
    least = height * height / area_sq;
    best = (-height / area_sq) * n;
  }
  return best;
}

}  // namespace

Vec3 pull_at_crease(const PointModel& model, const WalkResult& end, const Vec3& outward, const Vec3& h,
                    const Vec3& pull) noexcept {
  const Vec3 g = model.points[end.place].at();
  const TriangleFan fan = triangle_fan(
      outward, [&](std::size_t k) { return Vec3(Vec3(end.x_mm[k], end.y_mm[k], end.z_mm[k]) - g); });
  return fan.closed() ? pull_to(fan, h - g) : pull;
}

}  // namespace palpate::baselines::vertices
