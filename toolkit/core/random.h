// Seeded random numbers with distributions of our own. The standard library's differ between implementations.
#pragma once

#include <cstdint>

namespace palpate {

/// xoshiro256** (Blackman and Vigna 2018), seeded by splitmix64. Not thread-safe.
class Random {
 public:
  explicit Random(std::uint64_t seed) noexcept;
  std::uint64_t next() noexcept;
  /// Uniform in [0, 1), 53 bits.
  double uniform() noexcept;
  double uniform(double low, double high) noexcept { return low + (high - low) * uniform(); }
  /// Uniform in [0, bound), bound > 0, without modulo bias.
  std::uint64_t below(std::uint64_t bound) noexcept;
  /// Normal with mean 0 and standard deviation 1 (Box and Muller 1958).
  double normal() noexcept;

 private:
  std::uint64_t state_[4];
  double spare_ = 0.0;
  bool has_spare_ = false;
};

}  // namespace palpate
