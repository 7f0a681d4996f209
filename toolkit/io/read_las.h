// Reads LAS and LAZ files, whole or in pieces.
//
// Chunks of LAZ are decoded several at once. LasPoints gives points as they stand in the file, from front to
// back; its memory is bounded by the pieces, whatever the file promises.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/las_header.h"
#include "toolkit/io/point_stream.h"
#include "toolkit/laz/chunk_decoder.h"

namespace palpate::io {

/// The points of a file as they stand in it. Not thread-safe. Errors name the byte, not the file.
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
  /// Points that the file has room for, where that is known without decoding.
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

/// Versions 1.0 to 1.4 and point formats 0 to 10, plain, as LAZ and as COPC. Properties are intensity, and
/// red, green and blue where the format has them, as the file has them (0 to 65535). Errors name `name` and
/// the byte.
[[nodiscard]] Result<DecodedFile> read_las(const RandomAccess& file, const std::string& name,
                                           const ReadOptions& options, Progress& progress);

/// The same as a Reader (read_model.h), from bytes that come one after the other: they are held as a whole.
[[nodiscard]] Result<DecodedFile> read_las_bytes(const ReaderInput& input);

/// Points in pieces. `threads` decode chunks of LAZ; 0 is all of the machine's. `name` is for messages.
[[nodiscard]] Result<std::unique_ptr<PointStream>> las_stream(std::unique_ptr<RandomAccess> file,
                                                              const std::string& name, int threads);

}  // namespace palpate::io
