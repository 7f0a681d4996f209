// Finds and decodes the chunks of a LAZ file.
//
// The record "laszip encoded" 22204 of the file's header (LASzip's specification) says how points are
// compressed, the table behind the points where the chunks stand. Nothing in either is believed: counts and
// offsets are checked against the record, the points and the file. Chunks are decoded in pieces: one of a few
// bytes may promise billions of points.
//
// First:
//   PALPATE_ASSIGN(palpate::laz::ChunkDecoder decoder,
//                  palpate::laz::ChunkDecoder::open(how, chunk, std::move(bytes)));
//   std::vector<std::byte> points(1000 * how.point_bytes);
//   PALPATE_TRY(decoder.decode(points));
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <palpate/result.h>
#include "toolkit/laz/items.h"

namespace palpate::laz {

inline constexpr const char* kLaszipUser = "laszip encoded";
inline constexpr std::uint16_t kLaszipRecord = 22204;

/// The remedy where a file contradicts itself.
inline constexpr const char* kFetchAgain = "the file is damaged: copy or fetch it again";

struct Compression {
  bool layered = false;
  std::uint32_t chunk_points = 0;  ///< 0: chunks say how many they hold
  std::vector<Item> items;         ///< one after the other in a point
  std::size_t point_bytes = 0;
};

/// The Compression that a record describes, for points of `point_bytes` whose format has `point_items` in
/// front of bytes of unknown meaning. `at`: where the record stands in the file, for Errors.
[[nodiscard]] Result<Compression> read_compression(std::span<const std::byte> record, std::uint64_t at,
                                                   std::size_t point_bytes, bool with_layers);

/// Extent of one chunk in the file.
struct Chunk {
  std::uint64_t at = 0, bytes = 0;
  std::uint64_t points = 0;
};

/// Bytes of the table's start that do not depend on the count of chunks, and the most that a chunk then
/// takes: two numbers of 32 bits, each behind a symbol of at most 15 bits.
inline constexpr std::size_t kChunkTableStart = 8;
inline constexpr std::size_t kMostTableBytesPerChunk = 2 * 6;
/// Bytes that the coder writes behind the last number.
inline constexpr std::size_t kChunkTableEnd = 8;

/// Number of chunks that a table of `points` may have, between `first_chunk` and the table at `table_at`;
/// from the table's first kChunkTableStart bytes.
[[nodiscard]] Result<std::uint32_t> read_chunk_count(std::span<const std::byte> start, const Compression& how,
                                                     std::uint64_t first_chunk, std::uint64_t table_at);

/// The chunks that hold `points`, from the table's bytes behind its start.
[[nodiscard]] Result<std::vector<Chunk>> read_chunk_table(std::span<const std::byte> table,
                                                          std::uint32_t chunks, const Compression& how,
                                                          std::uint64_t first_chunk, std::uint64_t table_at,
                                                          std::uint64_t points);

/// Movable, not thread-safe; chunks do not depend on each other, so several may be decoded at once.
class ChunkDecoder {
 public:
  /// `bytes`: all of the chunk's. Errors name `chunk`'s place in the file.
  [[nodiscard]] static Result<ChunkDecoder> open(const Compression& how, const Chunk& chunk,
                                                 std::vector<std::byte> bytes);

  [[nodiscard]] std::uint64_t points_left() const noexcept { return chunk_.points - decoded_; }
  /// The next points, as a LAS file holds them; `points` is a whole number of them, at most points_left().
  /// After an Error what `points` holds means nothing.
  [[nodiscard]] Status decode(std::span<std::byte> points);

 private:
  ChunkDecoder() = default;
  [[nodiscard]] Status open_pointwise(const Compression& how);
  [[nodiscard]] Status open_layered(const Compression& how);
  [[nodiscard]] Error damaged() const;

  Chunk chunk_;
  std::vector<std::byte> bytes_;  ///< its memory stays where it is when this object moves
  std::size_t point_bytes_ = 0;
  std::uint64_t decoded_ = 0;
  std::vector<std::size_t> item_bytes_;
  ArithmeticDecoder stream_;                               ///< of all pointwise items
  std::vector<std::unique_ptr<PointwiseItem>> pointwise_;  ///< or
  std::vector<std::unique_ptr<LayeredItem>> layered_;
  std::uint32_t channel_ = 0;
};

}  // namespace palpate::laz
