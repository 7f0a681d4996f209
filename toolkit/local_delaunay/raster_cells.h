// Points of a scan by row and column, with cells. A cell has two triangles; some are doubtful. Internal to
// local_delaunay.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/vec.h>
#include <Eigen/Geometry>  // cross products
#include "toolkit/core/hardware.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"

namespace palpate::local_delaunay {

/// A scan's raster, with or without holes. Refers to its cloud.
class RasterGrid {
 public:
  /// From the cloud's raster, else from its properties row and column. None if absent, a single row or
  /// column, mostly holes, doubly occupied, or of several scans. O(n).
  static std::optional<RasterGrid> of(const cloud::Cloud& cloud);

  [[nodiscard]] std::uint32_t rows() const noexcept { return rows_; }
  [[nodiscard]] std::uint32_t columns() const noexcept { return columns_; }
  [[nodiscard]] bool rows_wrap() const noexcept { return rows_wrap_; }
  [[nodiscard]] bool columns_wrap() const noexcept { return columns_wrap_; }
  [[nodiscard]] bool is_full() const noexcept { return point_at_.empty(); }
  /// Number of positions; the slot of (row, column) is row * columns() + column.
  [[nodiscard]] std::size_t slots() const noexcept { return std::size_t{rows_} * columns_; }
  /// The cloud's point there, or kNoPlace.
  [[nodiscard]] std::uint32_t point(std::uint32_t row, std::uint32_t column) const noexcept {
    if (is_full()) return static_cast<std::uint32_t>(full_.index(row, column));
    return point_at_[std::size_t{row} * columns_ + column];
  }
  /// The slot of the cloud's point.
  [[nodiscard]] std::uint32_t slot(std::uint32_t point) const noexcept {
    if (!is_full()) return slot_of_[point];
    const std::uint32_t row = point / columns_;
    return row * columns_ + static_cast<std::uint32_t>(full_.column(point));
  }
  /// The adjacent row (column), `by` = -1 or 1, with wrap-around; kNoPlace beyond the border.
  [[nodiscard]] std::uint32_t row_beside(std::uint32_t row, int by) const noexcept {
    return beside(row, by, rows_, rows_wrap_);
  }
  [[nodiscard]] std::uint32_t column_beside(std::uint32_t column, int by) const noexcept {
    return beside(column, by, columns_, columns_wrap_);
  }

  /// The median of sampled squared steps to the next row (1, 0) or column (0, 1).
  [[nodiscard]] double typical_step_sq(const cloud::Cloud& cloud, int down, int across) const;

 private:
  static std::uint32_t beside(std::uint32_t at, int by, std::uint32_t count, bool wraps) noexcept {
    if (by < 0) return at > 0 ? at - 1 : wraps ? count - 1 : kNoPlace;
    return at + 1 < count ? at + 1 : wraps ? 0 : kNoPlace;
  }
  bool read_positions(const cloud::Cloud& cloud);

  std::uint32_t rows_ = 0, columns_ = 0;
  bool rows_wrap_ = false, columns_wrap_ = false;
  cloud::ScanRaster full_;
  std::vector<std::uint32_t> point_at_;  ///< by slot; empty for a full raster
  std::vector<std::uint32_t> slot_of_;   ///< by point; empty for a full raster
};

// The cells between rows and columns of a raster, two triangles each, and which of them are doubtful.
// Internal to local_delaunay.

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
