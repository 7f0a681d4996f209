// The scratch file of a surface that is made chunk by chunk: each chunk is a record with a hash, so that the
// next run goes on after the last whole one. A record half written is none.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/result.h>
#include "toolkit/prepared/point_scratch.h"
#include "toolkit/spline_sdf/surface_chunk.h"

namespace palpate::prepared {

/// Movable, not thread-safe but for read_brick().
class ChunkScratch {
 public:
  /// Keeps what a run with the same key has left, without bricks; else begins anew. `key`: a hash of all that
  /// the chunks depend on. A second user is an Error.
  [[nodiscard]] static Result<ChunkScratch> open(const std::string& path, std::uint64_t key);
  /// Writes a chunk and forgets its bricks.
  [[nodiscard]] Status add(render::SurfaceChunk chunk);
  [[nodiscard]] const std::vector<render::SurfaceChunk>& chunks() const noexcept { return chunks_; }
  [[nodiscard]] Status read_brick(std::size_t chunk, std::size_t brick, render::Brick& out) const;
  void remove() const noexcept { file_.remove(); }

 private:
  explicit ChunkScratch(PartFile file) : file_(std::move(file)) {}
  [[nodiscard]] Status begin_anew(std::uint64_t key);
  /// False where what follows is no whole record.
  [[nodiscard]] Result<bool> read_record(std::uint64_t file_size);

  PartFile file_;
  std::uint64_t end_ = 0;
  std::vector<render::SurfaceChunk> chunks_;
  std::vector<std::uint64_t> bricks_at_;  ///< by chunk: offset of its bricks
};

}  // namespace palpate::prepared
