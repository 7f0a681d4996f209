#include "toolkit/io/height_grid.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include <palpate/result.h>
#include "toolkit/io/decoding.h"

namespace palpate::io {
namespace {

// Numbers that programs write for no height: the ends of the integer types, rows of nines, the largest float
// (and any other that is no length), and, in depth images, 0.
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

// PFM, the portable float map: three lines of text, then rows of floats from the bottom up.

/// Tokens of a header; more is none.
constexpr int kPfmTokens = 4;

Error bad_pfm_header(std::string what, const BufferedInput& in) {
  return Error{std::move(what),
               "a PFM file begins with 'Pf', its width and height, and a scale",
               {},
               in.line_number()};
}

struct PfmHeader {
  HeightGrid grid;
  double scale = 0.0;
};

/// The four tokens may share lines: most writers use three, some one line each.
Result<PfmHeader> read_pfm_header(BufferedInput& in) {
  std::string tokens[kPfmTokens];
  int count = 0;
  std::string_view line;
  while (count < kPfmTokens && in.next_line(line)) {
    for (std::string_view token = next_token(line); !token.empty(); token = next_token(line)) {
      if (token.front() == '#') break;
      if (count == kPfmTokens) return bad_pfm_header("the header has more than four words", in);
      tokens[count++] = std::string(token);
    }
    // A colour map is recognised first: its header is otherwise the same.
    if (count > 0 && tokens[0] == "PF")
      return Error{"the file is a colour map, not a height map", "save one channel as 'Pf'", {}, 1};
    if (count > 0 && tokens[0] != "Pf") return bad_pfm_header("the file does not begin with 'Pf'", in);
  }
  if (count < kPfmTokens) return in.error_or(bad_pfm_header("the header is cut off", in));
  const std::optional<std::int64_t> columns = parse_whole(tokens[1]), rows = parse_whole(tokens[2]);
  const std::optional<double> scale = parse_real(tokens[3]);
  if (!columns || !rows || *columns < 0 || *rows < 0)
    return bad_pfm_header(fmt::format("{} x {} is no size", shown(tokens[1]), shown(tokens[2])), in);
  if (!scale || !std::isfinite(*scale) || *scale == 0.0)
    return bad_pfm_header(fmt::format("{} is no scale", shown(tokens[3])), in);
  PfmHeader header;
  header.grid.columns = static_cast<std::uint64_t>(*columns);
  header.grid.rows = static_cast<std::uint64_t>(*rows);
  header.scale = *scale;
  return header;
}

double height_at(const std::byte* from, bool little) noexcept {
  std::uint32_t bits = 0;
  for (std::size_t i = 0; i < sizeof bits; ++i) {
    const std::size_t shift = 8 * (little ? i : sizeof bits - 1 - i);
    bits |= std::to_integer<std::uint32_t>(from[i]) << shift;
  }
  return static_cast<double>(std::bit_cast<float>(bits));
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

Result<DecodedFile> read_pfm(const ReaderInput& input) {
  BufferedInput in(input.bytes);
  PALPATE_ASSIGN(PfmHeader header, read_pfm_header(in));
  HeightGrid& grid = header.grid;
  PALPATE_TRY(check_grid(grid, input.options));
  const std::optional<std::uint64_t> left = in.remaining();
  const auto cut = [&](std::uint64_t rows) {
    return Error{fmt::format("the header promises {} rows of {} heights, the file holds {} rows", grid.rows,
                             grid.columns, rows),
                 "the file is cut off: fetch it again"};
  };
  const std::uint64_t row_bytes = grid.columns * sizeof(float);
  if (left && *left / row_bytes < grid.rows) return cut(*left / row_bytes);

  DecodedFile decoded;
  decoded.format = "PFM";
  decoded.conventional_unit = Unit::kMillimetre;
  if (std::abs(header.scale) != 1.0)
    decoded.warnings.push_back(
        fmt::format("The header's scale of {:g} was not applied to the heights.", std::abs(header.scale)));
  decoded.points.reserve(reserve_count(grid.columns * grid.rows, sizeof(float), left));
  ReadMonitor watch(input, in, decoded);
  std::vector<double> heights;
  for (std::uint64_t row = 0; row < grid.rows; ++row) {
    // In pieces, so that a promised row costs no more than what arrives.
    heights.clear();
    for (std::uint64_t column = 0; column < grid.columns; ++column) {
      const std::byte* const at = in.take(sizeof(float));
      if (at == nullptr) return in.error_or(cut(row));
      heights.push_back(height_at(at, header.scale < 0.0));
      if (!watch.row()) return watch.error();
    }
    add_row(grid, row, heights, input.options, decoded);
  }
  warn_of_no_data(grid, decoded);
  decoded.raster =
      cloud::ScanRaster{static_cast<std::uint32_t>(grid.columns), static_cast<std::uint32_t>(grid.rows)};
  return decoded;
}

}  // namespace palpate::io
