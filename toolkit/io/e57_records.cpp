#include "toolkit/io/e57_records.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "toolkit/core/bytes.h"

namespace palpate::io {
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
