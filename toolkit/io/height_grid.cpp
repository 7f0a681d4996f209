#include "toolkit/io/height_grid.h"

#include <fmt/format.h>

#include "toolkit/io/decoding.h"

namespace palpate::io {

Status check_grid(const HeightGrid& grid, const ReadOptions& options) {
  if (grid.columns < 2 || grid.rows < 2)
    return Error{fmt::format("a grid of {} x {} posts is no surface", grid.columns, grid.rows),
                 "give a file with at least 2 x 2 posts",
                 {},
                 0};
  if (grid.columns > kMaxPoints / grid.rows)
    return Error{fmt::format("the file promises {} x {} posts, at most {} are possible", grid.columns,
                             grid.rows, kMaxPoints),
                 "cut out a part of it",
                 {},
                 0};
  return check_memory(grid.columns * grid.rows, sizeof(Vec3), "posts", options);
}

void add_row(const HeightGrid& grid, std::uint64_t row, std::span<const double> heights,
             const ReadOptions& options, DecodedFile& decoded) {
  decoded.height_grid = true;
  // Everything is multiplied by the unit's mm later on.
  const double per_mm = 1.0 / mm_per(options.unit.value_or(grid.unit));
  const double step_x = options.post_mm > 0.0 ? options.post_mm * per_mm : grid.step_x;
  const double step_y = options.post_mm > 0.0 ? options.post_mm * per_mm : grid.step_y;
  const double per_height = options.vertical_mm > 0.0 ? options.vertical_mm * per_mm : grid.per_height;
  const double y = static_cast<double>(row) * step_y;
  for (std::size_t column = 0; column < heights.size(); ++column)
    decoded.points.emplace_back(static_cast<double>(column) * step_x, y, heights[column] * per_height);
}

}  // namespace palpate::io
