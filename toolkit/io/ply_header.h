// The header of a PLY file (G. Turk, "The PLY Polygon File Format", 1994) and the values of its binary rows.
// Internal to toolkit/io.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <palpate/read_model.h>
#include "toolkit/io/byte_source.h"

namespace palpate::io {

enum class PlyScalar { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };
[[nodiscard]] std::uint32_t ply_bytes(PlyScalar type) noexcept;
/// The value that stands at `at`, exact in a double; `swap`: in the other order of bytes than this machine's.
[[nodiscard]] double ply_value(PlyScalar type, const std::byte* at, bool swap) noexcept;

struct PlyProperty {
  std::string name;
  PlyScalar type = PlyScalar::kFloat32;  ///< of the value, or of a list's items
  bool is_list = false;
  PlyScalar count_type = PlyScalar::kUint8;  ///< of a list's count
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
  [[nodiscard]] bool has_lists() const noexcept;
  /// The least that one row takes in the file.
  [[nodiscard]] std::uint64_t min_row_bytes(bool ascii) const noexcept;
};

enum class PlyFormat { kAscii, kLittleEndian, kBigEndian };
/// "PLY, ASCII", ..
[[nodiscard]] std::string format_name(PlyFormat format);

struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<PlyElement> elements;
  std::optional<Unit> unit;             ///< from "comment unit mm" or "obj_info unit mm"
  std::uint64_t columns = 0, rows = 0;  ///< from obj_info num_cols and num_rows; 0 where not stated
};

/// Reads up to and with end_header. Checks that every element's promise fits into what is left of the file,
/// where that is known. Bounded by kMaxPlyHeaderBytes.
[[nodiscard]] Result<PlyHeader> read_ply_header(BufferedInput& in);

}  // namespace palpate::io
