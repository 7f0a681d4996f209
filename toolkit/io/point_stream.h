// Streams of points, for files larger than memory. A stream gives positions from front to back, in the file's
// own unit, and never holds more than a piece of the file.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/read_model.h>

namespace palpate::io {

/// Statements of a file before its points are read. Nothing here is believed: counts are bounded by the
/// file's size, bounds only guide a reader and are checked by who uses them.
struct StreamHeader {
  std::string format;                     ///< in words, "LAS 1.2, point format 3"
  std::uint64_t points = 0;               ///< promised; read() may give fewer at a damaged end, then an Error
  std::optional<Unit> unit;               ///< where the file itself says it
  std::optional<Unit> conventional_unit;  ///< where the format has a convention
  std::optional<geometry::Aabb> bounds;   ///< as the header says, in the file's unit
  std::vector<std::string> warnings;
};

/// Positions in the file's unit, from front to back. Not thread-safe; decoding may use threads inside.
class PointStream {
 public:
  virtual ~PointStream() = default;
  [[nodiscard]] virtual const StreamHeader& header() const noexcept = 0;
  /// Fills the front of `out` and returns how many points it wrote: 0 only at the end (or for an empty
  /// `out`). Points that are not finite are given as they stand; who reads drops and counts them.
  [[nodiscard]] virtual Result<std::size_t> read(std::span<Vec3> out) = 0;
  /// Begins again at the first point.
  [[nodiscard]] virtual Status rewind() = 0;
};

/// Opens a file by its content: LAS, LAZ, COPC, E57, PTX, PTS, binary PLY, binary PCD. Errors name the file
/// and what to do. `threads` decode where the format allows it.
[[nodiscard]] Result<std::unique_ptr<PointStream>> open_point_stream(const std::string& path, int threads);
/// A folder's files, by name. Error: none, or not a folder that can be listed.
[[nodiscard]] Result<std::vector<std::string>> files_of_folder(const std::string& folder);
/// The same of a folder's files one after another, by name: the tiles of one scan. Files of other formats are
/// an Error, and so is a unit that is not that of the first file.
[[nodiscard]] Result<std::unique_ptr<PointStream>> open_folder_stream(const std::string& folder, int threads);

}  // namespace palpate::io
