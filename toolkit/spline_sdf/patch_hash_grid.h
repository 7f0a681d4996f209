// A spatial hash of patches, one table per scale of support.
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

namespace palpate::render {

/// Patches may continue each other if their centres are within this share of both supports: they overlap.
inline constexpr double kPatchReach = 0.8;
/// Support classes, each twice the last; a patch pairs with others as large and larger.
inline constexpr int kPatchScales = 24;

/// Patches in cells of twice their support. Immutable. O(n log n).
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

}  // namespace palpate::render
