// Where a segment is within a sphere about the origin.
#pragma once

#include <cmath>
#include <optional>
#include <utility>

#include "toolkit/core/vec.h"

namespace palpate::geometry {

/// The parameters at which a -> a + d is within the sphere of this radius about the origin, or none; at least
/// one of them within [0, 1], or one on either side.
[[nodiscard]] inline std::optional<std::pair<double, double>> within_sphere(const Vec3& a, const Vec3& d,
                                                                            double radius) noexcept {
  const double dd = d.squaredNorm();
  if (!(dd > 0.0)) return std::nullopt;
  const double nearest = -a.dot(d) / dd;
  // From the point nearest to the centre, not from a: no cancellation for far starts.
  const double miss_sq = (a + nearest * d).squaredNorm();
  const double half_sq = (radius * radius - miss_sq) / dd;
  if (half_sq < 0.0) return std::nullopt;
  const double half = std::sqrt(half_sq);
  if (nearest + half < 0.0 || nearest - half > 1.0) return std::nullopt;
  return std::pair{nearest - half, nearest + half};
}

}  // namespace palpate::geometry
