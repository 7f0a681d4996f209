// The points of a LAS or LAZ file as they stand in it, in pieces from front to back. Chunks of LAZ are
// decoded several at once; memory is bounded by the pieces, whatever the file promises.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <palpate/result.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/las_header.h"
#include "toolkit/laz/chunk_decoder.h"

namespace palpate::io {

/// Not thread-safe. Errors name the byte, not the file.
class LasPoints {
 public:
  /// Keeps `file` and `header`, which outlive it. `threads`: 0 is all of the machine's.
  [[nodiscard]] static Result<LasPoints> open(const RandomAccess& file, const LasHeader& header, int threads);

  /// Whole points of header.point_bytes each; empty at the end. Valid until the next call. A damaged or cut
  /// file gives the points before the damage, then an Error.
  [[nodiscard]] Result<std::span<const std::byte>> next();
  /// Begins again at the first point.
  void rewind() noexcept;
  [[nodiscard]] std::uint64_t points_given() const noexcept { return given_; }
  /// Points that the file has room for, where that can be told without decoding.
  [[nodiscard]] std::uint64_t points() const noexcept { return points_; }

 private:
  LasPoints(const RandomAccess& file, const LasHeader& header, int threads);
  [[nodiscard]] Status find_chunks();
  [[nodiscard]] Result<std::span<const std::byte>> next_plain();
  [[nodiscard]] Result<std::span<const std::byte>> next_decoded();
  [[nodiscard]] Result<std::span<const std::byte>> next_of_long_chunk();
  [[nodiscard]] Result<laz::ChunkDecoder> open_chunk(const laz::Chunk& chunk) const;
  void decode_batch();

  const RandomAccess* file_;
  const LasHeader* header_;
  int threads_;
  std::uint64_t points_ = 0, given_ = 0;
  std::uint64_t piece_points_;  ///< the most of one piece
  std::vector<laz::Chunk> chunks_;
  std::size_t next_chunk_ = 0;
  std::optional<laz::ChunkDecoder> long_chunk_;  ///< one that is longer than a piece
  std::vector<std::vector<std::byte>> batch_;    ///< decoded chunks, or the one piece
  std::size_t next_in_batch_ = 0;
  std::optional<Error> error_;  ///< of the chunk behind the batch
};

}  // namespace palpate::io
