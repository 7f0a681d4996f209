#include "toolkit/io/e57_binary.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>

#include "toolkit/core/bytes.h"
#include "toolkit/core/messages.h"

namespace palpate::io {

// ---- pages

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

// ---- records

namespace {

constexpr const char* kFetchSection = "the file is damaged: fetch it again, or export it again";
constexpr std::uint8_t kSectionOfRecords = 1;
constexpr std::uint64_t kSectionHeaderBytes = 32;

// Packets of a section. All begin with type, flags and length - 1, and have a multiple of four bytes.
constexpr std::uint8_t kIndexPacket = 0, kDataPacket = 1, kEmptyPacket = 2;
constexpr std::size_t kPacketHeadBytes = 4, kPacketStep = 4;
constexpr std::size_t kStreamLengthBytes = 2;
// A data packet has the number of its streams behind the head, then their lengths.
constexpr std::size_t kDataHeadBytes = kPacketHeadBytes + 2;

constexpr unsigned kByteBits = 8;
// A value of up to 64 bits that begins within a byte reaches into a ninth.
constexpr std::size_t kZerosBehind = 9;

// Bits `bit` to `bit` + `bits` of a stream, lowest first; kZerosBehind bytes can be read from there on.
std::uint64_t bits_at(const std::byte* stream, std::size_t bit, unsigned bits) noexcept {
  const std::byte* at = stream + bit / kByteBits;
  const unsigned shift = static_cast<unsigned>(bit % kByteBits);
  std::uint64_t word = 0;
  if constexpr (std::endian::native == std::endian::little) {
    std::memcpy(&word, at, sizeof word);
  } else {
    for (std::size_t i = sizeof word; i-- > 0;) word = word << kByteBits | static_cast<std::uint64_t>(at[i]);
  }
  constexpr unsigned kWordBits = 64;
  word >>= shift;
  if (shift + bits > kWordBits) word |= static_cast<std::uint64_t>(at[sizeof word]) << (kWordBits - shift);
  return bits == kWordBits ? word : word & ((std::uint64_t{1} << bits) - 1);
}

double value_of(const E57Field& field, std::uint64_t bits) noexcept {
  switch (field.type) {
    case E57Type::kSingle:
      return static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(bits)));
    case E57Type::kDouble:
      return std::bit_cast<double>(bits);
    default:
      break;
  }
  // Without sign the sum may pass the end and comes back to what the limits mean.
  const auto whole =
      static_cast<double>(static_cast<std::int64_t>(static_cast<std::uint64_t>(field.minimum) + bits));
  return field.type == E57Type::kScaledInteger ? whole * field.scale + field.offset : whole;
}

}  // namespace

Result<E57Records> E57Records::open(E57Pages& pages, const E57Scan& scan,
                                    const std::vector<std::size_t>& wanted) {
  E57Records records(pages, scan);
  PALPATE_TRY(records.check_section());
  for (const std::size_t field : wanted) {
    E57Cursor& cursor = records.cursors_.emplace_back();
    cursor.field = field;
    cursor.next_packet = records.begin_;
  }
  return records;
}

Status E57Records::check_section() {
  const std::string what = fmt::format("the binary section of {}", scan_->name);
  PALPATE_ASSIGN(const std::uint64_t section, pages_->logical_at(scan_->section, what));
  std::array<std::byte, kSectionHeaderBytes> bytes{};
  PALPATE_TRY(pages_->read(section, bytes));
  ByteReader header{std::span<const std::byte>(bytes)};
  const std::uint8_t id = header.u8();
  constexpr std::size_t kReserved = 7;
  (void)header.raw(kReserved);
  const std::uint64_t length = header.u64(), data = header.u64();
  if (id != kSectionOfRecords || scan_->section < kE57HeaderBytes)
    return Error{fmt::format("{} does not stand at byte {}, where the XML says", what, scan_->section),
                 kFetchSection};
  if (length < kSectionHeaderBytes || length > pages_->size() - section)
    return Error{fmt::format("{} (byte {}) states a length of {}, the file has {} bytes from there", what,
                             scan_->section, length, pages_->size() - section),
                 kFetchSection};
  end_ = section + length;
  if (scan_->records == 0) return Done{};  // where no packets are, nothing need be right
  PALPATE_ASSIGN(begin_, pages_->logical_at(data, fmt::format("the data of {}", scan_->name)));
  if (begin_ < section + kSectionHeaderBytes || begin_ >= end_)
    return Error{
        fmt::format("the data of {} is said to start at byte {}, outside its section", scan_->name, data),
        kFetchSection};
  std::uint64_t record_bits = 0;
  for (const E57Field& field : scan_->fields) record_bits += field.bits;
  if (record_bits == 0 || scan_->records > (end_ - begin_) * kByteBits / record_bits)
    return Error{fmt::format("{} promises {} records of {} bits, its section has {} bytes", scan_->name,
                             scan_->records, record_bits, end_ - begin_),
                 kFetchSection};
  return Done{};
}

// Leaves a data packet in packet_, checked; false for a packet of another kind, of which only the head is
// there.
Result<bool> E57Records::load_packet(std::uint64_t at) {
  if (packet_at_ == at) return packet_[0] == std::byte{kDataPacket};
  packet_at_ = 0;
  const auto bad = [&](std::string what) {
    return Error{fmt::format("the packet of {} at byte {} {}", scan_->name, E57Pages::physical_at(at), what),
                 kFetchSection};
  };
  if (end_ - at < kPacketHeadBytes) return bad("is cut off by the end of its section");
  packet_.resize(kPacketHeadBytes);
  PALPATE_TRY(pages_->read(at, packet_));
  ByteReader head{std::span<const std::byte>(packet_)};
  const std::uint8_t type = head.u8();
  (void)head.u8();  // flags
  const std::size_t length = std::size_t{head.u16()} + 1;
  if (type != kIndexPacket && type != kDataPacket && type != kEmptyPacket)
    return bad(fmt::format("has the unknown type {}", type));
  if (length % kPacketStep != 0 || length > end_ - at)
    return bad(fmt::format("has {} bytes, {} are left of its section", length, end_ - at));
  packet_.resize(length);
  if (type == kDataPacket) {
    PALPATE_TRY(pages_->read(at + kPacketHeadBytes, std::span(packet_).subspan(kPacketHeadBytes)));
    ByteReader data{std::span<const std::byte>(packet_).subspan(kPacketHeadBytes)};
    const std::size_t streams = data.u16();
    if (streams != scan_->fields.size())
      return bad(fmt::format("has {} streams, its prototype {} fields", streams, scan_->fields.size()));
    std::uint64_t total = kDataHeadBytes + streams * kStreamLengthBytes;
    for (std::size_t i = 0; i < streams; ++i) total += data.u16();
    if (!data.good() || total > length)
      return bad(fmt::format("has {} bytes, its streams need {}", length, total));
  }
  packet_at_ = at;
  return type == kDataPacket;
}

// Puts the stream's piece of the next data packet behind what is left.
Status E57Records::advance(E57Cursor& cursor) {
  while (true) {
    if (cursor.next_packet >= end_)
      return Error{
          fmt::format("the packets of {} end within its {} promised records: the field '{}' is short",
                      scan_->name, scan_->records, scan_->fields[cursor.field].name),
          kFetchSection};
    PALPATE_ASSIGN(const bool has_data, load_packet(cursor.next_packet));
    cursor.next_packet += packet_.size();
    if (has_data) break;
  }
  ByteReader lengths{std::span<const std::byte>(packet_).subspan(kDataHeadBytes)};
  std::size_t at = kDataHeadBytes + scan_->fields.size() * kStreamLengthBytes;
  for (std::size_t i = 0; i < cursor.field; ++i) at += lengths.u16();
  const std::size_t length = lengths.u16();

  const std::size_t taken = cursor.bit / kByteBits;
  cursor.bytes.erase(cursor.bytes.begin(), cursor.bytes.begin() + static_cast<std::ptrdiff_t>(taken));
  cursor.bit %= kByteBits;
  cursor.length -= taken;
  cursor.bytes.resize(cursor.length + length + kZerosBehind);
  std::memcpy(cursor.bytes.data() + cursor.length, packet_.data() + at, length);
  cursor.length += length;
  std::fill(cursor.bytes.end() - kZerosBehind, cursor.bytes.end(), std::byte{0});
  return Done{};
}

void E57Records::take(E57Cursor& cursor, std::span<double> values) const {
  const E57Field& field = scan_->fields[cursor.field];
  for (double& value : values) {
    value = value_of(field, field.bits == 0 ? 0 : bits_at(cursor.bytes.data(), cursor.bit, field.bits));
    cursor.bit += field.bits;
  }
}

Result<std::size_t> E57Records::next(std::size_t most, std::span<std::vector<double>> columns) {
  std::size_t n = static_cast<std::size_t>(std::min<std::uint64_t>(most, left()));
  if (n == 0) return n;
  for (E57Cursor& cursor : cursors_) {
    const unsigned bits = scan_->fields[cursor.field].bits;
    if (bits == 0) continue;  // has no bytes, for any number of records
    while (cursor.length * kByteBits - cursor.bit < bits) PALPATE_TRY(advance(cursor));
    n = std::min(n, (cursor.length * kByteBits - cursor.bit) / bits);
  }
  for (std::size_t i = 0; i < cursors_.size(); ++i) {
    columns[i].resize(n);
    take(cursors_[i], columns[i]);
  }
  taken_ += n;
  return n;
}

}  // namespace palpate::io
