// Decodes one chunk of a LAZ file, in pieces: a chunk of a few bytes may promise billions of points, and
// nobody holds them.
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
#include <vector>

#include <palpate/result.h>
#include "toolkit/laz/compression.h"
#include "toolkit/laz/items.h"

namespace palpate::laz {

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
