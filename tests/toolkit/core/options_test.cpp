// Options and numbers as people give them.
#include "toolkit/core/options.h"

#include <gtest/gtest.h>

#include "toolkit/core/words.h"

namespace palpate {
namespace {

TEST(Numbers, AreReadWhole) {
  const NumberRange any;
  EXPECT_EQ(*read_number("1.5e3", any), 1500.0);
  EXPECT_EQ(*read_number("+2", any), 2.0);
  EXPECT_EQ(*read_number("-0", any), 0.0);
  EXPECT_EQ(*read_integer("-9223372036854775808", any), std::numeric_limits<long long>::min());
  for (const char* text : {"", " 1", "1 ", "1,5", "0x10", "1e", "+-1", "-+1", "+", "--1", "1_000", "one"}) {
    const Result<double> number = read_number(text, any);
    ASSERT_FALSE(number.ok()) << text;
    EXPECT_NE(number.error().what.find("is not a number"), std::string::npos) << number.error().what;
    EXPECT_FALSE(read_integer(text, any).ok()) << text;
  }
  for (const char* text : {"1.0", "1e3", "1.5"}) EXPECT_FALSE(read_integer(text, any).ok()) << text;
}

TEST(Numbers, AreFinite) {
  for (const char* text : {"nan", "-nan", "NAN", "inf", "+inf", "-inf", "infinity", "1e999", "-1e999"}) {
    const Result<double> number = read_number(text, {});
    ASSERT_FALSE(number.ok()) << text;
    EXPECT_NE(number.error().what.find("is not a finite number"), std::string::npos) << number.error().what;
  }
}

TEST(Numbers, KeepToTheirRangeWhichIsNamed) {
  const NumberRange above{0.0, 1e300, true}, from{2.0, 5.0}, least{1.0};
  EXPECT_EQ(text_of(above), "above 0");
  EXPECT_EQ(text_of(from), "from 2 to 5");
  EXPECT_EQ(text_of(least), "at least 1");
  EXPECT_EQ(text_of({-1e300, 3.0}), "at most 3");
  EXPECT_EQ(text_of({0.0, 1.0, true}), "above 0 and up to 1");
  EXPECT_EQ(text_of({}), "");
  EXPECT_FALSE(read_number("0", above).ok());
  EXPECT_TRUE(read_number("1e-308", above).ok());
  EXPECT_TRUE(read_number("2", from).ok() && read_number("5", from).ok());
  EXPECT_EQ(read_number("-1", above).error().what, "'-1' is not a number above 0");
  EXPECT_EQ(read_integer("6", from).error().what, "'6' is not a whole number from 2 to 5");
  EXPECT_EQ(read_integer("99999999999999999999", from).error().what,
            "'99999999999999999999' is not a whole number from 2 to 5");
  // However long the text is, the message is short.
  EXPECT_LT(read_number(std::string(5000, '7') + "x", from).error().message().size(), 120u);
  EXPECT_LT(read_number("-1" + std::string(300, '0'), from).error().message().size(), 120u);
}

const std::vector<OptionSpec> kSpecs = {
    {"method", OptionKind::kChoice, "grid", "how", {"grid", "tree", "none"}},
    {"cell", OptionKind::kNumber, "2", "of the grid", {}, 0, 1e6, {{"method", {"grid"}}}},
    {"leaf", OptionKind::kInteger, "10", "of the tree", {}, 1, 1e6, {{"method", {"tree"}}}},
    {"limit_s", OptionKind::kNumber, "0", "of any", {}, 0, 1e6, {{"method", {"none"}, true}}},
    {"jitter", OptionKind::kNumber, "0", "shift", {}, 0, 1},
    {"seed", OptionKind::kInteger, "1", "of the jitter", {}, 0, 1e18, {{"jitter"}}},
};

/// What is wrong with "x:key=value..", or nothing.
std::string wrong(const std::string& text) {
  const Result<NamedOptions> named = parse_named_options(text);
  const Result<Options> options = validate(named->options, kSpecs, named->name);
  return options ? std::string() : options.error().message();
}

TEST(Options, WhatWouldDoNothingIsRefused) {
  EXPECT_EQ(wrong("x:leaf=5"),
            "x: option leaf=5 does nothing with method=grid; leave it out, or take method=tree");
  EXPECT_EQ(wrong("x:cell=3:method=tree"),
            "x: option cell=3 does nothing with method=tree; leave it out, or take method=grid");
  EXPECT_EQ(wrong("x:seed=7"), "x: option seed=7 does nothing with jitter=0; leave it out, or set jitter");
  EXPECT_EQ(wrong("x:seed=7:jitter=0.0"),
            "x: option seed=7 does nothing with jitter=0.0; leave it out, or set jitter");
  EXPECT_EQ(
      wrong("x:limit_s=5:method=none"),
      "x: option limit_s=5 does nothing with method=none; leave it out, or take method other than none");
  for (const char* fine : {"x", "x:cell=3", "x:leaf=5:method=tree", "x:seed=7:jitter=0.1", "x:limit_s=5",
                           "x:limit_s=5:method=tree"})
    EXPECT_EQ(wrong(fine), "") << fine;
  // The default says no more than what holds anyway, however it is written.
  EXPECT_EQ(wrong("x:leaf=10:method=none:seed=1:cell=2.0"), "");
}

TEST(Options, ActWhereTheirConditionsHold) {
  Options given;
  EXPECT_TRUE(option_acts("cell", given, kSpecs));
  EXPECT_FALSE(option_acts("leaf", given, kSpecs));
  EXPECT_FALSE(option_acts("nothing", given, kSpecs));
  given.set("method", "tree");
  EXPECT_FALSE(option_acts("cell", given, kSpecs));
  EXPECT_TRUE(option_acts("leaf", given, kSpecs));
}

TEST(Options, WrongOnesAreNamedInShort) {
  EXPECT_EQ(wrong("x:leef=5"), "x has no option 'leef'; did you mean 'leaf'?");
  EXPECT_NE(wrong("x:wood=5").find("it has method, cell, leaf"), std::string::npos);
  EXPECT_EQ(wrong("x:leaf=0"), "x: option leaf: '0' is not a whole number from 1 to 1000000; of the tree");
  EXPECT_EQ(wrong("x:cell=nan"), "x: option cell: 'nan' is not a finite number; of the grid");
  EXPECT_EQ(wrong("x:method=bush"), "x: option method: 'bush' is not one of grid, tree, none; how");
  EXPECT_LT(wrong("x:cell=" + std::string(5000, '1')).size(), 150u);
  EXPECT_LT(wrong("x:" + std::string(5000, '1') + "=1").size(), 250u);
}

TEST(Words, NearOnesAreFound) {
  EXPECT_EQ(nearest_name("cluod", {"cloud", "mesh"}), "cloud");
  EXPECT_EQ(nearest_name("stiff", {"stiffness_n_per_mm"}), "stiffness_n_per_mm");
  EXPECT_EQ(nearest_name("zebra", {"cloud", "mesh"}), "");
  EXPECT_EQ(nearest_name("", {"cloud"}), "");
  EXPECT_EQ(did_you_mean("cluod", {"cloud", "mesh"}, "choose"), "did you mean 'cloud'?");
  EXPECT_EQ(did_you_mean("zebra", {"cloud", "mesh"}, "choose"), "choose");
  EXPECT_EQ(shown("a\tb"), "'a?b'");
}

}  // namespace
}  // namespace palpate
