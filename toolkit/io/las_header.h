// The header of a LAS or LAZ file, with records. Source: ASPRS, "LAS Specification" 1.0 to 1.4 R15. The
// records read are those that positions need: how points are compressed, and the coordinate system. Places
// and counts are held against the file's size; what is only wrong beside the points becomes a warning.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/las_unit.h"
#include "toolkit/laz/compression.h"

namespace palpate::io {

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
