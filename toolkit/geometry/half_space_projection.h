// The nearest point that satisfies several planes: the joint constraint of a god object (Zilles and Salisbury
// 1995).
#pragma once

#include <Eigen/Geometry>  // cross products
#include <algorithm>
#include <array>
#include <bitset>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

#include <palpate/vec.h>

namespace palpate::geometry {

/// The half-space normal . x >= offset; unit normal.
struct HalfSpace {
  Vec3 normal = Vec3::UnitZ();
  double offset = 0.0;
};

/// Up to this many half-spaces all cases are enumerated: at most 3 active of 8 give 92 cases. Beyond it an
/// active-set method is used.
inline constexpr std::size_t kMaxEnumeratedHalfSpaces = 8;
/// Most half-spaces considered.
inline constexpr std::size_t kHalfSpaceLimit = 256;
/// Planes whose normals span less than this share of a unit area or volume (two planes at half a degree)
/// intersect too far away, or nowhere.
inline constexpr double kMinIndependence = 1.0 / 128.0;

struct NearestFeasible {
  Vec3 point = Vec3::Zero();           ///< p + sum of push_i times the normal of plane_i
  std::array<std::size_t, 3> plane{};  ///< active planes, ascending
  std::array<double, 3> push{};        ///< their multipliers, each >= 0
  std::size_t active = 0;
  bool feasible = true;  ///< false: no point satisfies all; the least violated case is returned

  /// Multiplier of plane i; 0 if inactive.
  [[nodiscard]] double multiplier_of(std::size_t i) const noexcept {
    for (std::size_t k = 0; k < active; ++k)
      if (plane[k] == i) return push[k];
    return 0.0;
  }
};

namespace detail {

/// The largest violation of the planes at x.
inline double violation(std::span<const HalfSpace> planes, const Vec3& x) noexcept {
  double worst = 0.0;
  for (const HalfSpace& plane : planes) worst = std::max(worst, plane.offset - plane.normal.dot(x));
  return worst;
}

/// O(n^4): of all cases with up to three active planes, the feasible one nearest to p.
inline NearestFeasible solve_by_enumeration(std::span<const HalfSpace> planes, const Vec3& p, double slack,
                                            double min_independence) noexcept {
  const std::size_t n = planes.size();
  NearestFeasible best;
  best.point = p;
  double best_sq = std::numeric_limits<double>::infinity();
  double best_violation = std::numeric_limits<double>::infinity();
  const auto offer = [&](std::span<const std::size_t> active, std::span<const double> push) {
    Vec3 x = p;
    for (std::size_t i = 0; i < active.size(); ++i) {
      if (!(push[i] >= 0.0)) return;
      x += push[i] * planes[active[i]].normal;
    }
    const double off = std::max(violation(planes, x) - slack, 0.0);
    const double moved_sq = (x - p).squaredNorm();
    if (off > best_violation || (off == best_violation && !(moved_sq < best_sq))) return;
    best_violation = off;
    best_sq = moved_sq;
    best.point = x;
    best.active = active.size();
    std::copy(active.begin(), active.end(), best.plane.begin());
    std::copy(push.begin(), push.end(), best.push.begin());
    best.feasible = off == 0.0;
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
      if (!(area_sq > min_independence * min_independence)) continue;
      const std::array two{i, j};
      const std::array pushes{(gap(i) - c * gap(j)) / area_sq, (gap(j) - c * gap(i)) / area_sq};
      offer(two, pushes);
      for (std::size_t k = j + 1; k < n; ++k) {
        const Vec3 &a = planes[i].normal, &b = planes[j].normal, &d = planes[k].normal;
        const double volume = a.dot(b.cross(d));
        if (!(std::abs(volume) > min_independence)) continue;
        // The corner, then the multipliers that lead to it.
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

/// Active-set method: adds the most violated plane and solves again until none is violated. Each solution is
/// farther from p than the last, so none recurs. A plane incompatible with the others is set aside, each at
/// most once.
inline NearestFeasible solve_by_active_set(std::span<const HalfSpace> planes, const Vec3& p, double slack,
                                           double min_independence) noexcept {
  constexpr std::size_t kSet = 4;     // three that hold a point, and one that it violates
  constexpr std::size_t kRounds = 2;  // per plane: added once, set aside once
  NearestFeasible now, best;
  now.point = p;
  double best_violation = std::numeric_limits<double>::infinity();
  std::bitset<kHalfSpaceLimit> aside;
  for (std::size_t round = 0; round < kRounds * planes.size(); ++round) {
    double worst = slack, all = 0.0;
    std::size_t violated = planes.size();
    for (std::size_t i = 0; i < planes.size(); ++i) {
      const double off = planes[i].offset - planes[i].normal.dot(now.point);
      all = std::max(all, off - slack);
      if (!(off > worst) || aside[i]) continue;
      worst = off;
      violated = i;
    }
    if (all < best_violation) {
      best_violation = all;
      best = now;
      best.feasible = all == 0.0;
    }
    if (violated == planes.size()) break;
    std::array<HalfSpace, kSet> tried;
    std::array<std::size_t, kSet> index{};
    std::size_t count = 0;
    const auto take = [&](std::size_t plane) {
      index[count] = plane;
      tried[count++] = planes[plane];
    };
    bool taken = false;
    for (std::size_t i = 0; i < now.active; ++i) {  // in the order of their numbers
      if (!taken && violated < now.plane[i]) {
        take(violated);
        taken = true;
      }
      take(now.plane[i]);
    }
    if (!taken) take(violated);
    now = solve_by_enumeration(std::span(tried).first(count), p, slack, min_independence);
    if (!now.feasible)
      for (std::size_t i = 0; i < count; ++i)
        aside[index[i]] = aside[index[i]] || tried[i].offset - tried[i].normal.dot(now.point) > slack;
    for (std::size_t i = 0; i < now.active; ++i) now.plane[i] = index[now.plane[i]];
  }
  return best;
}

}  // namespace detail

/// The nearest point to p that satisfies all planes, exact up to rounding. O(n^4) for up to
/// kMaxEnumeratedHalfSpaces planes; beyond, O(n) a round and at most 2 n rounds, usually a handful. Planes
/// beyond kHalfSpaceLimit are ignored. `slack`: violation allowed for rounding, in the planes' units.
/// `min_independence`: planes that span less are only solved for singly. Allocates nothing.
[[nodiscard]] inline NearestFeasible nearest_feasible(std::span<const HalfSpace> all, const Vec3& p,
                                                      double slack,
                                                      double min_independence = kMinIndependence) noexcept {
  const std::span<const HalfSpace> planes = all.first(std::min(all.size(), kHalfSpaceLimit));
  if (planes.size() <= kMaxEnumeratedHalfSpaces)
    return detail::solve_by_enumeration(planes, p, slack, min_independence);
  return detail::solve_by_active_set(planes, p, slack, min_independence);
}

}  // namespace palpate::geometry
