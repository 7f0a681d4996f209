// PFM height maps: both byte orders, their scale, lies.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <fstream>
#include <iterator>
#include <memory>
#include <span>

#include "toolkit/io/read_model.h"

namespace palpate::io {
namespace {

Result<ReadModel> read(const std::string& content, const ReadOptions& options = {}) {
  Readers readers;
  add_standard_readers(readers);
  return readers.read(std::make_unique<MemorySource>(std::as_bytes(std::span(content))), "a.pfm", options);
}

std::string floats(const std::vector<float>& values, bool little) {
  std::string bytes;
  for (const float value : values) {
    const auto bits = std::bit_cast<std::uint32_t>(value);
    for (int i = 0; i < 4; ++i) bytes += static_cast<char>(bits >> 8 * (little ? i : 3 - i) & 0xFF);
  }
  return bytes;
}

TEST(Pfm, BothByteOrdersFromTheBottomUp) {
  const std::vector<float> heights = {1, 2, 3, 4, 5, 6.5f};
  for (const bool little : {true, false}) {
    const auto model =
        read(std::string("Pf\n3 2\n") + (little ? "-1.0" : "1.0") + "\n" + floats(heights, little));
    ASSERT_TRUE(model) << model.error().message();
    ASSERT_TRUE(model->cloud.raster);
    EXPECT_EQ(model->cloud.raster->columns, 3u);
    EXPECT_EQ(model->cloud.point_mm(0), Vec3(0, 0, 1));
    EXPECT_EQ(model->cloud.point_mm(5), Vec3(2, 1, 6.5));
  }
}

TEST(Pfm, SpacingAndVerticalScaleInMm) {
  ReadOptions options;
  options.post_mm = 0.5;
  options.vertical_mm = 0.125;
  const auto model = read("Pf 2 2 -1\n" + floats({1, 2, 3, 4}, true), options);
  ASSERT_TRUE(model) << model.error().message();
  EXPECT_EQ(model->cloud.point_mm(3), Vec3(0.5, 0.5, 0.5));
}

// A file without a tag, with a value for "no data" among heights of 100 to 115.
TEST(Pfm, NumbersThatLookLikeNoDataAreWarnedOfAndLeftOut) {
  const auto grid_with = [](float number, int count) {
    std::vector<float> heights;
    for (int i = 0; i < 16; ++i) heights.push_back(i < count ? number : 100.0f + static_cast<float>(i));
    return "Pf 4 4 -1\n" + floats(heights, true);
  };
  const auto warns = [](const ReadModel& model) {
    for (const std::string& warning : model.warnings)
      if (warning.find("--no-data") != std::string::npos) return warning;
    return std::string();
  };
  for (const float number : {-32768.0f, -9999.0f, -3.4028235e38f, 65535.0f, 0.0f}) {
    SCOPED_TRACE(number);
    ReadOptions options;
    const auto seen = read(grid_with(number, 5));
    // The largest float may be no place at all: then the refusal says the same.
    EXPECT_NE((seen ? warns(*seen) : seen.error().message()).find("5 of 16 posts hold"), std::string::npos);
    options.unit = Unit::kMetre;
    const auto metres = read(grid_with(number, 5), options);
    EXPECT_NE((metres ? warns(*metres) : metres.error().message()).find("5 of 16 posts hold"),
              std::string::npos);
    options.no_data = number;
    const auto without = read(grid_with(number, 5), options);
    ASSERT_TRUE(without) << without.error().message();
    EXPECT_EQ(without->non_finite, 5u);
    EXPECT_EQ(without->cloud.size(), 11u);
    EXPECT_EQ(warns(*without), "");
  }
  for (const auto& [number, count] : {std::pair(-9999.0f, 1), {-17.0f, 5}, {99.0f, 5}}) {
    SCOPED_TRACE(number);
    const auto model = read(grid_with(number, count));  // a spike; no customary number; no distance
    ASSERT_TRUE(model);
    EXPECT_EQ(warns(*model), "");
  }
}

TEST(Pfm, HolesAndScalesAreTold) {
  const auto model = read("Pf\n2 2\n-3\n" + floats({1, std::nanf(""), 3, 4}, true));
  ASSERT_TRUE(model) << model.error().message();
  EXPECT_EQ(model->non_finite, 1u);
  EXPECT_FALSE(model->cloud.raster);
  ASSERT_FALSE(model->warnings.empty());
  EXPECT_NE(model->warnings.front().find("scale of 3"), std::string::npos);
}

TEST(Pfm, LiesAreErrors) {
  const std::string four = floats({1, 2, 3, 4}, true);
  for (const std::string& content : {std::string("Pf\n2 3\n-1\n") + four, "Pf\n2 2\n0\n" + four,
                                     "Pf\n2 2\nnan\n" + four, "PF\n2 2\n-1\n" + four, "P5\n2 2\n-1\n" + four,
                                     std::string("Pf\n2 2\n"), std::string("Pf\n-2 2\n-1\n") + four,
                                     "Pf\n1 4\n-1\n" + four, "Pf\n4294967296 4294967296\n-1\n" + four,
                                     "Pf\n2 2 -1 9\n" + four, "Pf\n1000000 1000000\n-1\n" + four}) {
    const auto model = read(content);
    ASSERT_FALSE(model) << content;
    EXPECT_FALSE(model.error().remedy.empty()) << model.error().message();
  }
  EXPECT_NE(read("Pf\n2 3\n-1\n" + four).error().what.find("2 rows"), std::string::npos);
}

}  // namespace
}  // namespace palpate::io
