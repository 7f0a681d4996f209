#include "toolkit/laz/number_decoder.h"

#include <algorithm>
#include <limits>

namespace palpate::laz {
namespace {

constexpr std::uint32_t kWordBits = 32;

}  // namespace

NumberDecoder::NumberDecoder(std::uint32_t bits, std::size_t contexts)
    : bits_(bits), lengths_(contexts, bits + 1), leading_(bits) {}

std::int32_t NumberDecoder::decode(ArithmeticDecoder& decoder, std::int32_t predicted, std::size_t context) {
  const std::uint32_t k = last_bits_ = decoder.symbol(lengths_[context]);
  std::int32_t difference = std::numeric_limits<std::int32_t>::min();  // the only one of 32 bits
  if (k == 0) {
    difference = decoder.bit(zero_or_one_) ? 1 : 0;
  } else if (k < kWordBits) {
    SymbolModel& model = leading_[k - 1];
    if (model.empty()) model = SymbolModel(1u << std::min(k, kLearntBits));
    std::uint32_t code = decoder.symbol(model);
    if (k > kLearntBits) code = code << (k - kLearntBits) | decoder.bits(k - kLearntBits);
    // The lower half of the codes are -(2^k - 1) to -2^(k-1), the upper 2^(k-1) + 1 to 2^k.
    code += (code >> (k - 1)) != 0 ? 1u : 1u - (1u << k);
    difference = static_cast<std::int32_t>(code);
  }
  const std::int32_t sum = wrapped_sum(predicted, difference);
  if (bits_ == kWordBits) return sum;
  const std::int32_t range = std::int32_t{1} << bits_;
  return sum < 0 ? sum + range : sum >= range ? sum - range : sum;
}

void RunningMedian::add(std::int32_t number) noexcept {
  if (drop_largest_) {
    drop_largest_ = number < get();
    std::size_t at = kNumbers - 1;
    for (; at > 0 && number < sorted_[at - 1]; --at) sorted_[at] = sorted_[at - 1];
    sorted_[at] = number;
  } else {
    drop_largest_ = !(get() < number);
    std::size_t at = 0;
    for (; at + 1 < kNumbers && sorted_[at + 1] < number; ++at) sorted_[at] = sorted_[at + 1];
    sorted_[at] = number;
  }
}

}  // namespace palpate::laz
