// Planes fitted to the points around a place: what path generators know of a surface that has neither a
// formula nor faces. Internal to trace.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/aabb.h"

namespace palpate::trace {

/// Fewer points do not make a surface that a path could follow.
inline constexpr std::size_t kFewestInBall = 16;
/// A fit reads at most this many points, so that a clump of duplicates cannot make a frame slow.
inline constexpr std::size_t kMostFitted = 4096;
/// Bits of a cell coordinate in a 64-bit key of three.
inline constexpr std::uint64_t kCellBits = 21;

/// Points sorted by the cell of a cubic grid.
class PointGrid {
 public:
  PointGrid(const cloud::Cloud& cloud, const geometry::Aabb& box, double cell_mm)
      : cloud_(cloud), low_(box.low_mm - cloud.origin_mm), cell_mm_(cell_mm) {
    items_.resize(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const auto c = cell_of(cloud.local_mm(i));
      items_[i] = {key(c[0], c[1], c[2]), static_cast<std::uint32_t>(i)};
    }
    std::sort(items_.begin(), items_.end());
  }

  /// Calls visit(local point) for at most kMostFitted points of the 27 cells around `p` (relative to the
  /// origin).
  template <class Visit>
  void around(const Vec3& p, const Visit& visit) const {
    const auto c = cell_of(p);
    std::size_t left = kMostFitted;
    for (std::int64_t k = c[2] - 1; k <= c[2] + 1; ++k)
      for (std::int64_t j = c[1] - 1; j <= c[1] + 1; ++j) {
        if (k < 0 || j < 0) continue;
        // Three cells in a row have keys in a row.
        const std::uint64_t first = key(std::max<std::int64_t>(c[0] - 1, 0), j, k),
                            last = key(c[0] + 1, j, k);
        auto it = std::lower_bound(items_.begin(), items_.end(), std::pair(first, std::uint32_t{0}));
        for (; it != items_.end() && it->first <= last && left > 0; ++it, --left)
          visit(cloud_.local_mm(it->second));
      }
  }

 private:
  [[nodiscard]] std::array<std::int64_t, 3> cell_of(const Vec3& p) const {
    constexpr double kLast = static_cast<double>((1u << kCellBits) - 2);
    std::array<std::int64_t, 3> c{};
    for (int axis = 0; axis < 3; ++axis)
      c[static_cast<std::size_t>(axis)] =
          static_cast<std::int64_t>(std::clamp((p[axis] - low_[axis]) / cell_mm_, 0.0, kLast));
    return c;
  }
  static std::uint64_t key(std::int64_t i, std::int64_t j, std::int64_t k) {
    return (static_cast<std::uint64_t>(k) << (2 * kCellBits)) | (static_cast<std::uint64_t>(j) << kCellBits) |
           static_cast<std::uint64_t>(i);
  }
  const cloud::Cloud& cloud_;
  Vec3 low_;
  double cell_mm_;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> items_;
};

/// A plane fitted around a point.
struct Fit {
  bool good = false;
  Vec3 normal = Vec3::UnitZ();
  double height = 0.0;  ///< of the plane above the point, along the normal
};

/// The plane through the points within `radius` of `p` (relative to the cloud's origin), weights falling
/// smoothly to zero; its normal on the side of `side`. Not good where the points end.
[[nodiscard]] Fit fit_plane(const PointGrid& grid, const Vec3& p, double radius, const Vec3& side);

/// Radius of the fits, with the grid of that cell size.
struct Fitting {
  double radius_mm = 0.0;
  std::unique_ptr<PointGrid> grid;
};

/// A radius at which the median ball holds 16 to 64 points, as near as uneven clouds allow. O(n log n).
[[nodiscard]] Result<Fitting> choose_radius(const cloud::Cloud& cloud, const geometry::Aabb& box);

}  // namespace palpate::trace
