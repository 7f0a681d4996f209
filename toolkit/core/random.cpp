#include "toolkit/core/random.h"

#include <bit>
#include <cmath>
#include <numbers>

#include "toolkit/core/hash.h"

namespace palpate {
namespace {

std::uint64_t splitmix64(std::uint64_t& x) noexcept {
  x += kGolden64;
  return mixed64(x);
}

}  // namespace

Random::Random(std::uint64_t seed) noexcept {
  for (std::uint64_t& s : state_) s = splitmix64(seed);
}

std::uint64_t Random::next() noexcept {
  const std::uint64_t result = std::rotl(state_[1] * 5, 7) * 9;
  const std::uint64_t t = state_[1] << 17;
  state_[2] ^= state_[0];
  state_[3] ^= state_[1];
  state_[1] ^= state_[2];
  state_[0] ^= state_[3];
  state_[2] ^= t;
  state_[3] = std::rotl(state_[3], 45);
  return result;
}

double Random::uniform() noexcept {
  return static_cast<double>(next() >> 11) * 0x1.0p-53;
}

std::uint64_t Random::below(std::uint64_t bound) noexcept {
  const std::uint64_t reject_below = (0 - bound) % bound;
  std::uint64_t x = next();
  while (x < reject_below) x = next();
  return x % bound;
}

double Random::normal() noexcept {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
  const double angle = 2.0 * std::numbers::pi * uniform();
  spare_ = radius * std::sin(angle);
  has_spare_ = true;
  return radius * std::cos(angle);
}

}  // namespace palpate
