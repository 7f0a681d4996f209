// The point nearest to another that several planes allow: how contacts constrain a god object jointly
// (Zilles and Salisbury 1995).
#pragma once

#include <Eigen/Geometry>  // cross products
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

#include "toolkit/core/vec.h"

namespace palpate::geometry {

/// The half space normal . x >= offset; normal unit.
struct HalfSpace {
  Vec3 normal = Vec3::UnitZ();
  double offset = 0.0;
};

/// Half spaces that are solved jointly: 3 active ones out of 8 are 92 cases.
inline constexpr std::size_t kMaxHalfSpaces = 8;
/// Planes whose normals span less than this share of a unit area or volume meet too far away, or nowhere: two
/// planes at half a degree.
inline constexpr double kFlatShare = 1.0 / 128.0;

struct NearestAllowed {
  Vec3 point = Vec3::Zero();
  std::array<double, kMaxHalfSpaces> push{};  ///< point = p + sum of push_i normal_i, each push_i >= 0
  bool all_hold = true;  ///< false: the planes leave no room; the least violated case is returned
};

namespace detail {

/// How far the worst plane is violated at x.
inline double violation(std::span<const HalfSpace> planes, const Vec3& x) noexcept {
  double worst = 0.0;
  for (const HalfSpace& plane : planes) worst = std::max(worst, plane.offset - plane.normal.dot(x));
  return worst;
}

}  // namespace detail

/// O(n^3), n = planes.size() <= kMaxHalfSpaces (more are not looked at). Exact but for rounding: of all cases
/// of up to three active planes the allowed one nearest to p. `slack` is the violation that rounding may
/// leave, in the planes' units. `flat_share`: of planes that span less only single ones are solved for.
/// Allocates nothing.
[[nodiscard]] inline NearestAllowed nearest_allowed(std::span<const HalfSpace> all, const Vec3& p,
                                                    double slack, double flat_share = kFlatShare) noexcept {
  const std::span<const HalfSpace> planes = all.first(std::min(all.size(), kMaxHalfSpaces));
  const std::size_t n = planes.size();
  NearestAllowed best;
  best.point = p;
  double best_sq = std::numeric_limits<double>::infinity();
  double best_violation = std::numeric_limits<double>::infinity();
  const auto offer = [&](std::span<const std::size_t> active, std::span<const double> push) {
    Vec3 x = p;
    for (std::size_t i = 0; i < active.size(); ++i) {
      if (!(push[i] >= 0.0)) return;
      x += push[i] * planes[active[i]].normal;
    }
    const double off = std::max(detail::violation(planes, x) - slack, 0.0);
    const double moved_sq = (x - p).squaredNorm();
    if (off > best_violation || (off == best_violation && !(moved_sq < best_sq))) return;
    best_violation = off;
    best_sq = moved_sq;
    best.point = x;
    best.push.fill(0.0);
    for (std::size_t i = 0; i < active.size(); ++i) best.push[active[i]] = push[i];
    best.all_hold = off == 0.0;
  };
  const auto gap = [&](std::size_t i) { return planes[i].offset - planes[i].normal.dot(p); };
  offer({}, {});
  for (std::size_t i = 0; i < n; ++i) {
    const std::array at{i};
    const std::array push{gap(i)};
    offer(at, push);
    for (std::size_t j = i + 1; j < n; ++j) {
      const double c = planes[i].normal.dot(planes[j].normal);
      const double area_sq = 1.0 - c * c;
      if (!(area_sq > flat_share * flat_share)) continue;
      const std::array two{i, j};
      const std::array pushes{(gap(i) - c * gap(j)) / area_sq, (gap(j) - c * gap(i)) / area_sq};
      offer(two, pushes);
      for (std::size_t k = j + 1; k < n; ++k) {
        const Vec3 &a = planes[i].normal, &b = planes[j].normal, &d = planes[k].normal;
        const double volume = a.dot(b.cross(d));
        if (!(std::abs(volume) > flat_share)) continue;
        // The corner, then the pushes that lead to it.
        const Vec3 way = (gap(i) * b.cross(d) + gap(j) * d.cross(a) + gap(k) * a.cross(b)) / volume;
        const std::array three{i, j, k};
        const std::array corner{way.dot(b.cross(d)) / volume, way.dot(d.cross(a)) / volume,
                                way.dot(a.cross(b)) / volume};
        offer(three, corner);
      }
    }
  }
  return best;
}

}  // namespace palpate::geometry
