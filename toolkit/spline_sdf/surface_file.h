// A smooth surface in a file. It serves clouds whose surface is larger than memory or shall be felt at once:
// tiles of bricks, coarser surfaces of the same points, and a sample of the points. The index is small and
// stays in memory; tiles are read where the hand goes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/spline_sdf/brick_tiles.h"
#include "toolkit/spline_sdf/spline_sdf_model.h"

/// Layout of a file of surfaces, on which reader and writer agree: a head, the tiles of all surfaces back to
/// back, the index, an end that says where the index is.
namespace palpate::spline_sdf::surface_layout {

inline constexpr std::array<char, 8> kMagic{'P', 'A', 'L', 'P', 'S', 'U', 'R', 'F'};
inline constexpr std::uint32_t kVersion = 2;
inline constexpr std::size_t kFileHeadBytes = 16;   // magic, version, a spare number
inline constexpr std::size_t kFileEndBytes = 32;    // the index's offset, bytes and checksum; the magic
inline constexpr std::size_t kTileRowBytes = 40;    // code, depth, groups, offset, checksum, bytes, bricks
inline constexpr std::size_t kGeometryBytes = 200;  // of a surface, with room for more numbers
inline constexpr std::size_t kPartBytes = 24;

/// Of the index, and of each tile in it.
[[nodiscard]] inline std::uint64_t checksum_of(std::span<const std::byte> bytes) noexcept {
  Hash64 hash;
  hash.bytes(bytes);
  return hash.value();
}

}  // namespace palpate::spline_sdf::surface_layout

namespace palpate::spline_sdf {

/// Bytes of the index, at most: forty million tiles, ten billion points.
inline constexpr std::uint64_t kMaxIndexBytes = std::uint64_t{1} << 31;

/// A surface as the index has it.
struct StoredSurface {
  /// Geometry and pieces; `bricks` and the levels' tables hold only the bricks above the tiles. A piece has a
  /// part per cube of some bricks.
  SplineSdf surface;
  std::vector<TileKey> keys;  ///< of the tiles, by first_code()
  struct Place {
    std::uint64_t offset = 0, checksum = 0;
    std::uint32_t bytes = 0;
    TileSize size;
  };
  std::vector<Place> places;  ///< of the tiles in the file
  /// RMS distance of the sample from this surface, mm.
  double rms_mm = 0.0;
  std::uint64_t tile_bytes = 0;  ///< of all tiles
};

/// Immutable once opened; thread-safe.
class SurfaceFile {
 public:
  /// Reads and checks the index. Errors name the file and what to do.
  [[nodiscard]] static Result<std::shared_ptr<const SurfaceFile>> open(const std::string& path);

  [[nodiscard]] const std::string& path() const noexcept { return file_.path(); }
  [[nodiscard]] std::uint64_t points() const noexcept { return points_; }
  [[nodiscard]] std::uint64_t bytes() const noexcept { return file_.size(); }
  /// A hash of the index, which holds the checksums of all tiles.
  [[nodiscard]] std::uint64_t content_hash() const noexcept { return content_hash_; }
  /// Points for boxes, paths and other renderers; its origin is that of the whole cloud.
  [[nodiscard]] const std::shared_ptr<const cloud::Cloud>& sample() const noexcept { return sample_; }
  /// The finest first.
  [[nodiscard]] const std::vector<StoredSurface>& surfaces() const noexcept { return surfaces_; }

  /// Memory for reading tiles, and the last.
  struct TileBuffer {
    std::vector<std::byte> image;
    TileCoder coder;
    UnpackedTile tile;
  };
  /// Reads and checks a tile. Thread-safe.
  [[nodiscard]] Status read_tile(std::size_t surface, std::size_t tile, TileBuffer& buffer) const;
  /// A surface whole in memory. O(bricks).
  [[nodiscard]] Result<std::shared_ptr<const SplineSdf>> load(std::size_t surface) const;

  /// Whether a file begins as one.
  [[nodiscard]] static bool begins_as_one(std::span<const std::byte> first_bytes) noexcept;

 private:
  explicit SurfaceFile(InputFile file) : file_(std::move(file)) {}
  Status read_index();

  InputFile file_;
  std::uint64_t points_ = 0, content_hash_ = 0;
  std::shared_ptr<const cloud::Cloud> sample_;
  std::vector<StoredSurface> surfaces_;
};

}  // namespace palpate::spline_sdf
