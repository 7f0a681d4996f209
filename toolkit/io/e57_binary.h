// Reads the pages and the records of an E57 file.
//
// ASTM E2807: a header, and pages that each end in a checksum. Offsets are "physical" with the checksums, as
// most of the file's own are, or "logical" without them. A scan's points are a section of packets that each
// hold a piece of every field's stream of bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include <palpate/result.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/e57_scans.h"

namespace palpate::io {

/// The standard has this one size of a page, and a checksum of four bytes at its end.
inline constexpr std::uint64_t kE57PageBytes = 1024;
inline constexpr std::uint64_t kE57PageContent = kE57PageBytes - sizeof(std::uint32_t);
inline constexpr std::string_view kE57Signature = "ASTM-E57";
inline constexpr std::uint64_t kE57HeaderBytes = 48;

/// CRC-32C (Castagnoli; RFC 3720), which a page holds of its content with the highest byte first.
[[nodiscard]] std::uint32_t crc32c(std::span<const std::byte> data) noexcept;

/// Content of the pages by logical offset, each page checked when it is first needed. Holds 64 KiB of the
/// file, which is kept alive by the caller. Not thread-safe.
class E57Pages {
 public:
  /// Reads and checks the header; the file may go on behind the length that it states.
  [[nodiscard]] static Result<E57Pages> open(const RandomAccess& file);

  /// Logical bytes of the file.
  [[nodiscard]] std::uint64_t size() const noexcept { return pages_ * kE57PageContent; }
  /// Where the XML stands, logical; it lies within size().
  [[nodiscard]] std::uint64_t xml_at() const noexcept { return xml_at_; }
  [[nodiscard]] std::uint64_t xml_bytes() const noexcept { return xml_bytes_; }

  /// Fills all of `out`. The Error of a damaged page names its bytes in the file.
  [[nodiscard]] Status read(std::uint64_t logical, std::span<std::byte> out);

  /// The logical place of a physical offset: an Error behind the end and within a checksum. `what` stands
  /// there, "the XML".
  [[nodiscard]] Result<std::uint64_t> logical_at(std::uint64_t physical, std::string_view what) const;
  [[nodiscard]] static constexpr std::uint64_t physical_at(std::uint64_t logical) noexcept {
    return logical / kE57PageContent * kE57PageBytes + logical % kE57PageContent;
  }

 private:
  explicit E57Pages(const RandomAccess& file) : file_(&file) {}
  Status need_page(std::uint64_t page);

  const RandomAccess* file_;
  std::uint64_t pages_ = 0;
  std::uint64_t xml_at_ = 0;
  std::uint64_t xml_bytes_ = 0;
  std::vector<std::byte> block_;  // some pages from first_ on
  std::uint64_t first_ = 0;
  std::uint64_t checked_ = 0;  // a bit for each page of the block
};

/// Where one field's stream stands. Streams need not advance alike: a packet may hold much of one and none of
/// another, so each goes through the packets for itself.
struct E57Cursor {
  std::size_t field = 0;           ///< in the prototype
  std::uint64_t next_packet = 0;   ///< logical offset
  std::vector<std::byte> bytes{};  ///< of the stream, not taken yet, and some zeros behind
  std::size_t length = 0;          ///< of `bytes` without the zeros
  std::size_t bit = 0;             ///< the first of `bytes` that is not taken
};

/// Values of chosen fields from the first record to the last. Holds one packet and for each chosen field at
/// most one more, 64 KiB each. `pages` and `scan` are kept alive by the caller.
class E57Records {
 public:
  /// Checks the section's header and that the promised records fit its bytes. `wanted` are numbers.
  [[nodiscard]] static Result<E57Records> open(E57Pages& pages, const E57Scan& scan,
                                               const std::vector<std::size_t>& wanted);

  [[nodiscard]] std::uint64_t left() const noexcept { return scan_->records - taken_; }
  /// The next records, at most `most` and as many as the loaded packets hold of all fields: columns[i] gets
  /// the values of the i-th wanted field. Returns how many, 0 only at the end.
  [[nodiscard]] Result<std::size_t> next(std::size_t most, std::span<std::vector<double>> columns);

 private:
  E57Records(E57Pages& pages, const E57Scan& scan) : pages_(&pages), scan_(&scan) {}
  Status check_section();
  Result<bool> load_packet(std::uint64_t at);
  Status advance(E57Cursor& cursor);
  void take(E57Cursor& cursor, std::span<double> values) const;

  E57Pages* pages_;
  const E57Scan* scan_;
  std::vector<E57Cursor> cursors_;
  std::uint64_t begin_ = 0;  // of the packets, logical
  std::uint64_t end_ = 0;
  std::uint64_t taken_ = 0;
  std::vector<std::byte> packet_;
  std::uint64_t packet_at_ = 0;  // 0: none is loaded, as the file's header stands there
};

}  // namespace palpate::io
