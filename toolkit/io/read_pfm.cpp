// PFM, the portable float map: three lines of text, then rows of floats from the bottom up.
#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include <palpate/result.h>
#include "toolkit/io/decoded_file.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/height_grid.h"
#include "toolkit/io/text.h"

namespace palpate::io {
namespace {

/// Tokens of a header; more is none.
constexpr int kHeaderTokens = 4;

Error bad_header(std::string what, const BufferedInput& in) {
  return Error{std::move(what),
               "a PFM file begins with 'Pf', its width and height, and a scale",
               {},
               in.line_number()};
}

struct Header {
  HeightGrid grid;
  double scale = 0.0;
};

/// The four tokens may share lines: most writers use three, some one line each.
Result<Header> read_header(BufferedInput& in) {
  std::string tokens[kHeaderTokens];
  int count = 0;
  std::string_view line;
  while (count < kHeaderTokens && in.next_line(line)) {
    for (std::string_view token = next_token(line); !token.empty(); token = next_token(line)) {
      if (token.front() == '#') break;
      if (count == kHeaderTokens) return bad_header("the header has more than four words", in);
      tokens[count++] = std::string(token);
    }
    // A colour map is told at once: its header is otherwise the same.
    if (count > 0 && tokens[0] == "PF")
      return Error{"the file is a colour map, not a height map", "save one channel as 'Pf'", {}, 1};
    if (count > 0 && tokens[0] != "Pf") return bad_header("the file does not begin with 'Pf'", in);
  }
  if (count < kHeaderTokens) return in.error_or(bad_header("the header is cut off", in));
  const std::optional<std::int64_t> columns = parse_whole(tokens[1]), rows = parse_whole(tokens[2]);
  const std::optional<double> scale = parse_real(tokens[3]);
  if (!columns || !rows || *columns < 0 || *rows < 0)
    return bad_header(fmt::format("{} x {} is no size", quoted(tokens[1]), quoted(tokens[2])), in);
  if (!scale || !std::isfinite(*scale) || *scale == 0.0)
    return bad_header(fmt::format("{} is no scale", quoted(tokens[3])), in);
  Header header;
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

Result<DecodedFile> read_pfm(const ReaderInput& input) {
  BufferedInput in(input.bytes);
  PALPATE_ASSIGN(Header header, read_header(in));
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
