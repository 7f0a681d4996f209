// Groups patches into connected pieces and orients them outward.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "toolkit/search/morton_order.h"
#include "toolkit/spline_sdf/fit_patches.h"

namespace palpate::spline_sdf {

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

/// Drops unreliable patches that lie off a reliable one where that has points on all sides. `part`: the
/// points where these are a part of all; else null. Keeps the order; independent of the number of threads.
/// O(patches x overlaps).
void drop_outlier_patches(std::vector<QuadricPatch>& patches, int threads,
                          const MortonPoints* part = nullptr);

/// Patches may continue each other if their centres are within this share of both supports: they overlap.
inline constexpr double kPatchReach = 0.8;
/// Support classes, each twice the last; a patch pairs with others as large and larger.
inline constexpr int kPatchScales = 24;

/// A spatial hash of patches, one table per scale of support, in cells of twice the support. Immutable.
/// O(n log n).
class PatchHashGrid {
 public:
  explicit PatchHashGrid(std::span<const QuadricPatch> patches) {
    for (const QuadricPatch& p : patches) {
      least_ = least_ > 0.0 ? std::min(least_, p.support) : p.support;
      low_ = low_.cwiseMin(p.quadric.at);
    }
    sort(patches);
  }
  /// Visits patches in the same order as a grid of more of them does, if both begin at `low` and `least`.
  PatchHashGrid(std::span<const QuadricPatch> patches, const Vec3& low, double least)
      : least_(least), low_(low) {
    sort(patches);
  }
  [[nodiscard]] int scale_of(double support) const {
    return std::clamp(std::ilogb(support / least_), 0, kPatchScales - 1);
  }
  /// Patches of the scale whose centres may be in reach of a patch of the same or a smaller scale.
  template <class Visit>
  void near(const Vec3& at, int s, Visit&& visit) const {
    const Scale& scale = scales_[static_cast<std::size_t>(s)];
    if (scale.keys.empty()) return;
    const std::array<std::int64_t, 3> c = cell(at, s);
    std::array<std::int64_t, 3> low = c, high = c;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::max<std::int64_t>(c[axis] - 1, 0);
      high[axis] = c[axis] + 1;
    }
    search::visit_codes(low, high, [&](std::uint64_t code) {
      const std::uint32_t found = scale.table.find(code);
      if (found == search::MortonCellTable::kNone) return;
      for (std::uint32_t i = scale.begin[found]; i < scale.begin[found + 1]; ++i) visit(scale.keys[i].second);
    });
  }
  [[nodiscard]] bool any(int s) const { return !scales_[static_cast<std::size_t>(s)].keys.empty(); }

 private:
  struct Scale {
    std::vector<std::pair<std::uint64_t, std::uint32_t>> keys;
    std::vector<std::uint32_t> begin;
    search::MortonCellTable table;
  };
  void sort(std::span<const QuadricPatch> patches) {
    for (std::uint32_t i = 0; i < patches.size(); ++i) {
      const int s = scale_of(patches[i].support);
      scales_[static_cast<std::size_t>(s)].keys.push_back({code(patches[i].quadric.at, s), i});
    }
    for (Scale& scale : scales_) {
      std::sort(scale.keys.begin(), scale.keys.end());
      std::vector<std::uint64_t> cells;
      for (std::uint32_t i = 0; i < scale.keys.size(); ++i) {
        if (!cells.empty() && cells.back() == scale.keys[i].first) continue;
        cells.push_back(scale.keys[i].first);
        scale.begin.push_back(i);
      }
      scale.begin.push_back(static_cast<std::uint32_t>(scale.keys.size()));
      scale.table.build(cells);
    }
  }
  [[nodiscard]] std::array<std::int64_t, 3> cell(const Vec3& at, int s) const {
    // Two patches of supports below 2^(s+1) are at most 2 x kPatchReach x 2^(s+1) apart.
    const double per = 1.0 / (2.0 * kPatchReach * std::ldexp(least_, s + 1));
    const Vec3 c = (at - low_) * per;
    return {static_cast<std::int64_t>(c.x()), static_cast<std::int64_t>(c.y()),
            static_cast<std::int64_t>(c.z())};
  }
  [[nodiscard]] std::uint64_t code(const Vec3& at, int s) const {
    const std::array<std::int64_t, 3> c = cell(at, s);
    return search::morton_code(static_cast<std::uint32_t>(c[0]), static_cast<std::uint32_t>(c[1]),
                               static_cast<std::uint32_t>(c[2]));
  }

  double least_ = 0.0;
  Vec3 low_ = Vec3::Constant(std::numeric_limits<double>::infinity());
  std::array<Scale, kPatchScales> scales_;
};

}  // namespace palpate::spline_sdf
