// The chunks of a surface on disk, as it is made: each is a record with a hash, so that the next run goes on
// after the last whole one. In the end their bricks are cut into the tiles of the whole.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "toolkit/prepared/scratch_files.h"
#include "toolkit/spline_sdf/surface_chunk.h"
#include "toolkit/spline_sdf/surface_file.h"

namespace palpate::prepared {

/// Movable, not thread-safe but for reading.
class ChunkScratch final : public spline_sdf::StoredChunks {
 public:
  /// Keeps what a run with the same key has left, without bricks; else begins anew. `key`: a hash of all that
  /// the chunks depend on; `lattice`: of the surface. A second user is an Error.
  [[nodiscard]] static Result<ChunkScratch> open(const std::string& path, std::uint64_t key,
                                                 const spline_sdf::BrickGrid& lattice);
  /// Writes a chunk, its own bricks in packed tiles, and forgets these.
  [[nodiscard]] Status add(spline_sdf::SurfaceChunk chunk);
  [[nodiscard]] const std::vector<spline_sdf::SurfaceChunk>& chunks() const noexcept override {
    return chunks_;
  }
  [[nodiscard]] const spline_sdf::LevelCounts& counts(std::size_t chunk) const override {
    return places_[chunk].counts;
  }
  [[nodiscard]] Status read_own(std::size_t chunk, std::size_t first, std::size_t count,
                                std::vector<spline_sdf::ChunkBrick>& out) const override;
  /// Own bricks of all chunks.
  [[nodiscard]] std::uint64_t bricks() const noexcept;
  /// Cuts a chunk's own bricks into the tiles that it is packed in, whose bricks are numbers in `own`. A
  /// brick above tiles has one alone.
  using VisitTile = std::function<Status(const spline_sdf::BrickTile&)>;
  [[nodiscard]] Status cut(std::span<const spline_sdf::ChunkBrick> own, const VisitTile& tile) const;
  /// Unpacks a chunk's tile, by the number and key that cut() gave it.
  [[nodiscard]] Status read_tile(std::size_t chunk, std::size_t tile, spline_sdf::TileKey key,
                                 spline_sdf::SurfaceFile::TileBuffer& out) const;
  void remove() const noexcept { file_.remove(); }

 private:
  ChunkScratch(PartFile file, spline_sdf::BrickGrid lattice)
      : file_(std::move(file)), lattice_(std::move(lattice)) {}
  [[nodiscard]] Status begin_anew(std::uint64_t key);
  /// False where what follows is no whole record.
  [[nodiscard]] Result<bool> read_record(std::uint64_t file_size);

  PartFile file_;
  spline_sdf::BrickGrid lattice_;  ///< with all levels
  std::uint64_t end_ = 0;
  /// Offsets of a chunk's own bricks, without their distances and in tiles.
  struct Place {
    spline_sdf::LevelCounts counts{};
    std::uint64_t own_at = 0;
    std::vector<std::uint64_t> tiles_at;  ///< and of their end
  };
  void keep(spline_sdf::SurfaceChunk chunk, std::span<const std::uint32_t> tiles, std::uint64_t record_bytes);
  std::vector<spline_sdf::SurfaceChunk> chunks_;
  std::vector<Place> places_;  ///< by chunk
};

/// Cuts the bricks of all chunks into tiles, chunk after chunk: a chunk's region and a tile's node are both
/// whole ranges of the Morton curve, so that one holds the other or they are apart.
class ChunkTiles {
 public:
  /// `grid`: with the number of levels. Both outlive it.
  ChunkTiles(const ChunkScratch& scratch, const spline_sdf::BrickGrid& grid);
  [[nodiscard]] Status cut(const spline_sdf::TileSink& sink) { return cut({}, 0, firsts_.size() - 1, sink); }
  /// A brick that the sink is being given.
  [[nodiscard]] Status read(std::uint32_t number, const spline_sdf::JoinedChunks& joined,
                            spline_sdf::Brick& out);

 private:
  struct Loaded {
    struct Place {
      std::uint32_t tile = 0, at = 0;  ///< where it is packed
      std::uint32_t piece = 0;         ///< of the chunk
    };
    std::vector<spline_sdf::PlacedBrick> placed;  ///< sorted
    std::vector<Place> places;                    ///< by brick
    std::vector<spline_sdf::TileKey> keys;        ///< of the packed tiles
  };
  [[nodiscard]] std::uint64_t first_code(std::size_t chunk) const;
  Status load(std::size_t chunk);
  [[nodiscard]] std::pair<std::size_t, std::size_t> chunks_in(spline_sdf::TileKey node, std::size_t first,
                                                              std::size_t past) const;
  Status cut(spline_sdf::TileKey node, std::size_t first, std::size_t past, const spline_sdf::TileSink& sink);

  const ChunkScratch& scratch_;
  const spline_sdf::BrickGrid& grid_;
  std::vector<std::uint32_t> firsts_;  ///< number of each chunk's first brick, and of all
  std::map<std::size_t, Loaded> loaded_;
  static constexpr std::pair<std::size_t, std::size_t> kNoTile{SIZE_MAX, 0};
  std::pair<std::size_t, std::size_t> unpacked_ = kNoTile;  ///< chunk and tile in the buffer
  spline_sdf::SurfaceFile::TileBuffer buffer_;
};

}  // namespace palpate::prepared
