// Which point stands at each row and column of a scan. Internal to local_delaunay.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include <palpate/cloud.h>
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

}  // namespace palpate::local_delaunay
