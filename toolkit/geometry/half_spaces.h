// The point nearest to another that several planes allow: how contacts constrain a god object jointly
// (Zilles and Salisbury 1995).
#pragma once

#include <Eigen/Geometry>  // cross products
#include <algorithm>
#include <array>
#include <bitset>
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

/// Of so many half spaces every case is tried: 3 active ones out of 8 are 92 cases. Of more, the active ones
/// are found one by one.
inline constexpr std::size_t kMaxHalfSpaces = 8;
/// Half spaces that are looked at, at most.
inline constexpr std::size_t kMostHalfSpaces = 256;
/// Planes whose normals span less than this share of a unit area or volume meet too far away, or nowhere: two
/// planes at half a degree.
inline constexpr double kFlatShare = 1.0 / 128.0;

struct NearestAllowed {
  Vec3 point = Vec3::Zero();           ///< p + the sum of push_i times the normal of plane_i
  std::array<std::size_t, 3> plane{};  ///< the active ones, ascending
  std::array<double, 3> push{};        ///< theirs, each >= 0
  std::size_t active = 0;
  bool all_hold = true;  ///< false: the planes leave no room; the least violated case is returned

  /// What plane i pushes; 0 where it is not active.
  [[nodiscard]] double push_of(std::size_t i) const noexcept {
    for (std::size_t k = 0; k < active; ++k)
      if (plane[k] == i) return push[k];
    return 0.0;
  }
};

namespace detail {

/// How far the worst plane is violated at x.
inline double violation(std::span<const HalfSpace> planes, const Vec3& x) noexcept {
  double worst = 0.0;
  for (const HalfSpace& plane : planes) worst = std::max(worst, plane.offset - plane.normal.dot(x));
  return worst;
}

/// O(n^4): of all cases of up to three active planes the allowed one nearest to p.
inline NearestAllowed nearest_of_all_cases(std::span<const HalfSpace> planes, const Vec3& p, double slack,
                                           double flat_share) noexcept {
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
    const double off = std::max(violation(planes, x) - slack, 0.0);
    const double moved_sq = (x - p).squaredNorm();
    if (off > best_violation || (off == best_violation && !(moved_sq < best_sq))) return;
    best_violation = off;
    best_sq = moved_sq;
    best.point = x;
    best.active = active.size();
    std::copy(active.begin(), active.end(), best.plane.begin());
    std::copy(push.begin(), push.end(), best.push.begin());
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

/// The active planes one by one: with those that hold, the one that their solution violates most is solved
/// for, until none is violated. Each solution is farther from p than the one before, so that none comes back.
/// What cannot hold beside others is set aside, each plane once.
inline NearestAllowed nearest_by_active_set(std::span<const HalfSpace> planes, const Vec3& p, double slack,
                                            double flat_share) noexcept {
  constexpr std::size_t kSet = 4;     // three that hold a point, and one that it violates
  constexpr std::size_t kRounds = 2;  // a plane: taken up, and set aside
  NearestAllowed now, best;
  now.point = p;
  double best_violation = std::numeric_limits<double>::infinity();
  std::bitset<kMostHalfSpaces> aside;
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
      best.all_hold = all == 0.0;
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
    for (std::size_t i = 0; i < now.active; ++i) {  // in order of their numbers
      if (!taken && violated < now.plane[i]) {
        take(violated);
        taken = true;
      }
      take(now.plane[i]);
    }
    if (!taken) take(violated);
    now = nearest_of_all_cases(std::span(tried).first(count), p, slack, flat_share);
    if (!now.all_hold)
      for (std::size_t i = 0; i < count; ++i)
        aside[index[i]] = aside[index[i]] || tried[i].offset - tried[i].normal.dot(now.point) > slack;
    for (std::size_t i = 0; i < now.active; ++i) now.plane[i] = index[now.plane[i]];
  }
  return best;
}

}  // namespace detail

/// The place nearest to p that all planes allow, exact but for rounding. O(n^4) for up to kMaxHalfSpaces
/// planes, O(n) a round and at most 2 n rounds beyond; a handful of rounds is usual. More than
/// kMostHalfSpaces are not looked at. `slack` is the violation that rounding may leave, in the planes' units.
/// `flat_share`: of planes that span less only single ones are solved for. Allocates nothing.
[[nodiscard]] inline NearestAllowed nearest_allowed(std::span<const HalfSpace> all, const Vec3& p,
                                                    double slack, double flat_share = kFlatShare) noexcept {
  const std::span<const HalfSpace> planes = all.first(std::min(all.size(), kMostHalfSpaces));
  if (planes.size() <= kMaxHalfSpaces) return detail::nearest_of_all_cases(planes, p, slack, flat_share);
  return detail::nearest_by_active_set(planes, p, slack, flat_share);
}

}  // namespace palpate::geometry
