// Internal to stars: the cells between the rows and columns of a raster, each two triangles, and where they
// are no surface.
#pragma once

#include <Eigen/Geometry>  // cross products
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/core/vec.h"
#include "toolkit/stars/raster_grid.h"

namespace palpate::stars {

/// Between four positions, numbered by row and column: 00, 01 beside it, 10 below it, 11.
struct RasterCell {
  Vec3f area = Vec3f::Zero();  ///< twice that of its triangles, as a vector along columns x rows
  std::uint32_t form = 0;

  static constexpr std::uint32_t kDown = 1;    ///< the diagonal goes from 00 to 11, else from 10 to 01
  static constexpr std::uint32_t kFirst = 2;   ///< it has 00 01 11, or where kDown is not set 00 01 10
  static constexpr std::uint32_t kSecond = 4;  ///< it has 00 11 10, or where kDown is not set 01 11 10
  static constexpr std::uint32_t kDoubtful = 8;

  [[nodiscard]] bool has(std::uint32_t bit) const noexcept { return (form & bit) != 0; }
};

/// The cell of four positions, of which some may be null: with the shorter diagonal, without the triangles
/// that lack a corner. Doubtful where it is folded, jumps or is stretched too far: see raster_cells.cpp.
[[nodiscard]] RasterCell raster_cell(const std::array<const Vec3*, 4>& at) noexcept;

/// All cells of a raster; (row, column) is the one below and beside that position.
struct RasterCells {
  LargeVector<RasterCell> cell;        ///< by slot
  std::vector<std::uint8_t> doubtful;  ///< by slot, 1: the point's triangles may not be the surface's

  [[nodiscard]] const RasterCell& at(const RasterGrid& grid, std::uint32_t row,
                                     std::uint32_t column) const noexcept {
    return cell[std::size_t{row} * grid.columns() + column];
  }
};
/// Parallel, O(n); the same for any number of threads.
[[nodiscard]] RasterCells cells_of(const cloud::Cloud& cloud, const RasterGrid& grid, int threads);

/// Marks the points of tiles of the raster that come near to others that are not next to them: the scanner
/// saw a place twice, or two sheets. Parallel, O(n) where few do.
void mark_overlaps(const cloud::Cloud& cloud, const RasterGrid& grid, int threads,
                   std::vector<std::uint8_t>& doubtful);

}  // namespace palpate::stars
