// The point store.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "toolkit/core/result.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"

namespace palpate::cloud {

enum class ScanOrder : std::uint8_t {
  kRaster,         ///< every row from its first column to its last: the scanner returns after each
  kBoustrophedon,  ///< to and fro: every second row from its last column to its first
};

/// How a scanner delivered the points: row after row of `columns` points. Only for clouds without holes.
struct ScanRaster {
  std::uint32_t columns = 0;
  std::uint32_t rows = 0;
  ScanOrder order = ScanOrder::kRaster;
  /// Of turntables: the first column is next to the last, the first row next to the last. From three on.
  bool columns_wrap = false;
  bool rows_wrap = false;

  /// Of the point at (row, column).
  [[nodiscard]] std::size_t index(std::size_t row, std::size_t column) const noexcept {
    const bool back = order == ScanOrder::kBoustrophedon && row % 2 == 1;
    return row * columns + (back ? columns - 1 - column : column);
  }
  /// The column of the point at `index`; its row is index / columns.
  [[nodiscard]] std::size_t column(std::size_t index) const noexcept {
    return this->index(index / columns, index % columns) %
           columns;  // turning a row round twice changes nothing
  }
};

/// One optional value per point, by name, as the file had it (friction, confidence, ...).
struct Property {
  std::string name;
  std::vector<float> values;
};

/// Points in mm: structure of arrays, float relative to a double local origin (the middle of the box), so
/// that far clouds keep their detail: the rounding error is at most half an ulp of the half extent, extent x
/// 2^-25 per axis. Model frame. Owns its arrays; immutable after building in all but name, safe to read from
/// many threads.
struct Cloud {
  Vec3 origin_mm = Vec3::Zero();
  std::vector<float> x_mm, y_mm, z_mm;  ///< relative to origin_mm; equal lengths
  std::vector<Property> properties;     ///< each as long as the cloud
  std::optional<ScanRaster> raster;     ///< set where the order of points is known to be a full raster

  [[nodiscard]] std::size_t size() const noexcept { return x_mm.size(); }
  [[nodiscard]] bool empty() const noexcept { return x_mm.empty(); }
  /// Relative to origin_mm, exactly as stored.
  [[nodiscard]] Vec3 local_mm(std::size_t i) const noexcept {
    return {static_cast<double>(x_mm[i]), static_cast<double>(y_mm[i]), static_cast<double>(z_mm[i])};
  }
  [[nodiscard]] Vec3 point_mm(std::size_t i) const noexcept { return origin_mm + local_mm(i); }
  [[nodiscard]] geometry::Aabb box_mm() const noexcept;
  [[nodiscard]] std::size_t bytes() const noexcept;
};

/// What to do with points that are not finite.
enum class NonFinite { kRefuse, kDrop };

/// What building a cloud found on the way.
struct BuildReport {
  std::size_t non_finite = 0;    ///< points dropped (or, refused, the count in the error)
  double max_rounding_mm = 0.0;  ///< largest distance between a given and a stored coordinate
};

/// Builds the store from double coordinates. Points that are not finite are refused (an Error with their
/// count and the first index) or dropped. No points left is an Error. The order is kept. `report` may be
/// null. O(n).
[[nodiscard]] Result<Cloud> build_cloud(std::span<const Vec3> points_mm, NonFinite non_finite,
                                        BuildReport* report = nullptr);

/// Tells clouds apart by all that they hold, in memory: a few milliseconds a million points. Two equal ones
/// have one hash wherever they were loaded; of two that differ one in 2^64 pairs would.
[[nodiscard]] std::uint64_t content_hash(const Cloud& cloud) noexcept;

}  // namespace palpate::cloud
