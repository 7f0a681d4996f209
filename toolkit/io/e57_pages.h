// The outer shell of an E57 file (ASTM E2807): a header, and pages that each end in a checksum. Offsets are
// "physical" with the checksums, as most of the file's own are, or "logical" without them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include <palpate/result.h>
#include "toolkit/io/byte_source.h"

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

}  // namespace palpate::io
