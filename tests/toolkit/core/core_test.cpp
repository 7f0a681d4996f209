#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <vector>

#include "toolkit/core/hash.h"
#include "toolkit/core/options.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/random.h"
#include "toolkit/core/result.h"

namespace palpate {
namespace {

TEST(Error, NamesFileLineAndRemedy) {
  const Error error{"no vertices", "export with vertices", "a.ply", 7};
  EXPECT_EQ(error.message(), "a.ply:7: no vertices; export with vertices");
  EXPECT_EQ((Error{"x", "", "", 0}).in_file("f", 3).message(), "f:3: x");
}

TEST(Error, ALineStaysWithItsFile) {
  EXPECT_EQ((Error{"x", "", "f", 0}).in_file("f", 3).message(), "f:3: x");
  EXPECT_EQ((Error{"x", "", "f", 2}).in_file("f", 3).message(), "f:2: x");
  // A scene's third line names a file that is not there: it has no third line.
  EXPECT_EQ((Error{"no such file", "", "missing.ply", 0}).in_file("scene.toml", 3).message(),
            "missing.ply: no such file");
}

TEST(Options, ParsesNameAndKeys) {
  const auto parsed = parse_named_options("cloud:shading=none:fast");
  ASSERT_TRUE(parsed);
  EXPECT_EQ(parsed->name, "cloud");
  EXPECT_EQ(parsed->options.text("shading"), "none");
  EXPECT_TRUE(parsed->options.flag("fast"));
  EXPECT_FALSE(parse_named_options(":a=1"));
  EXPECT_FALSE(parse_named_options("cloud:=1"));
  EXPECT_FALSE(parse_named_options("cloud:a=1:a=2"));
}

TEST(Options, ValidatesKindRangeAndKey) {
  const std::vector<OptionSpec> specs = {
      {"box_mm", OptionKind::kNumber, "0", "box", {}, 0.0, 10.0},
      {"shading", OptionKind::kChoice, "auto", "shading", {"auto", "none"}, 0, 0},
  };
  Options good;
  good.set("box_mm", "2.5");
  const auto complete = validate(good, specs, "cloud");
  ASSERT_TRUE(complete);
  EXPECT_EQ(complete->number("box_mm"), 2.5);
  EXPECT_EQ(complete->text("shading"), "auto");
  for (const auto& [key, value] : std::vector<std::pair<std::string, std::string>>{{"box_mm", "11"},
                                                                                   {"box_mm", "x"},
                                                                                   {"box_mm", "1 "},
                                                                                   {"box_mm", "nan"},
                                                                                   {"shading", "all"},
                                                                                   {"sahding", "none"}}) {
    Options bad;
    bad.set(key, value);
    EXPECT_FALSE(validate(bad, specs, "cloud")) << key << "=" << value;
  }
}

TEST(Hash, IsFnv1a64AndFoldsZeros) {
  Hash64 hash;
  for (const char c : std::string("foobar")) hash.byte(static_cast<std::uint8_t>(c));
  EXPECT_EQ(hash.hex(), "85944171f73967e8");  // published test vector
  Hash64 a, b;
  a.real(0.0);
  b.real(-0.0);
  EXPECT_EQ(a.value(), b.value());
}

// Statistics of the seeds below are held to six standard errors. The numbers are the same everywhere, so what
// passes once passes always; a generator that is right passes for all but one seed in 10^8.
constexpr double kErrors = 6.0;
constexpr int kDraws = 100000;

TEST(Random, IsThePublishedGenerator) {
  // xoshiro256** on the state that splitmix64 makes of 0, by the authors' reference code.
  Random random(0);
  for (const std::uint64_t expected :
       {0x99ec5f36cb75f2b4u, 0xbf6e1f784956452au, 0x1a5f849d4933e6e0u, 0x6aa594f1262d2d2cu})
    EXPECT_EQ(random.next(), expected);
}

TEST(Random, RepeatsBySeed) {
  Random a(7), b(7), c(8);
  bool differs = false;
  for (int i = 0; i < 1000; ++i) {
    const std::uint64_t x = a.next();
    EXPECT_EQ(x, b.next());
    differs |= c.next() != x;
  }
  EXPECT_TRUE(differs);
}

/// Pearson's statistic of counts that should be equal: its mean is the degrees of freedom f, its variance 2
/// f.
double excess_in_errors(const std::vector<int>& counts, int draws) {
  const double expected = static_cast<double>(draws) / static_cast<double>(counts.size());
  double chi_squared = 0.0;
  for (const int count : counts) chi_squared += (count - expected) * (count - expected) / expected;
  const double freedom = static_cast<double>(counts.size()) - 1.0;
  return (chi_squared - freedom) / std::sqrt(2.0 * freedom);
}

TEST(Random, UniformIsUniformInItsFirstAndItsLaterBits) {
  Random random(7);
  std::vector<int> coarse(64), fine(64);
  for (int i = 0; i < kDraws; ++i) {
    const double x = random.uniform();
    ASSERT_GE(x, 0.0);
    ASSERT_LT(x, 1.0);
    ++coarse[static_cast<std::size_t>(64.0 * x)];
    const double later = 0x1.0p47 * x;  // six bits are left below the point
    ++fine[static_cast<std::size_t>(64.0 * (later - std::floor(later)))];
    const double between = random.uniform(-3.0, 5.0);
    ASSERT_GE(between, -3.0);
    ASSERT_LT(between, 5.0);
  }
  EXPECT_LT(std::abs(excess_in_errors(coarse, kDraws)), kErrors);
  EXPECT_LT(std::abs(excess_in_errors(fine, kDraws)), kErrors);
}

TEST(Random, BelowHasNoBiasWhereTheBoundDoesNotDivide) {
  // Four numbers of 64 bits for every three results: a plain remainder gives the lower third twice as often,
  // a plain product every third number.
  constexpr std::uint64_t kThird = std::uint64_t{1} << 62;
  Random random(7);
  std::vector<int> thirds(3), remainders(3), seven(7);
  for (int i = 0; i < kDraws; ++i) {
    const std::uint64_t x = random.below(3 * kThird);
    ASSERT_LT(x, 3 * kThird);
    ++thirds[x / kThird];
    ++remainders[x % 3];
    ++seven.at(random.below(7));
    ASSERT_EQ(random.below(1), 0u);
  }
  EXPECT_LT(std::abs(excess_in_errors(thirds, kDraws)), kErrors);
  EXPECT_LT(std::abs(excess_in_errors(remainders, kDraws)), kErrors);
  EXPECT_LT(std::abs(excess_in_errors(seven, kDraws)), kErrors);
}

TEST(Random, NormalHasTheMomentsOfTheNormalDistribution) {
  Random random(7);
  double sums[5] = {};
  double product = 0.0, last = 0.0;
  for (int i = 0; i < kDraws; ++i) {
    const double x = random.normal();
    for (int power = 1; power <= 4; ++power) sums[power] += std::pow(x, power);
    product += x * last;
    last = x;
  }
  // Standard error of the mean of x^p: the root of (E x^2p - (E x^p)^2) / n, with E x^2 to E x^8 = 1, 3, 15,
  // 105.
  const double n = kDraws, root = std::sqrt(n);
  EXPECT_NEAR(sums[1] / n, 0.0, kErrors * 1.0 / root);
  EXPECT_NEAR(sums[2] / n, 1.0, kErrors * std::sqrt(2.0) / root);
  EXPECT_NEAR(sums[3] / n, 0.0, kErrors * std::sqrt(15.0) / root);
  EXPECT_NEAR(sums[4] / n, 3.0, kErrors * std::sqrt(96.0) / root);
  EXPECT_NEAR(product / n, 0.0, kErrors * 1.0 / root) << "neighbours are independent: two come of one pair";
}

TEST(Parallel, CoversEveryIndexOnceForAnyThreads) {
  for (const int threads : {1, 2, 5}) {
    std::vector<std::atomic<int>> hits(10007);
    parallel_chunks(hits.size(), 64, threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) hits[i].fetch_add(1);
    });
    for (const auto& hit : hits) ASSERT_EQ(hit.load(), 1);
  }
}

}  // namespace
}  // namespace palpate
