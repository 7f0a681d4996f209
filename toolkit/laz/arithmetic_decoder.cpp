#include "toolkit/laz/arithmetic_decoder.h"

namespace palpate::laz {
namespace {

// Counts are halved beyond these, so that old symbols are forgotten.
constexpr std::uint32_t kMostBits = 1u << kBitShift;
constexpr std::uint32_t kMostSymbols = 1u << kSymbolShift;
// One half in the fixed-point division of counts, 2^31.
constexpr std::uint32_t kShareScale = 1u << 31;
// The pause between two updates grows by a quarter each time, up to these.
constexpr std::uint32_t kLongestBitCycle = 64;
constexpr std::uint32_t kSymbolCycleMargin =
    6;  // the first pause is half of symbols + 6, the longest 8 times it
constexpr std::uint32_t kLongestCycleShift = 3;
// Models up to this size are searched without a table of first guesses; a table has an entry for about four
// symbols, and at least eight.
constexpr std::uint32_t kMostWithoutTable = 16;
constexpr std::uint32_t kLeastTableBits = 3;
constexpr std::uint32_t kSymbolsPerEntryShift = 2;
// More bits than this are read in two steps: the interval must keep a length.
constexpr std::uint32_t kMostBitsAtOnce = 19;
constexpr std::uint32_t kLowBits = 16;

std::uint32_t longer(std::uint32_t cycle) noexcept {
  return (5 * cycle) >> 2;
}

}  // namespace

void BitModel::update() noexcept {
  total_ += cycle_;
  if (total_ > kMostBits) {
    total_ = (total_ + 1) >> 1;
    zeros_ = (zeros_ + 1) >> 1;
    if (zeros_ == total_) ++total_;
  }
  zero_share_ = (zeros_ * (kShareScale / total_)) >> (31 - kBitShift);
  cycle_ = longer(cycle_);
  if (cycle_ > kLongestBitCycle) cycle_ = kLongestBitCycle;
  until_update_ = cycle_;
}

SymbolModel::SymbolModel(std::uint32_t symbols) : symbols_(symbols), cycle_(symbols) {
  if (symbols > kMostWithoutTable) {
    std::uint32_t bits = kLeastTableBits;
    while (symbols > (1u << (bits + kSymbolsPerEntryShift))) ++bits;
    table_size_ = 1u << bits;
    table_shift_ = kSymbolShift - bits;
  }
  // The table's last two entries are for a share of 1 and the rounding above it.
  numbers_.assign(std::size_t{2} * symbols + (table_size_ > 0 ? table_size_ + 2 : 0), 0);
  for (std::uint32_t s = 0; s < symbols; ++s) numbers_[symbols + s] = 1;
  update();
  cycle_ = until_update_ = (symbols + kSymbolCycleMargin) >> 1;
}

void SymbolModel::update() noexcept {
  std::uint32_t* const shares = numbers_.data();
  std::uint32_t* const counts = shares + symbols_;
  std::uint32_t* const table = counts + symbols_;
  total_ += cycle_;
  if (total_ > kMostSymbols) {
    total_ = 0;
    for (std::uint32_t s = 0; s < symbols_; ++s) total_ += counts[s] = (counts[s] + 1) >> 1;
  }
  const std::uint32_t scale = kShareScale / total_;
  std::uint32_t sum = 0, filled = 0;
  for (std::uint32_t s = 0; s < symbols_; ++s) {
    shares[s] = (scale * sum) >> (31 - kSymbolShift);
    sum += counts[s];
    if (table_size_ == 0) continue;
    while (filled < shares[s] >> table_shift_) table[++filled] = s - 1;
  }
  if (table_size_ > 0) {
    table[0] = 0;
    while (filled <= table_size_) table[++filled] = symbols_ - 1;
  }
  cycle_ = longer(cycle_);
  const std::uint32_t longest = (symbols_ + kSymbolCycleMargin) << kLongestCycleShift;
  if (cycle_ > longest) cycle_ = longest;
  until_update_ = cycle_;
}

ArithmeticDecoder::ArithmeticDecoder(std::span<const std::byte> stream) noexcept : stream_(stream) {
  for (std::size_t i = 0; i < sizeof value_; ++i) value_ = value_ << 8 | next_byte();
  // No encoder gives the interval's own end; everything below relies on standing before it.
  if (value_ == kWholeInterval) {
    damaged_ = true;
    value_ = 0;
  }
}

std::uint32_t ArithmeticDecoder::symbol(SymbolModel& model) noexcept {
  const std::uint32_t unit = length_ >> kSymbolShift;
  const std::uint32_t found = model.find(value_ / unit);
  const std::uint32_t begin = model.share_below(found) * unit;
  // The last symbol takes the rest of the division.
  const std::uint32_t end = found + 1 == model.symbols() ? length_ : model.share_below(found + 1) * unit;
  value_ -= begin;
  length_ = end - begin;
  refill();
  model.count(found);
  return found;
}

bool ArithmeticDecoder::bit(BitModel& model) noexcept {
  const std::uint32_t zero = model.zero_share() * (length_ >> kBitShift);
  const bool one = value_ >= zero;
  if (one) {
    value_ -= zero;
    length_ -= zero;
  } else {
    length_ = zero;
  }
  refill();
  model.count(one);
  return one;
}

std::uint32_t ArithmeticDecoder::few_bits(std::uint32_t count) noexcept {
  length_ >>= count;
  const std::uint32_t got = value_ / length_;
  value_ -= got * length_;
  refill();
  return got & ((1u << count) - 1u);
}

std::uint32_t ArithmeticDecoder::bits(std::uint32_t count) noexcept {
  if (count <= kMostBitsAtOnce) return few_bits(count);
  const std::uint32_t low = few_bits(kLowBits);
  return few_bits(count - kLowBits) << kLowBits | low;
}

}  // namespace palpate::laz
