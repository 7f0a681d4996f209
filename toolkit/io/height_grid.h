// Grids of heights on their way to points (beside them: the reader of PFM files, which are such). Internal to
// toolkit/io and toolkit/dem.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>

#include <palpate/read_model.h>
#include "toolkit/io/decoding.h"

namespace palpate::io {

/// Counts what may be a value for "no data" that no tag names: the lowest or the highest of all numbers.
class SuspectHeight {
 public:
  /// `sign` 1 watches the highest number, -1 the lowest.
  explicit SuspectHeight(double sign) noexcept : sign_(sign) {}
  void add(double number) noexcept;
  /// A warning, or empty: a customary value, in bulk, and far from all others, which reach to `other_end`.
  [[nodiscard]] std::string warning(const SuspectHeight& other_end, std::uint64_t posts) const;

 private:
  double sign_;
  double most_ = -std::numeric_limits<double>::infinity();    ///< times the sign
  double second_ = -std::numeric_limits<double>::infinity();  ///< the next other number
  std::uint64_t count_ = 0;
};

/// Rows and columns a file promises, and what its numbers stand for.
struct HeightGrid {
  std::uint64_t columns = 0, rows = 0;
  double step_x = 1.0, step_y = 1.0;  ///< distance of posts, in `unit`
  double per_height = 1.0;            ///< a height of 1, in `unit`
  double scale = 1.0, offset = 0.0;   ///< a height is scale * number + offset
  std::optional<double> no_data;      ///< the number that the file itself says stands for none
  Unit unit = Unit::kMillimetre;      ///< of the file, before the options
  SuspectHeight lowest{-1.0}, highest{1.0};
};

/// An Error unless the grid has 2 x 2 posts or more, its indices fit into 32 bits and its points into
/// options.max_bytes.
[[nodiscard]] Status check_grid(const HeightGrid& grid, const ReadOptions& options);

/// Adds a row's posts as points: the post (column, row) at (column * step, row * step, height). Numbers that
/// are not finite, or stand for no data, are holes. The options' post_mm, vertical_mm and no_data are
/// applied.
void add_row(HeightGrid& grid, std::uint64_t row, std::span<const double> numbers, const ReadOptions& options,
             DecodedFile& decoded);

/// After the last row: warns of numbers among the heights that look like "no data".
void warn_of_no_data(const HeightGrid& grid, DecodedFile& decoded);

}  // namespace palpate::io
