// What can be said about a cloud without its neighbours. (What needs them: neighbourhood/spacing.h.)
#pragma once

#include <cstdint>
#include <optional>

#include "toolkit/cloud/cloud.h"

namespace palpate::cloud {

struct Statistics {
  std::size_t points = 0;
  geometry::Aabb box_mm;
  /// Section 1.6: points per volume of the tightest axis-aligned box, 1/mm^3; infinite for a flat box.
  double density_per_mm3 = 0.0;
  /// Points minus distinct stored positions.
  std::size_t duplicates = 0;
  /// The raster that the order of points shows, see find_raster().
  std::optional<ScanRaster> raster;
  bool single_valued = false;  ///< see is_single_valued()
};

/// O(n log n).
[[nodiscard]] Statistics describe(const Cloud& cloud);

[[nodiscard]] std::size_t count_duplicates(const Cloud& cloud);

/// The full raster of a scanner that the points stand in, if they do: rows of equal length (at least 2 x 2),
/// along one axis strictly monotone within every row, along another strictly monotone down every column.
/// Either the rows all run one way and turn back at their ends, or every second one runs back. Jitter below
/// half a spacing and uneven spacing pass; scans with holes do not. What goes round a turntable is monotone
/// along no axis and is not recognised. O(n).
[[nodiscard]] std::optional<ScanRaster> find_raster(const Cloud& cloud);

/// Whether z is a function of (x, y), on a lattice (cloud/height_field.h) or not. Two conditions, each may
/// fail for at most 1 % of the points: no two points share x and y and differ in z; and in plan-view cells of
/// twice the mean plan spacing (the root of the box's plan area over the number of points) consecutive
/// heights are at most four cell sides apart. Clouds whose box is flat in x or y are none. O(n log n).
[[nodiscard]] bool is_single_valued(const Cloud& cloud);

/// How far a stored point may be from the one it was given as: each coordinate is rounded to half a unit in
/// the last place of the half extent.
[[nodiscard]] double stored_rounding_mm(const Cloud& cloud);

/// A cloud whose points all coincide has no spacing: it gets a millionth of the coordinates' size, or 1 mm at
/// the origin, so that it is still there to be touched.
[[nodiscard]] double stand_in_spacing_mm(const Cloud& cloud) noexcept;

}  // namespace palpate::cloud
