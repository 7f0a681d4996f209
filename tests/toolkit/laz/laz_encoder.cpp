#include "tests/toolkit/laz/laz_encoder.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "toolkit/core/bytes.h"
#include "toolkit/laz/field_decoders.h"

namespace palpate::laz::test {
namespace {

void put(std::vector<std::byte>& out, std::uint64_t value, std::size_t bytes) {
  for (std::size_t i = 0; i < bytes; ++i) out.push_back(static_cast<std::byte>(value >> (8 * i) & 0xFFu));
}

}  // namespace

void ArithmeticEncoder::add(std::uint32_t to_base) {
  const std::uint32_t before = base_;
  base_ += to_base;
  if (base_ >= before) return;
  std::size_t at = out_.size();
  while (out_[--at] == std::byte{0xFF}) out_[at] = std::byte{0};
  out_[at] = static_cast<std::byte>(static_cast<std::uint32_t>(out_[at]) + 1);
}

void ArithmeticEncoder::give_out() {
  while (length_ < kShortestInterval) {
    out_.push_back(static_cast<std::byte>(base_ >> 24));
    base_ <<= 8;
    length_ <<= 8;
  }
}

void ArithmeticEncoder::symbol(SymbolModel& model, std::uint32_t symbol) {
  const std::uint32_t unit = length_ >> kSymbolShift;
  const std::uint32_t begin = model.share_below(symbol) * unit;
  const std::uint32_t end = symbol + 1 == model.symbols() ? length_ : model.share_below(symbol + 1) * unit;
  length_ = end - begin;
  add(begin);
  give_out();
  model.count(symbol);
}

void ArithmeticEncoder::bit(BitModel& model, bool bit) {
  const std::uint32_t zero = model.zero_share() * (length_ >> kBitShift);
  if (bit) {
    length_ -= zero;
    add(zero);
  } else {
    length_ = zero;
  }
  give_out();
  model.count(bit);
}

void ArithmeticEncoder::few_bits(std::uint32_t value, std::uint32_t count) {
  length_ >>= count;
  add(value * length_);
  give_out();
}

void ArithmeticEncoder::bits(std::uint32_t value, std::uint32_t count) {
  if (count > 19) {
    few_bits(value & 0xFFFFu, 16);
    value >>= 16;
    count -= 16;
  }
  few_bits(value, count);
}

std::vector<std::byte> ArithmeticEncoder::finish() {
  const bool another_byte = length_ > 2 * kShortestInterval;
  if (another_byte) {
    add(kShortestInterval);
    length_ = kShortestInterval >> 1;
  } else {
    add(kShortestInterval >> 1);
    length_ = kShortestInterval >> 9;
  }
  give_out();
  for (int i = 0; i < (another_byte ? 3 : 2); ++i) out_.push_back(std::byte{0});
  return std::move(out_);
}

void NumberEncoder::encode(ArithmeticEncoder& encoder, std::int32_t predicted, std::int32_t number,
                           std::size_t context) {
  auto difference =
      static_cast<std::int32_t>(static_cast<std::uint32_t>(number) - static_cast<std::uint32_t>(predicted));
  if (bits_ < 32) {
    const std::int32_t range = std::int32_t{1} << bits_;
    if (difference < -range / 2) difference += range;
    if (difference >= range / 2) difference -= range;
  }
  const std::uint32_t size = difference <= 0 ? 0u - static_cast<std::uint32_t>(difference)
                                             : static_cast<std::uint32_t>(difference) - 1u;
  const auto k = static_cast<std::uint32_t>(std::bit_width(size));
  last_bits_ = k;
  encoder.symbol(lengths_[context], k);
  if (k == 0) return encoder.bit(zero_or_one_, difference == 1);
  if (k == 32) return;
  std::uint32_t code = static_cast<std::uint32_t>(difference) + (difference < 0 ? (1u << k) - 1u : 0u - 1u);
  SymbolModel& model = leading_[k - 1];
  if (model.empty()) model = SymbolModel(1u << std::min(k, kLearntBits));
  if (k <= kLearntBits) return encoder.symbol(model, code);
  const std::uint32_t low = k - kLearntBits;
  encoder.symbol(model, code >> low);
  encoder.bits(code & ((1u << low) - 1u), low);
}

std::vector<std::byte> encode_compression(const Compression& how) {
  std::vector<std::byte> out;
  put(out, how.layered ? 3 : 2, 2);
  put(out, 0, 2);
  put(out, 0x00000403, 4);
  put(out, 0, 4);
  put(out, how.chunk_points == 0 ? 0xFFFFFFFFu : how.chunk_points, 4);
  put(out, ~std::uint64_t{0}, 8);
  put(out, ~std::uint64_t{0}, 8);
  put(out, how.items.size(), 2);
  for (const Item& item : how.items) {
    put(out, static_cast<std::uint16_t>(item.type), 2);
    put(out, item.bytes, 2);
    put(out, item.version, 2);
  }
  return out;
}

std::vector<std::byte> encode_chunk_table(const Compression& how, std::span<const Chunk> chunks) {
  ArithmeticEncoder encoder;
  NumberEncoder numbers(32, 2);
  std::int32_t points = 0, bytes = 0;
  for (const Chunk& chunk : chunks) {
    if (how.chunk_points == 0) numbers.encode(encoder, points, static_cast<std::int32_t>(chunk.points), 0);
    numbers.encode(encoder, bytes, static_cast<std::int32_t>(chunk.bytes), 1);
    points = static_cast<std::int32_t>(chunk.points);
    bytes = static_cast<std::int32_t>(chunk.bytes);
  }
  return encoder.finish();
}

Compression compression_of(std::uint8_t point_format, std::size_t extra_bytes, std::uint32_t chunk_points,
                           std::uint32_t layered_version) {
  Compression how;
  how.layered = point_format >= 6;
  how.chunk_points = chunk_points;
  const auto is_one_of = [&](std::initializer_list<int> formats) {
    return std::find(formats.begin(), formats.end(), point_format) != formats.end();
  };
  const std::uint32_t v = layered_version;
  if (how.layered) {
    how.items.push_back({ItemType::kPoint14, 30, v});
    if (point_format == 7) how.items.push_back({ItemType::kColour14, 6, v});
    if (is_one_of({8, 10})) how.items.push_back({ItemType::kColourInfrared14, 8, v});
    if (is_one_of({9, 10})) how.items.push_back({ItemType::kWavepacket14, 29, v});
    if (extra_bytes > 0) how.items.push_back({ItemType::kBytes14, extra_bytes, v});
  } else {
    how.items.push_back({ItemType::kPoint10, 20, 2});
    if (is_one_of({1, 3, 4, 5})) how.items.push_back({ItemType::kGpsTime11, 8, 2});
    if (is_one_of({2, 3, 5})) how.items.push_back({ItemType::kColour12, 6, 2});
    if (is_one_of({4, 5})) how.items.push_back({ItemType::kWavepacket13, 29, 1});
    if (extra_bytes > 0) how.items.push_back({ItemType::kBytes, extra_bytes, 2});
  }
  for (const Item& item : how.items) how.point_bytes += item.bytes;
  return how;
}

}  // namespace palpate::laz::test
