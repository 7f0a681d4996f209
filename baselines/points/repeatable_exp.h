// The exponential function with the same bits everywhere: the C library has several, chosen by the processor,
// which differ in the last place, and a trace would have another hash on another machine.
#pragma once

#include <cmath>

namespace palpate::baselines {

/// e^x for x <= 0, relative error below 1e-15; 0 below -700, where it is less than 1e-304. Sums and products
/// of doubles alone, each rounded once. noexcept, allocates nothing.
[[nodiscard]] inline double repeatable_exp(double x) noexcept {
  constexpr double kLeast = -700.0;
  if (!(x > kLeast)) return 0.0;
  // x = n ln 2 + r with |r| <= ln 2 / 2. The high part of ln 2 ends in zeros: n times it is exact.
  constexpr double kPerLn2 = 1.4426950408889634, kLn2High = 6.93147180369123816490e-01,
                   kLn2Low = 1.90821492927058770002e-10;
  const double n = std::nearbyint(x * kPerLn2);
  const double r = (x - n * kLn2High) - n * kLn2Low;
  // Taylor: the first term left out is r^14 / 14!, 4e-18.
  constexpr int kTerms = 13;
  double sum = 1.0;
  for (int k = kTerms; k > 0; --k) sum = 1.0 + sum * r / k;
  return std::ldexp(sum, static_cast<int>(n));
}

}  // namespace palpate::baselines
