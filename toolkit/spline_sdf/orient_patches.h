// Groups patches into connected pieces and orients them outward.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/spline_sdf/fit_patches.h"

namespace palpate::render {

/// By patch: its piece, the least index of that; and what is turned with it if it must be turned.
struct OrientedPieces {
  /// The outer side is known by visibility.
  static constexpr std::uint32_t kOutward = 0xffffffffu;
  std::vector<std::uint32_t> piece;
  std::vector<std::uint32_t> group;  ///< the same number: turned together; a piece is in one group
};

/// True if a surface without an outside must be flipped, so that its parts are oriented alike: along the axis
/// that it faces most.
[[nodiscard]] inline bool looks_down(const Vec3& area) noexcept {
  Eigen::Index axis = 0;
  area.cwiseAbs().maxCoeff(&axis);
  return area[axis] < 0.0;
}

/// Turns the patches' normals outward, and drops outlying pieces. `far`: where `points` are a part, a sample
/// of all for what is far away, kFarReach of its spacings; else null. Smoothly continuing patches form faces.
/// A face's outer side is the one from which more directions escape all points; undecided faces follow those
/// they meet. Independent of the number of threads. O(patches x overlaps).
[[nodiscard]] OrientedPieces orient_outwards(const MortonPoints& points, std::vector<QuadricPatch>& patches,
                                             int threads, const MortonPoints* far = nullptr);

/// Balls along a ray have this radius, in spacings, and meet nearly every sheet on the ray (92 % for random
/// points); they grow by this share of the way.
inline constexpr double kWayRadius = 0.9, kWayWidens = 0.25;
/// Where balls are as large as a sample needs, in its spacings.
inline constexpr double kFarReach = kWayRadius / kWayWidens;

/// Drops unreliable patches that lie off a reliable one where that has points on all sides. Keeps the order;
/// independent of the number of threads. O(patches x overlaps).
void drop_outlier_patches(std::vector<QuadricPatch>& patches, int threads);

}  // namespace palpate::render
