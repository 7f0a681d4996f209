// LAS files made in memory, and LAZ files from disk, for the tests, of points with everything that a scanner
// may give them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <palpate/result.h>
#include "toolkit/io/byte_source.h"

namespace palpate::test {

struct LasFile {
  std::uint8_t minor = 4, format = 0;
  std::vector<std::byte> points;   ///< whole records
  std::vector<std::byte> records;  ///< VLRs, heads included
  std::uint32_t record_count = 0;
};

[[nodiscard]] std::size_t las_point_bytes(std::uint8_t format) noexcept;
/// Points along scan lines, with several returns, channels, flight lines and rare jumps.
[[nodiscard]] std::vector<std::byte> scanned_points(std::uint8_t format, std::size_t extra_bytes,
                                                    std::size_t count, std::uint64_t seed);
void add_record(LasFile& file, const std::string& user, std::uint16_t number,
                std::span<const std::byte> content);
/// The file's bytes: scales of 0.01, offsets of 100, 200 and 300.
[[nodiscard]] std::vector<std::byte> las_bytes(const LasFile& file);

/// LAZ files of tests/corpus/io/laz hold kLazPoints scanned_points of seed 7 + format: "6.laz" in chunks of
/// 500, "6_extra.laz" with three more bytes a point in chunks of their own lengths; "same_8.laz" one point
/// over and over in a single chunk; "8_v4.laz" is "8_extra.laz" by version 4 of the layered items.
inline constexpr std::size_t kLazPoints = 800, kLazChunk = 500, kLazExtraBytes = 3;
[[nodiscard]] std::vector<std::byte> laz_bytes(const std::string& name);
[[nodiscard]] std::vector<std::byte> laz_points(std::uint8_t format, std::size_t extra_bytes);

/// All points as they stand in a LAS or LAZ file, or decoded to that.
[[nodiscard]] Result<std::vector<std::byte>> raw_points(const io::RandomAccess& file, int threads);

/// Expects what holds for any bytes: an Error with a remedy, or as many points as the header promises.
void expect_harmless(std::span<const std::byte> bytes);

}  // namespace palpate::test
