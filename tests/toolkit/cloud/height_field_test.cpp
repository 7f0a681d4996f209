// Height fields out of clouds: order, holes, what is none.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/toolkit/cloud/posts.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/cloud/height_field.h"
#include "toolkit/core/random.h"

namespace palpate::cloud {
namespace {

constexpr double kNoHeight = std::numeric_limits<double>::quiet_NaN();

TEST(HeightField, StandsOnTheLatticeWhateverTheOrder) {
  const Heights ground = rough(3.0, 5);
  std::vector<Vec3> points = posts(7, 5, 0.25, ground, {-3, 8, 2});
  const auto in_order = height_field_of(build_cloud(points, NonFinite::kRefuse).value());
  ASSERT_TRUE(in_order);
  Random random(3);
  for (std::size_t i = points.size(); i > 1; --i)
    std::swap(points[i - 1], points[static_cast<std::size_t>(random.uniform(0.0, static_cast<double>(i)))]);
  const auto shuffled = height_field_of(build_cloud(points, NonFinite::kRefuse).value());
  ASSERT_TRUE(shuffled);
  for (const HeightField* field : {&*in_order, &*shuffled}) {
    ASSERT_EQ(field->columns, 7u);
    ASSERT_EQ(field->rows, 5u);
    EXPECT_NEAR(field->step_x_mm, 0.25, 1e-6);
    EXPECT_NEAR(field->plan_resolution_mm(), std::hypot(0.25, 0.25), 1e-6);
    for (std::uint32_t row = 0; row < 5; ++row)
      for (std::uint32_t column = 0; column < 7; ++column)
        EXPECT_NEAR(field->origin_mm.z() + static_cast<double>(field->height_mm[field->at(column, row)]),
                    2.0 + ground(column, row), 1e-6);
  }
}

TEST(HeightField, ARasterAlongYIsTurned) {
  std::vector<Vec3> points;
  for (int x = 3; x >= 0; --x)
    for (int y = 0; y < 6; ++y) points.emplace_back(x, 2.0 * y, 10 * x + y);
  Cloud scan = build_cloud(points, NonFinite::kRefuse).value();
  scan.raster = ScanRaster{6, 4};
  const auto field = height_field_of(scan);
  ASSERT_TRUE(field) << field.error().message();
  EXPECT_EQ(field->columns, 4u);
  EXPECT_EQ(field->rows, 6u);
  EXPECT_DOUBLE_EQ(field->step_y_mm, 2.0);
  EXPECT_FLOAT_EQ(static_cast<float>(field->origin_mm.z()) + field->height_mm[field->at(2, 5)], 25.0f);
}

TEST(HeightField, ToAndFroIsTheSameField) {
  const auto field = [](const std::string& order) {
    const auto spec = parse_named_options("relief:points=900:aspect=0.5:mesh=false:order=" + order).value();
    return height_field_of(generate(spec).value().cloud).value();
  };
  const HeightField a = field("raster"), b = field("boustrophedon");
  EXPECT_EQ(a.columns, 42u);
  EXPECT_EQ(a.rows, 22u);
  EXPECT_EQ(a.height_mm, b.height_mm);
  EXPECT_EQ(a.origin_mm, b.origin_mm);
}

TEST(HeightField, HolesAreKept) {
  const auto field = height_field_of(
      build_cloud(
          posts(40, 40, 1.0, [](std::size_t c, std::size_t r) { return c == 20 && r > 3 ? kNoHeight : 0.5; }),
          NonFinite::kRefuse)
          .value());
  ASSERT_TRUE(field);
  EXPECT_EQ(field->holes, 36u);
  EXPECT_TRUE(std::isnan(field->height_mm[field->at(20, 4)]));
}

TEST(HeightField, WhatIsNoneIsRefused) {
  const auto refused = [](const std::vector<Vec3>& points) {
    const auto field = height_field_of(build_cloud(points, NonFinite::kRefuse).value());
    EXPECT_FALSE(field);
    return field ? std::string() : field.error().message();
  };
  EXPECT_NE(refused({{1, 2, 3}}).find("fewer"), std::string::npos);
  refused(std::vector<Vec3>(50, Vec3(1, 2, 3)));                           // all equal
  refused(posts(30, 1, 1.0, [](std::size_t, std::size_t) { return 0; }));  // collinear
  std::vector<Vec3> points = posts(10, 10, 1.0, [](std::size_t, std::size_t) { return 0; });
  points[37].x() += 0.3;
  refused(points);
  Cloud scan = build_cloud(points, NonFinite::kRefuse).value();
  scan.raster = ScanRaster{10, 10};
  EXPECT_NE(height_field_of(scan).error().message().find("37"), std::string::npos);
  points = posts(10, 10, 1.0, [](std::size_t, std::size_t) { return 0; });
  points.emplace_back(4, 4, 1);
  EXPECT_NE(refused(points).find("second"), std::string::npos);
  points.clear();
  for (int i = 0; i < 1000; ++i) points.emplace_back(i, i, 0);  // a diagonal: a million posts for a thousand
  refused(points);
  EXPECT_FALSE(height_field_of(
      generate(parse_named_options("sinusoid:points=2500:jitter=0.2").value()).value().cloud));
}

}  // namespace
}  // namespace palpate::cloud
