// Grids of heights on their way to points. Internal to toolkit/io and toolkit/dem.
#pragma once

#include <cstdint>
#include <span>

#include "toolkit/io/read_model.h"

namespace palpate::io {

/// Rows and columns a file promises, and what its numbers stand for.
struct HeightGrid {
  std::uint64_t columns = 0, rows = 0;
  double step_x = 1.0, step_y = 1.0;  ///< distance of posts, in `unit`
  double per_height = 1.0;            ///< the number 1 as a height, in `unit`
  Unit unit = Unit::kMillimetre;      ///< of the file, before the options
};

/// An Error unless the grid has 2 x 2 posts or more, its indices fit into 32 bits and its points into
/// options.max_bytes.
[[nodiscard]] Status check_grid(const HeightGrid& grid, const ReadOptions& options);

/// Adds a row's posts as points: the post (column, row) at (column * step, row * step, height). What is not
/// finite stays so: a hole. The options' post_mm and vertical_mm are applied.
void add_row(const HeightGrid& grid, std::uint64_t row, std::span<const double> heights,
             const ReadOptions& options, DecodedFile& decoded);

}  // namespace palpate::io
