// How numbers are written.
#include "toolkit/core/numbers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

using Texts = std::vector<std::string>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(Numbers, AreShortAndReadable) {
  EXPECT_EQ(count_text(0), "0");
  EXPECT_EQ(count_text(999), "999");
  EXPECT_EQ(count_text(1002001), "1,002,001");
  EXPECT_EQ(short_number(0.0), "0");
  EXPECT_EQ(short_number(-0.0), "0");
  EXPECT_EQ(short_number(37.4), "37.4");
  EXPECT_EQ(short_number(267.4), "267");
  EXPECT_EQ(short_number(0.0374), "0.0374");
  EXPECT_EQ(short_number(2.4), "2.40");
  EXPECT_EQ(short_number(12345.6), "12,346");
  EXPECT_EQ(short_number(-5.0), "-5.00");
  EXPECT_EQ(short_number(std::nullopt), "–");
  EXPECT_EQ(duration_text(0.5), "0.500 ms");
  EXPECT_EQ(duration_text(0.042), "42.0 µs");
  EXPECT_EQ(duration_text(0.0), "0 ms");
  EXPECT_EQ(duration_text(2500.0), "2.50 s");
  EXPECT_EQ(duration_text(90000.0), "1.50 min");
  EXPECT_EQ(bytes_text(812.0), "812 bytes");
  EXPECT_EQ(bytes_text(48.1e6), "48.1 MB");
  EXPECT_EQ(bytes_text(1.25e9), "1.25 GB");
}

TEST(Numbers, VerySmallOnesAndLargeOnesArePowersOfTen) {
  EXPECT_EQ(short_number(6.18e-16), "6.18×10⁻¹⁶");
  EXPECT_EQ(short_number(9.999e-4), "1.00×10⁻³") << "rounding raises the power";
  EXPECT_EQ(short_number(-1.5e18), "-1.50×10¹⁸");
  EXPECT_EQ(short_number(std::numeric_limits<double>::denorm_min()), "4.94×10⁻³²⁴");
  EXPECT_EQ(short_number(std::numeric_limits<double>::max()), "1.80×10³⁰⁸");
  EXPECT_EQ(short_number(kNan), "–");
  EXPECT_EQ(short_number(-kInfinity), "–");
  EXPECT_EQ(duration_text(kNan), "–");
}

TEST(Numbers, WhatRoundingMakesIsNothing) {
  EXPECT_EQ(settled(6.18e-16, 1e-12), 0.0);
  EXPECT_EQ(settled(-6.18e-16, 1e-12), 0.0);
  EXPECT_EQ(settled(6.18e-16, 0.0), 6.18e-16) << "no bound is known";
  EXPECT_EQ(settled(0.5, 1e-12), 0.5);
}

TEST(Numbers, RatiosSayNoMoreThanTheyKnow) {
  EXPECT_EQ(ratio_text(1.5, 0.2), "7.50 times");
  EXPECT_EQ(ratio_text(0.2, 0.2), "");
  EXPECT_EQ(ratio_text(0.01, 6.18e-21), "more than a million times");
  EXPECT_EQ(ratio_text(0.01, 0.0), "");
  EXPECT_EQ(ratio_text(kNan, 1.0), "");
}

TEST(AlignedNumbers, ShareTheirDecimals) {
  EXPECT_EQ(aligned_numbers({0.0794, 0.00173, 0.00157}), (Texts{"0.07940", "0.00173", "0.00157"}));
  EXPECT_EQ(aligned_numbers({23.9, 0.06, 0.0, std::nullopt}), (Texts{"23.900", "0.060", "0", "–"}));
  EXPECT_EQ(aligned_numbers({12556.4, 72.9}), (Texts{"12,556", "73"}));
  EXPECT_EQ(aligned_numbers({4.84, 6.1e-6}), (Texts{"4.8400", "<0.0001"}));
  EXPECT_EQ(aligned_numbers({1234567.0}), (Texts{"1,234,567"}));
  EXPECT_EQ(aligned_numbers({}), Texts{});
  EXPECT_EQ(aligned_numbers({-5.0, 0.25}), (Texts{"-5.000", "0.250"}));
  EXPECT_EQ(aligned_numbers({kNan, kInfinity}), (Texts{"–", "–"}));
  const AlignedTimes times = aligned_times({149.4, 43100.0});
  EXPECT_EQ(times.unit, "s");
  EXPECT_EQ(times.texts, (Texts{"0.149", "43.100"}));
  EXPECT_EQ(aligned_times({149.4, 456.0}).unit, "ms");
  EXPECT_EQ(aligned_times({0.0125}).unit, "µs");
}

TEST(AlignedNumbers, AreNeverRowsOfZeros) {
  EXPECT_EQ(aligned_numbers({6.18e-16}), (Texts{"6.18×10⁻¹⁶"}));
  EXPECT_EQ(aligned_numbers({6.18e-16, 3.1e-7, 0.0}), (Texts{"6.18×10⁻¹⁶", "3.10×10⁻⁷", "0"}));
  EXPECT_EQ(aligned_numbers({1e18, 0.5}), (Texts{"1.00×10¹⁸", "0.500"}));
  // Over every pair of magnitudes: a text stays short, and only what is nothing reads as nothing.
  constexpr std::size_t kMostLetters = 16;
  for (int i = -320; i <= 308; i += 3)
    for (int k = -320; k <= 308; k += 7) {
      const Texts texts = aligned_numbers({std::pow(10.0, i) * 1.234, std::pow(10.0, k) * 5.678});
      for (const std::string& text : texts) {
        EXPECT_LE(text.size(), kMostLetters + 8) << text;  // superscripts take three bytes each
        EXPECT_NE(text.find_first_of("123456789"), std::string::npos) << i << " " << k << " " << text;
      }
    }
}

}  // namespace
}  // namespace palpate
