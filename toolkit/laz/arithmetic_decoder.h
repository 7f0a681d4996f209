// Arithmetic decoding with adaptive models, the innermost layer of LAZ: the coder of A. Said ("Introduction
// to Arithmetic Coding - Theory and Practice", HP Laboratories HPL-2004-76) with the constants that LASzip
// chose. Models learn while they decode, and every number here must round as the encoder's did, so nothing
// may be computed in another way. Damaged bytes give other symbols, never a fault; bytes beyond the end read
// as 0.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace palpate::laz {

/// Bits of an interval's length that a SymbolModel's frequencies divide it into, and a BitModel's.
inline constexpr std::uint32_t kSymbolShift = 15;
inline constexpr std::uint32_t kBitShift = 13;
/// A coder starts with all of 32 bits, and takes in (or gives out) a byte while the interval is shorter than
/// the second.
inline constexpr std::uint32_t kWholeInterval = 0xFFFFFFFFu;
inline constexpr std::uint32_t kShortestInterval = 1u << 24;

/// Frequencies of 0 and 1 so far.
class BitModel {
 public:
  /// Of 0, in units of 2^-kBitShift; never 0 nor 1.
  [[nodiscard]] std::uint32_t zero_share() const noexcept { return zero_share_; }
  void count(bool bit) noexcept {
    zeros_ += bit ? 0 : 1;
    if (--until_update_ == 0) update();
  }

 private:
  void update() noexcept;

  std::uint32_t zeros_ = 1, total_ = 2;
  std::uint32_t zero_share_ = 1u << (kBitShift - 1);
  std::uint32_t cycle_ = 4, until_update_ = 4;
};

/// Frequencies of 2 to 2048 symbols so far. One that was not given its number of symbols is empty() and may
/// not be used.
class SymbolModel {
 public:
  SymbolModel() = default;
  explicit SymbolModel(std::uint32_t symbols);

  [[nodiscard]] bool empty() const noexcept { return symbols_ == 0; }
  [[nodiscard]] std::uint32_t symbols() const noexcept { return symbols_; }
  /// Of all symbols below this one, in units of 2^-kSymbolShift.
  [[nodiscard]] std::uint32_t share_below(std::uint32_t symbol) const noexcept { return numbers_[symbol]; }
  /// The symbol whose part of the interval holds `share`, which may pass 1 by the rounding of its division.
  [[nodiscard]] std::uint32_t find(std::uint32_t share) const noexcept;
  void count(std::uint32_t symbol) noexcept {
    ++numbers_[symbols_ + symbol];
    if (--until_update_ == 0) update();
  }

 private:
  void update() noexcept;

  std::uint32_t symbols_ = 0, total_ = 0;
  std::uint32_t cycle_ = 0, until_update_ = 0;
  std::uint32_t table_size_ = 0, table_shift_ = 0;
  /// Shares, counts and the table of first guesses, one after the other: one allocation per model, of which a
  /// chunk has hundreds.
  std::vector<std::uint32_t> numbers_;
};

/// Models of one size that are made where they are first used: most contexts never are.
class ModelSet {
 public:
  ModelSet(std::size_t models, std::uint32_t symbols) : symbols_(symbols), models_(models) {}
  [[nodiscard]] SymbolModel& operator[](std::size_t context) {
    SymbolModel& model = models_[context];
    if (model.empty()) model = SymbolModel(symbols_);
    return model;
  }

 private:
  std::uint32_t symbols_;
  std::vector<SymbolModel> models_;
};

/// Reads one stream of bytes, which somebody else keeps alive.
class ArithmeticDecoder {
 public:
  ArithmeticDecoder() = default;
  explicit ArithmeticDecoder(std::span<const std::byte> stream) noexcept;

  [[nodiscard]] std::uint32_t symbol(SymbolModel& model) noexcept;
  [[nodiscard]] bool bit(BitModel& model) noexcept;
  /// 1 to 32 bits that no model knows.
  [[nodiscard]] std::uint32_t bits(std::uint32_t count) noexcept;
  /// True once more was read than the stream holds, or if it cannot begin so: it is damaged.
  [[nodiscard]] bool damaged() const noexcept { return damaged_; }

 private:
  [[nodiscard]] std::uint32_t next_byte() noexcept;
  void refill() noexcept;
  [[nodiscard]] std::uint32_t few_bits(std::uint32_t count) noexcept;

  std::span<const std::byte> stream_;
  std::size_t at_ = 0;
  std::uint32_t value_ = 0;  ///< where in the interval the number stands: below length_
  std::uint32_t length_ = kWholeInterval;
  bool damaged_ = false;
};

// Inline: together they are most of the time of decoding.

inline std::uint32_t SymbolModel::find(std::uint32_t share) const noexcept {
  std::uint32_t low = 0, end = symbols_;
  if (table_size_ > 0) {
    // An interval of at least 2^24 makes `share` at most 1 + 2^-9, and a table entry is at least as wide.
    const std::uint32_t* const entry = numbers_.data() + std::size_t{2} * symbols_ + (share >> table_shift_);
    low = entry[0];
    end = entry[1] + 1;
  }
  while (end > low + 1) {
    const std::uint32_t middle = (low + end) >> 1;
    if (numbers_[middle] > share)
      end = middle;
    else
      low = middle;
  }
  return low;
}

inline std::uint32_t ArithmeticDecoder::next_byte() noexcept {
  if (at_ < stream_.size()) return static_cast<std::uint32_t>(stream_[at_++]);
  damaged_ = true;
  return 0;
}

inline void ArithmeticDecoder::refill() noexcept {
  while (length_ < kShortestInterval) {
    value_ = value_ << 8 | next_byte();
    length_ <<= 8;
  }
}

}  // namespace palpate::laz
