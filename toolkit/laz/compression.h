// Compression of a LAZ file, and places of its chunks. Both come from the record "laszip encoded" 22204 of
// its header (LASzip's specification) and the table behind its points. Nothing in either is believed: counts
// and places are held against the record, the points and the file.
#pragma once

#include <cstddef>
#include <cstdint>
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

/// Of one chunk in the file.
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

/// Number of chunks of a table of `points`, between `first_chunk` and the table at `table_at`; from the
/// table's first kChunkTableStart bytes.
[[nodiscard]] Result<std::uint32_t> read_chunk_count(std::span<const std::byte> start, const Compression& how,
                                                     std::uint64_t first_chunk, std::uint64_t table_at);

/// The chunks that hold `points`, from the table's bytes behind its start.
[[nodiscard]] Result<std::vector<Chunk>> read_chunk_table(std::span<const std::byte> table,
                                                          std::uint32_t chunks, const Compression& how,
                                                          std::uint64_t first_chunk, std::uint64_t table_at,
                                                          std::uint64_t points);

}  // namespace palpate::laz
