#include "toolkit/dem/dem_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include <palpate/result.h>
#include "toolkit/io/decoding.h"
#include "toolkit/io/height_grid.h"

namespace palpate::dem {
namespace {

// Deflate and LZMA pack at most about so much into a byte (zlib's own bound is 1032); of the other codings of
// TIFF none packs more into a block that is there.
constexpr std::uint64_t kMaxPerByte = 1032;
// A TIFF may leave out blocks that hold nothing: no size follows from its length, and the memory bound alone
// holds. A tile index of 16 bytes stands for a block of at most so many posts.
constexpr std::uint64_t kSparseBlock = std::uint64_t{1} << 16;
// SRTM tiles: 16-bit heights, 1201 or 3601 posts a side, or the ASTER form of 1201 x 3601.
constexpr std::uint64_t kHgtBytes = 2;
// A PNG's size stands in its first chunk.
constexpr std::size_t kPngWidthAt = 16, kPngHeightAt = 20, kPngHeaderEnds = 29;
constexpr std::string_view kPngMagic = "\x89PNG\r\n\x1a\n";
// ESRI's header is six lines; more blanks and comments than this are none.
constexpr std::size_t kEsriHeaderBytes = 4096;

std::string_view text_of(std::span<const std::byte> file, std::size_t most) {
  return {reinterpret_cast<const char*>(file.data()), std::min(file.size(), most)};
}

bool is_tiff(std::string_view start) {
  constexpr std::string_view kMagics[] = {{"II*\0", 4}, {"MM\0*", 4}, {"II+\0", 4}, {"MM\0+", 4}};
  return std::any_of(std::begin(kMagics), std::end(kMagics),
                     [&](std::string_view magic) { return start.starts_with(magic); });
}

std::uint32_t big_endian(std::span<const std::byte> file, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < sizeof value; ++i)
    value = value << 8 | std::to_integer<std::uint32_t>(file[at + i]);
  return value;
}

Error not_that(std::string_view what) {
  return Error{fmt::format("the file's content is no {}", what), "check that its name says what it is"};
}

std::optional<std::uint64_t> esri_number(std::string_view header, std::string_view key) {
  const std::size_t at = header.find(key);
  if (at == std::string_view::npos) return std::nullopt;
  std::string_view rest = header.substr(at + key.size());
  rest = rest.substr(0, rest.find('\n'));
  const std::optional<std::int64_t> value = io::parse_whole(io::next_token(rest));
  if (!value || *value < 0) return std::nullopt;
  return static_cast<std::uint64_t>(*value);
}

Status check_hgt(std::span<const std::byte> file, const io::ReadOptions& options) {
  constexpr std::uint64_t kCoarse = 1201, kFine = 3601;
  for (const auto& [columns, rows] : {std::pair(kCoarse, kCoarse), std::pair(kFine, kFine),
                                      std::pair(kCoarse, kFine), std::pair(kFine, kCoarse)})
    if (file.size() == columns * rows * kHgtBytes)
      return check_size(DemFormat::kHgt, columns, rows, file.size(), options);
  return Error{fmt::format("{} bytes are no SRTM tile", file.size()),
               "a tile has 1201 x 1201 or 3601 x 3601 posts of two bytes: fetch it again"};
}

/// Posts that a file of `bytes` may hold in this format, at the most its coding allows: beyond it the header
/// lies.
std::uint64_t max_posts(DemFormat format, std::uint64_t bytes) noexcept {
  switch (format) {
    case DemFormat::kHgt:
      return bytes / kHgtBytes;
    case DemFormat::kUsgs:
      return bytes;  // six characters each, but corners of a quadrangle may be left out
    case DemFormat::kEsriAscii:
      return bytes / 2 + 1;  // a digit and a blank
    case DemFormat::kPng:
    case DemFormat::kZip:
      return bytes * kMaxPerByte;
    case DemFormat::kTiff:
      break;
  }
  return bytes * kSparseBlock;
}

}  // namespace

bool is_esri_ascii(std::span<const std::byte> file) {
  std::string_view start = text_of(file, kEsriHeaderBytes);
  while (!start.empty() && (io::is_blank(start.front()) || start.front() == '\n')) start.remove_prefix(1);
  const std::string lower = io::lower_case(start.substr(0, 6));
  return lower.starts_with("ncols") || lower.starts_with("nrows");
}

Result<DemFormat> format_of(std::string_view extension, std::span<const std::byte> file) {
  const std::string_view start = text_of(file, kPngMagic.size());
  if (extension == "tif" || extension == "tiff") {
    if (!is_tiff(start)) return not_that("TIFF");
    return DemFormat::kTiff;
  }
  if (extension == "png") {
    if (start != kPngMagic) return not_that("PNG");
    return DemFormat::kPng;
  }
  if (extension == "zip") {
    if (!start.starts_with("PK\x03\x04")) return not_that("ZIP archive");
    return DemFormat::kZip;
  }
  if (extension == "hgt") return DemFormat::kHgt;
  if (extension == "dem") return DemFormat::kUsgs;
  if (!is_esri_ascii(file)) return not_that("ESRI ASCII grid");
  return DemFormat::kEsriAscii;
}

Status check_size(DemFormat format, std::uint64_t columns, std::uint64_t rows, std::uint64_t bytes,
                  const io::ReadOptions& options) {
  io::HeightGrid grid;
  grid.columns = columns;
  grid.rows = rows;
  PALPATE_TRY(io::check_grid(grid, options));
  if (columns * rows <= max_posts(format, bytes)) return Done{};
  return Error{
      fmt::format("the header promises {} x {} posts, more than its {} bytes can hold", columns, rows, bytes),
      "the file is cut off or damaged: fetch it again"};
}

Status check_header(DemFormat format, std::span<const std::byte> file, const io::ReadOptions& options) {
  if (format == DemFormat::kHgt) return check_hgt(file, options);
  if (format == DemFormat::kPng) {
    if (file.size() < kPngHeaderEnds) return not_that("whole PNG");
    return check_size(format, big_endian(file, kPngWidthAt), big_endian(file, kPngHeightAt), file.size(),
                      options);
  }
  if (format == DemFormat::kEsriAscii) {
    const std::string header = io::lower_case(text_of(file, kEsriHeaderBytes));
    const auto columns = esri_number(header, "ncols"), rows = esri_number(header, "nrows");
    if (!columns || !rows)
      return Error{"the header does not give ncols and nrows", "check its first lines", {}, 1};
    return check_size(format, *columns, *rows, file.size(), options);
  }
  return Done{};
}

}  // namespace palpate::dem
