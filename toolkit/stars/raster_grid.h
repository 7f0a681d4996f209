// Internal to stars: who stands at each row and column of a scan.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {

/// A scan's raster, with or without holes. Refers to the cloud that it is of.
class RasterGrid {
 public:
  /// Of the cloud's raster, else of its properties row and column. None where there is neither, where the
  /// raster is a single row or column, is mostly holes, has two points at one position or is of several
  /// scans. O(n).
  static std::optional<RasterGrid> of(const cloud::Cloud& cloud);

  [[nodiscard]] std::uint32_t rows() const noexcept { return rows_; }
  [[nodiscard]] std::uint32_t columns() const noexcept { return columns_; }
  [[nodiscard]] bool rows_wrap() const noexcept { return rows_wrap_; }
  [[nodiscard]] bool columns_wrap() const noexcept { return columns_wrap_; }
  [[nodiscard]] bool is_full() const noexcept { return point_at_.empty(); }
  /// Positions in all; that of (row, column) is row * columns() + column.
  [[nodiscard]] std::size_t slots() const noexcept { return std::size_t{rows_} * columns_; }
  /// The cloud's point there, or kNoPlace.
  [[nodiscard]] std::uint32_t point(std::uint32_t row, std::uint32_t column) const noexcept {
    if (is_full()) return static_cast<std::uint32_t>(full_.index(row, column));
    return point_at_[std::size_t{row} * columns_ + column];
  }
  /// Where the cloud's point stands.
  [[nodiscard]] std::uint32_t slot(std::uint32_t point) const noexcept {
    if (!is_full()) return slot_of_[point];
    const std::uint32_t row = point / columns_;
    return row * columns_ + static_cast<std::uint32_t>(full_.column(point));
  }
  /// The row (column) `by` of -1 or 1 beside it, around the whole turn where it wraps; kNoPlace beyond.
  [[nodiscard]] std::uint32_t row_beside(std::uint32_t row, int by) const noexcept {
    return beside(row, by, rows_, rows_wrap_);
  }
  [[nodiscard]] std::uint32_t column_beside(std::uint32_t column, int by) const noexcept {
    return beside(column, by, columns_, columns_wrap_);
  }

  /// The median of some squared steps to the next row's (1, 0) or column's (0, 1) point.
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
  std::vector<std::uint32_t> point_at_;  ///< by slot; empty of a full raster
  std::vector<std::uint32_t> slot_of_;   ///< by point; empty of a full raster
};

}  // namespace palpate::stars
