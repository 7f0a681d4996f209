// Input, output and helpers of the readers of all formats. Helpers: tokens and numbers of text (by
// std::from_chars: no locale, no allocation), bounds on promises, progress, faces. Internal to the readers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/read_model.h>
#include "toolkit/core/csv_dialect.h"
#include "toolkit/core/messages.h"
#include "toolkit/io/byte_source.h"

namespace palpate::io {

/// Output of a format's reader: the file's numbers before unit, scale and cleaning.
struct DecodedFile {
  std::vector<Vec3> points;
  std::vector<cloud::Property> properties;              ///< each as long as `points`
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< may name points that do not exist
  std::vector<bool> continues_face;  ///< as long as `triangles`: same polygon as the one before
  std::size_t dropped_faces = 0;     ///< faces already given up while reading
  std::optional<cloud::ScanRaster> raster;
  /// Of a raster with holes, by point: the position that it stands at, row * columns + column; else empty.
  std::vector<std::uint32_t> position_of;
  std::uint32_t position_columns = 0;
  bool single_precision = false;          ///< the file itself holds its coordinates as 32-bit floats
  bool height_grid = false;               ///< made by add_row(), which alone knows posts and heights
  std::optional<Unit> unit;               ///< where the file itself says it
  std::optional<Unit> conventional_unit;  ///< where the format has a convention: a better guess
  std::vector<std::string> warnings;
  std::string format;

  [[nodiscard]] std::size_t bytes() const noexcept;
};

/// Input of a format's reader. `bytes` is decompressed already; `name` is for messages.
struct ReaderInput {
  ByteSource& bytes;
  const std::string& name;
  const ReadOptions& options;
  Progress& progress;
};

[[nodiscard]] inline bool is_blank(char c) noexcept {
  return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f';
}
/// The remedy where nothing better is known.
inline constexpr const char* kCheckLine = "check the file at this line";
[[nodiscard]] std::string lower_case(std::string_view text);

/// Cuts the next token between blanks off the front of `rest`; empty at the end.
[[nodiscard]] inline std::string_view next_token(std::string_view& rest) noexcept {
  std::size_t begin = 0;
  while (begin < rest.size() && is_blank(rest[begin])) ++begin;
  std::size_t end = begin;
  while (end < rest.size() && !is_blank(rest[end])) ++end;
  const std::string_view token = rest.substr(begin, end - begin);
  rest.remove_prefix(end);
  return token;
}

/// The whole token as a number: a leading +, nan and inf in any case and as old Microsoft libraries print
/// them (-1.#IND) are understood; what a double cannot hold becomes infinite or 0. Empty where it is no
/// number.
[[nodiscard]] std::optional<double> parse_real(std::string_view token) noexcept;
/// The whole token as a whole number.
[[nodiscard]] std::optional<std::int64_t> parse_whole(std::string_view token) noexcept;

/// Cuts a vertex's three coordinates off the front of `rest`. The Error has no line.
[[nodiscard]] Result<Vec3> next_vertex(std::string_view& rest);

/// "(0, 0, 0) to (10, 5, 2) mm", to copy and change.
[[nodiscard]] std::string box_text(const geometry::Aabb& box_mm);
/// The Error that no point is `within`; `own_mm` holds them all.
[[nodiscard]] Error nothing_within(const geometry::Aabb& within_mm, const geometry::Aabb& own_mm);

/// Rounds to float; beyond float's range it is infinite.
[[nodiscard]] float to_float(double value) noexcept;

/// Indices are 32 bits wide; the last value marks a dropped point, the one before a point outside the box.
inline constexpr std::uint64_t kMaxPoints = 0xFFFFFFFEu;
/// Rows between two reports of progress: about a hundredth of a second of parsing.
inline constexpr std::uint64_t kRowsPerReport = std::uint64_t{1} << 16;

/// An Error if `count` things of `bytes_each` in memory pass the bound of the options.
[[nodiscard]] Status check_memory(std::uint64_t count, std::uint64_t bytes_each, std::string_view what,
                                  const ReadOptions& options);
/// Rows to reserve for, of `count` promised ones of at least `min_row_bytes`.
[[nodiscard]] std::size_t reserve_count(std::uint64_t count, std::uint64_t min_row_bytes,
                                        std::optional<std::uint64_t> remaining);

/// Reports progress, asks whether to stop and watches memory, once every kRowsPerReport rows.
class ReadMonitor {
 public:
  ReadMonitor(const ReaderInput& input, const BufferedInput& buffer, const DecodedFile& decoded);
  /// Call once a row. False: stop, error() says why.
  [[nodiscard]] bool row() { return ++rows_ % kRowsPerReport != 0 || check(); }
  [[nodiscard]] const Error& error() const noexcept { return error_; }

 private:
  bool check();
  const ReaderInput& input_;
  const BufferedInput& buffer_;
  const DecodedFile& decoded_;
  std::uint64_t rows_ = 0;
  Error error_;
};

/// Takes polygons corner by corner and leaves fans of triangles in a DecodedFile. A polygon with an index
/// below 0 or at or above `index_limit`, or with fewer than three corners, is dropped whole and counted.
class FaceBuilder {
 public:
  FaceBuilder(DecodedFile& decoded, std::uint64_t index_limit, const ReadOptions& options);
  void begin() noexcept;
  /// False where the triangles pass the memory bound: give up with too_many().
  [[nodiscard]] bool corner(std::int64_t index);
  void end();
  [[nodiscard]] Error too_many() const;

 private:
  DecodedFile& decoded_;
  std::uint64_t index_limit_;
  std::uint64_t max_bytes_;
  std::uint64_t max_triangles_;
  std::size_t start_ = 0;
  std::uint64_t corners_ = 0;
  std::uint32_t first_ = 0;
  std::uint32_t last_ = 0;
  bool bad_ = false;
};

/// Readers of one format each.
[[nodiscard]] Result<DecodedFile> read_ply(const ReaderInput& input);
[[nodiscard]] Result<DecodedFile> read_xyz(const ReaderInput& input);
[[nodiscard]] Result<DecodedFile> read_obj(const ReaderInput& input);
[[nodiscard]] Result<DecodedFile> read_off(const ReaderInput& input);
[[nodiscard]] Result<DecodedFile> read_pfm(const ReaderInput& input);
/// STL, binary and as text: its triangles as the file's own mesh. Each facet lists its own corners, so
/// corners at bit-identical places become one vertex; facets that lose a corner by it, or have one that is
/// not finite, are dropped and counted. A text begins with "solid", which some binary files do too: the size
/// decides first. STL has no unit.
[[nodiscard]] Result<DecodedFile> read_stl(const ReaderInput& input);

}  // namespace palpate::io
