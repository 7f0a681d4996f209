// The cells between rows and columns of a raster, two triangles each, and which of them are doubtful.
// Internal to local_delaunay.
#pragma once

#include <Eigen/Geometry>  // cross products
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <palpate/vec.h>
#include "toolkit/core/large_pages.h"
#include "toolkit/local_delaunay/raster_grid.h"

namespace palpate::local_delaunay {

/// The four positions by row and column: 00, 01 beside it, 10 below it, 11.
struct RasterCell {
  Vec3f area = Vec3f::Zero();  ///< twice its triangles' area, as a vector along columns x rows
  std::uint32_t form = 0;

  static constexpr std::uint32_t kDown = 1;    ///< the diagonal is 00 to 11, else 10 to 01
  static constexpr std::uint32_t kFirst = 2;   ///< has the triangle 00 01 11 (without kDown: 00 01 10)
  static constexpr std::uint32_t kSecond = 4;  ///< has the triangle 00 11 10 (without kDown: 01 11 10)
  static constexpr std::uint32_t kDoubtful = 8;

  [[nodiscard]] bool has(std::uint32_t bit) const noexcept { return (form & bit) != 0; }
};

/// The cell of four positions, some perhaps null: takes the shorter diagonal and omits triangles that lack a
/// corner. Doubtful if folded, jumping or stretched (raster_cells.cpp).
[[nodiscard]] RasterCell raster_cell(const std::array<const Vec3*, 4>& at) noexcept;

/// All cells of a raster; (row, column) is the cell below and beside that position.
struct RasterCells {
  LargePageVector<RasterCell> cell;    ///< by slot
  std::vector<std::uint8_t> doubtful;  ///< by slot, 1: the point's triangles may be wrong

  [[nodiscard]] const RasterCell& at(const RasterGrid& grid, std::uint32_t row,
                                     std::uint32_t column) const noexcept {
    return cell[std::size_t{row} * grid.columns() + column];
  }
};
/// Parallel, O(n); independent of the number of threads.
[[nodiscard]] RasterCells cells_of(const cloud::Cloud& cloud, const RasterGrid& grid, int threads);

/// Marks points in tiles that come near non-adjacent tiles: the scanner saw a place twice, or two sheets.
/// Parallel, O(n) if few do.
void mark_overlaps(const cloud::Cloud& cloud, const RasterGrid& grid, int threads,
                   std::vector<std::uint8_t>& doubtful);

}  // namespace palpate::local_delaunay
