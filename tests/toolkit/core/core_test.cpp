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

TEST(Random, RepeatsAndIsUniform) {
  Random a(7), b(7), c(8);
  double sum = 0, square = 0;
  bool differs = false;
  for (int i = 0; i < 100000; ++i) {
    const double x = a.normal();
    EXPECT_EQ(x, b.normal());
    differs |= c.normal() != x;
    sum += x;
    square += x * x;
  }
  EXPECT_TRUE(differs);
  EXPECT_NEAR(sum / 100000, 0.0, 0.02);  // six standard errors
  EXPECT_NEAR(square / 100000, 1.0, 0.03);
  for (int i = 0; i < 1000; ++i) EXPECT_LT(a.below(3), 3u);
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
