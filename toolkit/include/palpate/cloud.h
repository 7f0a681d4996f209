// The point store.
//
// First:
//   const std::vector<Vec3> points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
//   auto built = palpate::cloud::build_cloud(points, palpate::cloud::NonFinite::kDrop);
//   if (!built) return failed(built.error());
//   scene.models[0].cloud = std::make_shared<const palpate::cloud::Cloud>(*std::move(built));
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::cloud {

enum class ScanOrder : std::uint8_t {
  kRaster,         ///< each row runs from its first column to its last
  kBoustrophedon,  ///< rows alternate in direction
};

/// The order in which a scanner delivered the points: row after row of `columns` points. Only for clouds
/// without holes.
struct ScanRaster {
  std::uint32_t columns = 0;
  std::uint32_t rows = 0;
  ScanOrder order = ScanOrder::kRaster;
  /// Wrap-around of turntable scans: the first column (row) is next to the last. Needs at least three.
  bool columns_wrap = false;
  bool rows_wrap = false;

  /// The index of the point at (row, column).
  [[nodiscard]] std::size_t index(std::size_t row, std::size_t column) const noexcept {
    const bool back = order == ScanOrder::kBoustrophedon && row % 2 == 1;
    return row * columns + (back ? columns - 1 - column : column);
  }
  /// The column of the point at `index`; its row is index / columns.
  [[nodiscard]] std::size_t column(std::size_t index) const noexcept {
    return this->index(index / columns, index % columns) % columns;  // reversing a row twice changes nothing
  }
};

/// One optional value per point, by the file's name for it (friction, confidence, ...).
struct Property {
  std::string name;
  std::vector<float> values;
};

/// Points in mm, model frame: a structure of arrays of floats relative to a double local origin (the middle
/// of the box). Rounding is at most half an ulp of the half extent, extent x 2^-25 per axis, also for far
/// clouds. Owns its arrays; not changed after building, so many threads may read it.
struct Cloud {
  Vec3 origin_mm = Vec3::Zero();
  std::vector<float> x_mm, y_mm, z_mm;  ///< relative to origin_mm; equal lengths
  std::vector<Property> properties;     ///< each as long as the cloud
  std::optional<ScanRaster> raster;     ///< set if the points form a full raster

  [[nodiscard]] std::size_t size() const noexcept { return x_mm.size(); }
  [[nodiscard]] bool empty() const noexcept { return x_mm.empty(); }
  /// Position relative to origin_mm, as stored.
  [[nodiscard]] Vec3 local_mm(std::size_t i) const noexcept {
    return {static_cast<double>(x_mm[i]), static_cast<double>(y_mm[i]), static_cast<double>(z_mm[i])};
  }
  [[nodiscard]] Vec3 point_mm(std::size_t i) const noexcept { return origin_mm + local_mm(i); }
  [[nodiscard]] geometry::Aabb box_mm() const noexcept;
  [[nodiscard]] std::size_t bytes() const noexcept;
};

/// Treatment of points that are not finite.
enum class NonFinite { kRefuse, kDrop };

/// Findings of build_cloud().
struct BuildReport {
  std::size_t non_finite = 0;    ///< points dropped (or refused: the count in the error)
  double max_rounding_mm = 0.0;  ///< largest distance between a given and a stored coordinate
};

/// Builds the store from double coordinates, in the given order. Non-finite points are refused (an Error with
/// count and first index) or dropped. An empty result is an Error. `report` may be null. O(n).
[[nodiscard]] Result<Cloud> build_cloud(std::span<const Vec3> points_mm, NonFinite non_finite,
                                        BuildReport* report = nullptr);

/// A 64-bit hash of everything the cloud holds, independent of its address: a few ms per million points.
[[nodiscard]] std::uint64_t content_hash(const Cloud& cloud) noexcept;

}  // namespace palpate::cloud
