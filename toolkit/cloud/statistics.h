// Statistics of a cloud that need no neighbours (others: search/neighbour_table.h), its limits, and its
// subsets by point index.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>

namespace palpate::cloud {

/// Most points of a cloud (checked by build_cloud()): twice an index plus one, which piece orientation uses
/// for point and side, fits 32 bits.
inline constexpr std::size_t kMaxCloudPoints = (std::size_t{1} << 31) - 1;
static_assert(2 * (kMaxCloudPoints - 1) + 1 <= std::numeric_limits<std::uint32_t>::max());

struct Statistics {
  std::size_t points = 0;
  geometry::Aabb box_mm;
  /// Section 1.6: points per volume of the tightest axis-aligned box, 1/mm^3; infinite for a flat box.
  double density_per_mm3 = 0.0;
  /// Points minus distinct stored positions.
  std::size_t duplicates = 0;
  /// The raster found in the point order, see find_raster().
  std::optional<ScanRaster> raster;
  bool single_valued = false;  ///< see is_single_valued()
};

/// O(n log n).
[[nodiscard]] Statistics describe(const Cloud& cloud);

[[nodiscard]] std::size_t count_duplicates(const Cloud& cloud);
/// Indices ordered by stored (x, y, z), then by index. O(n log n).
[[nodiscard]] std::vector<std::uint32_t> indices_by_place(const Cloud& cloud);

/// The full scanner raster of the points, if any: rows of equal length (at least 2 x 2), strictly monotone
/// along one axis in every row and along another down every column. Rows run one way, or alternate. Jitter
/// below half a spacing and uneven spacing are allowed; holes are not, and turntable scans, monotone along no
/// axis, are not found. O(n).
[[nodiscard]] std::optional<ScanRaster> find_raster(const Cloud& cloud);

/// True if z is a function of (x, y), on a lattice (cloud/height_field.h) or not. At most 1 % of points may
/// violate each of: no two points with equal x and y differ in z; in plan cells of twice the mean spacing
/// (sqrt of plan area per point) consecutive heights are at most four cell sides apart. False for boxes flat
/// in x or y. O(n log n).
[[nodiscard]] bool is_single_valued(const Cloud& cloud);

/// Largest distance of a stored point from the given one: each coordinate is rounded to half a unit in the
/// last place of the half extent.
[[nodiscard]] double stored_rounding_mm(const Cloud& cloud);

/// Spacing for coincident points: a millionth of the coordinates' size, or 1 mm at the origin, so that they
/// can be touched.
[[nodiscard]] double fallback_spacing_mm(const Cloud& cloud) noexcept;

/// A surface needs a plane: three non-collinear places.
inline constexpr std::size_t kMinDistinctPoints = 3;

/// Why the points are no surface, for the user ("its 1000 points stand in one place; ..."), or nothing. O(n);
/// O(n log n) if they are none.
[[nodiscard]] std::optional<std::string> degeneracy_of(const Cloud& cloud);

/// The values at these indices, in their order; empty for an empty array.
[[nodiscard]] std::vector<float> taken(const std::vector<float>& values, std::span<const std::uint32_t> of);

/// These points in their order, as stored, with properties and without raster. Indices must be valid.
[[nodiscard]] Cloud subset_of(const Cloud& cloud, std::span<const std::uint32_t> of);

/// `count` points chosen uniformly, in their order, without properties and raster; all if there are no more.
/// Deterministic per seed. O(n).
[[nodiscard]] Cloud random_subset(const Cloud& cloud, std::size_t count, std::uint64_t seed);

}  // namespace palpate::cloud
