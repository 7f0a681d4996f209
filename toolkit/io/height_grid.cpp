#include "toolkit/io/height_grid.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "toolkit/io/decoded_file.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/text.h"

namespace palpate::io {
namespace {

// What programs write where they have no height: the ends of the integer types, rows of nines, the largest
// float (and whatever else no length is), and, of depth images, 0.
bool is_customary(double number) noexcept {
  constexpr double kNoLength = 1e30;
  constexpr std::array<double, 12> kCustomary{0.0,     -32768.0,      32767.0,      -32767.0,
                                              65535.0, -9999.0,       9999.0,       -99999.0,
                                              99999.0, -2147483648.0, 2147483647.0, 4294967295.0};
  return std::abs(number) >= kNoLength ||
         std::find(kCustomary.begin(), kCustomary.end(), number) != kCustomary.end();
}

// The same number, or the same after rounding to the float that the file may hold.
bool is_no_data(double number, const ReadOptions& options) noexcept {
  return options.no_data && (number == *options.no_data || to_float(number) == to_float(*options.no_data));
}

}  // namespace

Status check_grid(const HeightGrid& grid, const ReadOptions& options) {
  if (grid.columns < 2 || grid.rows < 2)
    return Error{fmt::format("a grid of {} x {} posts is no surface", grid.columns, grid.rows),
                 "give a file with at least 2 x 2 posts"};
  if (grid.columns > kMaxPoints / grid.rows)
    return Error{fmt::format("the file promises {} x {} posts, at most {} are possible", grid.columns,
                             grid.rows, kMaxPoints),
                 "cut out a part of it"};
  return check_memory(grid.columns * grid.rows, sizeof(Vec3), "posts", options);
}

void SuspectHeight::add(double number) noexcept {
  if (!std::isfinite(number)) return;
  const double value = sign_ * number;
  if (value == most_) {
    ++count_;
  } else if (value > most_) {
    second_ = most_;
    most_ = value;
    count_ = 1;
  } else if (value > second_) {
    second_ = value;
  }
}

std::string SuspectHeight::warning(const SuspectHeight& other_end, std::uint64_t posts) const {
  const double number = sign_ * most_;
  // In bulk: a thousandth of the posts, and no single spike.
  constexpr std::uint64_t kBulk = 1000, kFewest = 3;
  if (count_ < kFewest || count_ < posts / kBulk || !is_customary(number)) return {};
  // Far: a quarter of the range of all others, which is a range.
  constexpr double kFar = 0.25;
  const double range = second_ + other_end.most_;  // the other end has the other sign
  if (!(range > 0.0) || !(most_ - second_ > kFar * range)) return {};
  return fmt::format(
      "{} of {} posts hold {:.9g}, far from all others: probably no data, and read as ground. "
      "Leave them out with --no-data {:.9g}.",
      count_, posts, number, number);
}

void warn_of_no_data(const HeightGrid& grid, DecodedFile& decoded) {
  for (std::string warning : {grid.lowest.warning(grid.highest, decoded.points.size()),
                              grid.highest.warning(grid.lowest, decoded.points.size())})
    if (!warning.empty()) decoded.warnings.push_back(std::move(warning));
}

void add_row(HeightGrid& grid, std::uint64_t row, std::span<const double> numbers, const ReadOptions& options,
             DecodedFile& decoded) {
  decoded.height_grid = true;
  // Everything is multiplied by the unit's mm later on.
  const double per_mm = 1.0 / mm_per(options.unit.value_or(grid.unit));
  const double step_x = options.post_mm > 0.0 ? options.post_mm * per_mm : grid.step_x;
  const double step_y = options.post_mm > 0.0 ? options.post_mm * per_mm : grid.step_y;
  const double per_height = options.vertical_mm > 0.0 ? options.vertical_mm * per_mm : grid.per_height;
  const double y = static_cast<double>(row) * step_y;
  for (std::size_t column = 0; column < numbers.size(); ++column) {
    const double number = numbers[column];
    double height = std::numeric_limits<double>::quiet_NaN();
    if (number != grid.no_data && !is_no_data(number, options)) {
      grid.lowest.add(number);
      grid.highest.add(number);
      height = (grid.scale * number + grid.offset) * per_height;
    }
    decoded.points.emplace_back(static_cast<double>(column) * step_x, y, height);
  }
}

}  // namespace palpate::io
