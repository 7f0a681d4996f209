// Reads the header of a LAS or LAZ file.
//
// ASPRS, "LAS Specification" 1.0 to 1.4 R15, with the records behind the header that matter for positions:
// how points are compressed, and the coordinate system, whose unit stands in GeoTIFF keys (OGC 19-008) or
// well-known text (OGC 01-009, 18-010). Offsets and counts are checked against the file's size; an error
// beside the points becomes a warning.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/laz/chunk_decoder.h"

namespace palpate::io {

struct LasUnit {
  std::optional<Unit> unit;  ///< where the file names one that Palpate has
  std::optional<Unit>
      conventional_unit;  ///< otherwise metres, with a warning where that is not the true size
  std::vector<std::string> warnings;
};

/// `keys`: the record "LASF_Projection" 34735, `text`: 2112, each empty where it is not there. Text is taken
/// first where `prefers_text` (a bit of the header). Damaged records say nothing.
[[nodiscard]] LasUnit unit_of_las(std::span<const std::byte> keys, std::string_view text, bool prefers_text);

/// Metres of one unit of a projected or local system in well-known text, `vertical`: of its heights; nothing
/// where the text does not say it.
[[nodiscard]] std::optional<double> metres_of_text(std::string_view text, bool vertical);

inline constexpr const char* kLasMagic = "LASF";

struct LasHeader {
  std::string format;  ///< in words, "LAZ 1.4, point format 7"
  std::uint8_t point_format = 0;
  std::size_t point_bytes = 0;  ///< extra bytes included
  std::uint64_t points = 0;     ///< promised
  std::uint64_t points_at = 0;  ///< in the file; for LAZ, the eight bytes before the first chunk
  std::size_t colour_at = 0;    ///< in a point; 0: the format has none
  Vec3 scale = Vec3::Ones(), offset = Vec3::Zero();
  std::optional<geometry::Aabb> bounds;         ///< in the file's unit, where they are numbers
  std::optional<laz::Compression> compression;  ///< of a LAZ file
  LasUnit unit;
  std::vector<std::string> warnings;  ///< those of `unit` included
};

/// The remedy where the file is shorter than it says.
inline constexpr const char* kLasIsCut = "the file is cut short: copy or fetch it again";
/// Where intensity stands in a point of every format.
inline constexpr std::size_t kLasIntensityAt = 12;

/// Errors name the byte, not the file.
[[nodiscard]] Result<LasHeader> read_las_header(const RandomAccess& file);

}  // namespace palpate::io
