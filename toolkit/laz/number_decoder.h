// Whole numbers as LAZ codes them: the difference to a prediction, as the count of its bits (by a model per
// context), its upper eight bits (by a model per count) and the rest as they are. Also the running median
// that predictions are made of.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/laz/arithmetic_decoder.h"

namespace palpate::laz {

/// Bits of a difference that a model learns; those below them are as good as random.
inline constexpr std::uint32_t kLearntBits = 8;

class NumberDecoder {
 public:
  /// Numbers of `bits`, at most 32, wrapping around; predictions stand in `contexts` classes.
  NumberDecoder(std::uint32_t bits, std::size_t contexts);

  [[nodiscard]] std::int32_t decode(ArithmeticDecoder& decoder, std::int32_t predicted,
                                    std::size_t context = 0);
  /// How many bits the last difference had: what follows it in the file is often as uncertain.
  [[nodiscard]] std::uint32_t last_bits() const noexcept { return last_bits_; }

 private:
  std::uint32_t bits_;
  std::uint32_t last_bits_ = 0;
  ModelSet lengths_;                  ///< by context
  BitModel zero_or_one_;              ///< differences without bits
  std::vector<SymbolModel> leading_;  ///< by count of bits, from 1; made at first use
};

/// The middle of five numbers, of which each new one pushes out an extreme: the largest while numbers come
/// below the middle, then the smallest while they come above. Begins with zeros.
class RunningMedian {
 public:
  [[nodiscard]] std::int32_t get() const noexcept { return sorted_[kMiddle]; }
  void add(std::int32_t number) noexcept;

 private:
  static constexpr std::size_t kNumbers = 5, kMiddle = kNumbers / 2;
  std::array<std::int32_t, kNumbers> sorted_{};
  bool drop_largest_ = true;
};

/// a + b and a * b as the encoder's machine computed them, without the language's overflow.
[[nodiscard]] inline std::int32_t wrapped_sum(std::int32_t a, std::int32_t b) noexcept {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) + static_cast<std::uint32_t>(b));
}
[[nodiscard]] inline std::int32_t wrapped_product(std::int32_t a, std::int32_t b) noexcept {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) * static_cast<std::uint32_t>(b));
}

}  // namespace palpate::laz
