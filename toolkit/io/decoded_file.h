// What stands between a format's reader and the model that is made of any file.
#pragma once

#include <palpate/read_model.h>

#include "toolkit/io/byte_source.h"

namespace palpate::io {

/// What a format's reader hands on: the file's numbers before unit, scale and cleaning.
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

/// What a format's reader is given. `bytes` is decompressed already; `name` is for messages.
struct ReaderInput {
  ByteSource& bytes;
  const std::string& name;
  const ReadOptions& options;
  Progress& progress;
};

/// Unit, scale, cleaning, the cloud, the mesh and the hash: the same for all formats. O(points + faces).
[[nodiscard]] Result<ReadModel> finish_model(DecodedFile&& decoded, const ReadOptions& options,
                                             const std::string& name);

}  // namespace palpate::io
