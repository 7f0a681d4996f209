// An encoder of LAZ points for the tests, the mirror of toolkit/laz: what it writes the decoder must read
// back. Real files (las_test.cpp) show that both mean the same as LASzip does.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/laz/arithmetic_decoder.h"
#include "toolkit/laz/compression.h"

namespace palpate::laz::test {

class ArithmeticEncoder {
 public:
  void symbol(SymbolModel& model, std::uint32_t symbol);
  void bit(BitModel& model, bool bit);
  void bits(std::uint32_t value, std::uint32_t count);
  /// The stream; nothing may follow.
  [[nodiscard]] std::vector<std::byte> finish();

 private:
  void few_bits(std::uint32_t value, std::uint32_t count);
  void add(std::uint32_t to_base);
  void give_out();

  std::vector<std::byte> out_;
  std::uint32_t base_ = 0, length_ = kWholeInterval;
};

class NumberEncoder {
 public:
  NumberEncoder(std::uint32_t bits, std::size_t contexts)
      : bits_(bits), lengths_(contexts, bits + 1), leading_(bits) {}
  void encode(ArithmeticEncoder& encoder, std::int32_t predicted, std::int32_t number,
              std::size_t context = 0);
  [[nodiscard]] std::uint32_t last_bits() const noexcept { return last_bits_; }

 private:
  std::uint32_t bits_, last_bits_ = 0;
  ModelSet lengths_;
  BitModel zero_or_one_;
  std::vector<SymbolModel> leading_;
};

/// One chunk of points in the items of `how`.
[[nodiscard]] std::vector<std::byte> encode_chunk(const Compression& how, std::span<const std::byte> points);

/// The record that describes `how`, and the table of chunks behind its version and count.
[[nodiscard]] std::vector<std::byte> encode_compression(const Compression& how);
[[nodiscard]] std::vector<std::byte> encode_chunk_table(const Compression& how,
                                                        std::span<const Chunk> chunks);

/// The Compression of a point format with bytes of unknown meaning behind it, as LASzip would choose it.
[[nodiscard]] Compression compression_of(std::uint8_t point_format, std::size_t extra_bytes,
                                         std::uint32_t chunk_points, std::uint32_t layered_version = 3);

}  // namespace palpate::laz::test
