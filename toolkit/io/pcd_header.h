// A PCD file's header, checked before PCL sees it. PCL believes a header, and 156 bytes of it can make PCL
// take gigabytes. Free of PCL, so that it can be fuzzed alone; used by toolkit/pcd.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <palpate/read_model.h>
#include <palpate/result.h>

namespace palpate::io {

enum class PcdData { kAscii, kBinary, kCompressed };

struct PcdField {
  std::string name;         ///< "_" is padding
  std::uint32_t bytes = 0;  ///< of one value: 1, 2, 4 or 8
  char type = 'F';          ///< F, I or U
  std::uint32_t count = 1;
};

struct PcdHeader {
  std::vector<PcdField> fields;
  std::uint32_t width = 0;
  std::uint32_t height = 0;  ///< more than 1: organised, row after row
  PcdData data = PcdData::kAscii;
  std::uint64_t point_bytes = 0;
  std::size_t body_at = 0;     ///< where the header ends in the file
  bool cr_ends_lines = false;  ///< of an ASCII body, which PCL cuts at \n alone
  /// The header in our own words, ending with its DATA line: what PCL is given instead of the file's.
  std::string canonical;

  [[nodiscard]] std::uint64_t points() const noexcept { return std::uint64_t{width} * height; }
};

/// The header alone, from a file's first bytes: its body may be longer than memory, and is not looked at.
[[nodiscard]] Result<PcdHeader> parse_pcd_header(std::span<const std::byte> begin);

/// Parses the header and checks it against all of the file's bytes: the promised points fit into what follows
/// and into options.max_bytes; the sizes of compressed data agree with the header, with the file, and with
/// what LZF can unpack; every row of an ASCII file has its numbers. x, y and z are there. O(file).
[[nodiscard]] Result<PcdHeader> check_pcd(std::span<const std::byte> file, const ReadOptions& options);

}  // namespace palpate::io
