// A regular grid of heights: chapter 4 of the thesis, where a height field is a point cloud that does not
// overlap itself seen from above.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/large_pages.h"
#include "toolkit/core/result.h"

namespace palpate::cloud {

/// Posts on a plan lattice, rows of increasing y, in a row increasing x: the post (column, row) stands at
/// origin_mm + (column * step_x_mm, row * step_y_mm, height), model frame. A height that is not a number is a
/// hole. 4 bytes a post and a 64th of a byte for the tops. Owns its arrays; immutable after building in all
/// but name, safe to read from many threads.
struct HeightField {
  /// Cells along each side of a block that shares one top.
  static constexpr std::uint32_t kBlock = 16;

  Vec3 origin_mm = Vec3::Zero();
  std::uint32_t columns = 0, rows = 0;  ///< at least two each
  double step_x_mm = 0.0, step_y_mm = 0.0;
  LargeVector<float> height_mm;  ///< columns * rows, relative to origin_mm.z()
  std::vector<float> top_mm;     ///< per block of cells, row by row: its highest post; -infinity in holes
  float low_mm = 0.0f, high_mm = 0.0f;  ///< of all posts that are no holes
  std::size_t holes = 0;                ///< posts without data

  [[nodiscard]] std::size_t posts() const noexcept { return height_mm.size(); }
  [[nodiscard]] std::size_t at(std::uint32_t column, std::uint32_t row) const noexcept {
    return static_cast<std::size_t>(row) * columns + column;
  }
  [[nodiscard]] std::uint32_t block_columns() const noexcept { return (columns - 2) / kBlock + 1; }
  /// How many tops a lattice has.
  [[nodiscard]] static std::size_t blocks_of(std::uint32_t columns, std::uint32_t rows) noexcept {
    return (std::size_t{columns - 2} / kBlock + 1) * (std::size_t{rows - 2} / kBlock + 1);
  }
  /// Section 4.2.1: the furthest distance between two neighbouring posts seen from above, the diagonal.
  [[nodiscard]] double plan_resolution_mm() const noexcept { return std::hypot(step_x_mm, step_y_mm); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return height_mm.capacity() * sizeof(float) + top_mm.capacity() * sizeof(float);
  }
};

/// Where the points of a cloud stand on a plan lattice, if they do.
///
/// The order of points does not matter; posts without a point are holes, at most kMostPostsPerPoint posts a
/// point. Errors: fewer than two rows or columns, a point farther from its post than kLatticeShare of a step,
/// two points at one post. O(n) with a raster, O(n log n) without. `point_of_post`, where given, becomes the
/// index of the point at each post, kNoPoint in holes.
[[nodiscard]] Result<HeightField> height_field_of(const Cloud& cloud,
                                                  std::vector<std::uint32_t>* point_of_post = nullptr);
inline constexpr std::uint32_t kNoPoint = 0xFFFFFFFFu;

/// A point may stand this share of a step off its post: single precision and files with few digits pass,
/// scattered points do not. On a slope of 1 it is an error of the height of as much.
inline constexpr double kLatticeShare = 1.0 / 64.0;
/// A lattice that is emptier than this, as a whole or in parts (thin_share), is no height field but points
/// that happen to stand in rows.
inline constexpr std::size_t kMostPostsPerPoint = 16;

/// Fills tops, lowest, highest and holes from the heights. O(posts).
void finish(HeightField& field);

}  // namespace palpate::cloud
