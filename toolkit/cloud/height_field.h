// A regular grid of heights (chapter 4): a point cloud that does not overlap itself seen from above.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include <palpate/cloud.h>
#include <palpate/result.h>
#include "toolkit/core/large_pages.h"

namespace palpate::cloud {

/// Posts on a plan lattice in rows of increasing y, x increasing in a row: post (column, row) is at origin_mm
/// + (column * step_x_mm, row * step_y_mm, height), model frame. A NaN height is a hole. 4 bytes a post and
/// 1/64 byte for block maxima. Owns its arrays; not changed after building, thread-safe to read.
struct HeightField {
  /// Cells along each side of a block with one maximum.
  static constexpr std::uint32_t kBlock = 16;

  Vec3 origin_mm = Vec3::Zero();
  std::uint32_t columns = 0, rows = 0;  ///< at least two each
  double step_x_mm = 0.0, step_y_mm = 0.0;
  LargePageVector<float> height_mm;  ///< columns * rows, relative to origin_mm.z()
  std::vector<float> block_max_mm;   ///< per block of cells, row by row: its highest post; -infinity in holes
  float low_mm = 0.0f, high_mm = 0.0f;  ///< over all posts but holes
  std::size_t holes = 0;                ///< posts without data

  [[nodiscard]] std::size_t posts() const noexcept { return height_mm.size(); }
  [[nodiscard]] std::size_t at(std::uint32_t column, std::uint32_t row) const noexcept {
    return static_cast<std::size_t>(row) * columns + column;
  }
  [[nodiscard]] std::uint32_t block_columns() const noexcept { return (columns - 2) / kBlock + 1; }
  /// Number of blocks of a lattice.
  [[nodiscard]] static std::size_t blocks_of(std::uint32_t columns, std::uint32_t rows) noexcept {
    return (std::size_t{columns - 2} / kBlock + 1) * (std::size_t{rows - 2} / kBlock + 1);
  }
  /// Section 4.2.1: the largest distance between adjacent posts seen from above (the diagonal).
  [[nodiscard]] double plan_resolution_mm() const noexcept { return std::hypot(step_x_mm, step_y_mm); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return height_mm.capacity() * sizeof(float) + block_max_mm.capacity() * sizeof(float);
  }
};

/// Finds the plan lattice of a cloud, in any point order. Posts without a point are holes, at most
/// kMaxPostsPerPoint posts a point.
/// Errors: fewer than two rows or columns, a point farther from its post than kLatticeShare of a step, two
/// points at one post. O(n) with a raster, else O(n log n). `point_of_post`, if given, receives the point
/// index per post, kNoPoint in holes.
[[nodiscard]] Result<HeightField> height_field_of(const Cloud& cloud,
                                                  std::vector<std::uint32_t>* point_of_post = nullptr);
inline constexpr std::uint32_t kNoPoint = 0xFFFFFFFFu;

/// Largest offset of a point from its post, as a share of a step: allows single precision and files with few
/// digits, not scattered points. On a slope of 1 the height error is as large.
inline constexpr double kLatticeShare = 1.0 / 64.0;
/// An emptier lattice, as a whole or in parts (sparse_fraction), is no height field but points that happen to
/// be in rows.
inline constexpr std::size_t kMaxPostsPerPoint = 16;

/// Computes block maxima, lowest, highest and hole count from the heights. O(posts).
void update_block_maxima(HeightField& field);

}  // namespace palpate::cloud
