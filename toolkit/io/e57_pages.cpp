#include "toolkit/io/e57_pages.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "toolkit/core/bytes.h"
#include "toolkit/core/messages.h"

namespace palpate::io {
namespace {

constexpr const char* kFetchE57 = "the file is damaged or cut off: fetch it again";
// Pages read at once: as many as one word has bits to say which are checked.
constexpr std::uint64_t kPagesOfBlock = 64;
constexpr std::uint32_t kE57Major = 1;  // the only version of the standard

// Tables of a CRC that takes eight bytes at a time: [k][b] is what byte b does k bytes before the end.
constexpr std::size_t kCrcBytes = 8, kByteValues = 256;
using CrcTables = std::array<std::array<std::uint32_t, kByteValues>, kCrcBytes>;

constexpr CrcTables crc_tables() {
  constexpr std::uint32_t kCastagnoli = 0x82F63B78u;  // the polynomial 1EDC6F41, lowest bit first
  CrcTables tables{};
  for (std::uint32_t b = 0; b < kByteValues; ++b) {
    std::uint32_t rest = b;
    for (int bit = 0; bit < 8; ++bit) rest = (rest >> 1) ^ ((rest & 1u) != 0 ? kCastagnoli : 0u);
    tables[0][b] = rest;
  }
  for (std::size_t k = 1; k < kCrcBytes; ++k)
    for (std::size_t b = 0; b < kByteValues; ++b)
      tables[k][b] = (tables[k - 1][b] >> 8) ^ tables[0][tables[k - 1][b] & 0xFFu];
  return tables;
}

constexpr CrcTables kCrcTables = crc_tables();

Error damaged_header(std::string what) {
  return Error{std::move(what), kFetchE57};
}

}  // namespace

std::uint32_t crc32c(std::span<const std::byte> data) noexcept {
  std::uint32_t crc = 0xFFFFFFFFu;
  for (; data.size() >= kCrcBytes; data = data.subspan(kCrcBytes)) {
    std::uint32_t next = 0;
    for (std::size_t i = 0; i < kCrcBytes; ++i) {
      const auto b = static_cast<std::uint32_t>(data[i]) ^ (i < sizeof crc ? (crc >> (8 * i)) & 0xFFu : 0u);
      next ^= kCrcTables[kCrcBytes - 1 - i][b];
    }
    crc = next;
  }
  for (const std::byte b : data)
    crc = (crc >> 8) ^ kCrcTables[0][(crc ^ static_cast<std::uint32_t>(b)) & 0xFFu];
  return ~crc;
}

Result<E57Pages> E57Pages::open(const RandomAccess& file) {
  std::array<std::byte, kE57HeaderBytes> bytes{};
  const auto present = static_cast<std::size_t>(std::min<std::uint64_t>(file.size(), bytes.size()));
  PALPATE_TRY(file.read_at(0, std::span(bytes).first(present)));
  if (std::memcmp(bytes.data(), kE57Signature.data(), kE57Signature.size()) != 0)
    return Error{fmt::format("this is no E57 file: it does not start with {}", kE57Signature),
                 "check that the file is what its name says"};
  ByteReader header(std::span<const std::byte>(bytes).subspan(kE57Signature.size()));
  const std::uint32_t major = header.u32(), minor = header.u32();
  const std::uint64_t stated = header.u64(), xml_physical = header.u64(), xml_bytes = header.u64(),
                      page_bytes = header.u64();
  if (present == bytes.size()) {
    if (major != kE57Major)
      return Error{fmt::format("the E57 version {}.{} is not read", major, minor),
                   "convert it to version 1.0 with the program that wrote it"};
    if (page_bytes != kE57PageBytes)
      return damaged_header(
          fmt::format("the header states pages of {} bytes, the standard has {}", page_bytes, kE57PageBytes));
  }
  if (file.size() < kE57PageBytes)
    return damaged_header(
        fmt::format("the file has {} bytes, an E57 file at least {}", file.size(), kE57PageBytes));

  E57Pages pages(file);
  pages.pages_ = 1;
  PALPATE_TRY(pages.need_page(0));  // before the lengths are believed
  if (stated > file.size() || stated < kE57PageBytes || stated % kE57PageBytes != 0)
    return damaged_header(fmt::format("the header states {} bytes, the file has {}", stated, file.size()));
  pages.pages_ = stated / kE57PageBytes;
  pages.block_.clear();
  PALPATE_ASSIGN(pages.xml_at_, pages.logical_at(xml_physical, "the XML"));
  if (xml_bytes > pages.size() - pages.xml_at_)
    return damaged_header(fmt::format("the header states {} bytes of XML from byte {}, the file has {}",
                                      xml_bytes, xml_physical, stated));
  pages.xml_bytes_ = xml_bytes;
  return pages;
}

Status E57Pages::need_page(std::uint64_t page) {
  if (block_.empty() || page < first_ || page - first_ >= block_.size() / kE57PageBytes) {
    first_ = page;
    checked_ = 0;
    block_.resize(static_cast<std::size_t>(std::min(kPagesOfBlock, pages_ - page) * kE57PageBytes));
    if (Status got = file_->read_at(page * kE57PageBytes, block_); !got) {
      block_.clear();
      return got;
    }
  }
  const std::uint64_t bit = std::uint64_t{1} << (page - first_);
  if ((checked_ & bit) != 0) return Done{};
  const std::span<const std::byte> whole = std::span<const std::byte>(block_).subspan(
      static_cast<std::size_t>((page - first_) * kE57PageBytes), kE57PageBytes);
  std::uint32_t stored = 0;
  for (const std::byte b : whole.subspan(kE57PageContent))
    stored = stored << 8 | static_cast<std::uint32_t>(b);
  const std::uint32_t actual = crc32c(whole.first(kE57PageContent));
  if (stored != actual)
    return Error{fmt::format("the checksum of page {} (bytes {} to {}) is {:08x}, its content has {:08x}",
                             page + 1, page * kE57PageBytes, (page + 1) * kE57PageBytes - 1, stored, actual),
                 kFetchE57};
  checked_ |= bit;
  return Done{};
}

Status E57Pages::read(std::uint64_t logical, std::span<std::byte> out) {
  if (logical > size() || out.size() > size() - logical)
    return Error{fmt::format("the E57 file ends within {} bytes that start at byte {}", out.size(),
                             physical_at(logical)),
                 kFetchE57};
  while (!out.empty()) {
    const std::uint64_t page = logical / kE57PageContent, inside = logical % kE57PageContent;
    PALPATE_TRY(need_page(page));
    const auto n = static_cast<std::size_t>(std::min<std::uint64_t>(out.size(), kE57PageContent - inside));
    std::memcpy(out.data(), block_.data() + ((page - first_) * kE57PageBytes + inside), n);
    out = out.subspan(n);
    logical += n;
  }
  return Done{};
}

Result<std::uint64_t> E57Pages::logical_at(std::uint64_t physical, std::string_view what) const {
  const std::uint64_t page = physical / kE57PageBytes, inside = physical % kE57PageBytes;
  if (page >= pages_ || inside >= kE57PageContent)
    return Error{fmt::format("{} is said to start at byte {}, which is {}", what, physical,
                             page >= pages_ ? "behind the end of the file" : "within a checksum"),
                 kFetchE57};
  return page * kE57PageContent + inside;
}

}  // namespace palpate::io
