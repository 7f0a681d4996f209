// Height fields out of clouds: order, holes, what is none.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "tests/toolkit/cloud/posts.h"
#include "tests/toolkit/messages.h"
#include "toolkit/cloud/height_field.h"
#include "toolkit/core/random.h"

namespace palpate::cloud {
namespace {

TEST(HeightField, StandsOnTheLatticeWhateverTheOrder) {
  const Heights ground = rough(3.0, 5);
  std::vector<Vec3> points = posts(7, 5, 0.25, ground, {-3, 8, 2});
  const auto in_order = height_field_of(cloud_of(points));
  Random random(3);
  for (std::size_t i = points.size(); i > 1; --i)
    std::swap(points[i - 1], points[static_cast<std::size_t>(random.uniform(0.0, static_cast<double>(i)))]);
  const auto shuffled = height_field_of(cloud_of(points));
  ASSERT_TRUE(in_order && shuffled);
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
  Cloud scan = cloud_of(points);
  scan.raster = ScanRaster{6, 4};
  const auto field = test::value_of(height_field_of(scan));
  EXPECT_EQ(field.columns, 4u);
  EXPECT_EQ(field.rows, 6u);
  EXPECT_DOUBLE_EQ(field.step_y_mm, 2.0);
  EXPECT_FLOAT_EQ(static_cast<float>(field.origin_mm.z()) + field.height_mm[field.at(2, 5)], 25.0f);
}

TEST(HeightField, ToAndFroIsTheSameField) {
  const auto field = [](const std::string& order) {
    return height_field_of(made("relief:points=900:aspect=0.5:mesh=false:order=" + order).cloud).value();
  };
  const HeightField a = field("raster"), b = field("boustrophedon");
  EXPECT_EQ(a.columns, 42u);
  EXPECT_EQ(a.rows, 22u);
  EXPECT_EQ(a.height_mm, b.height_mm);
  EXPECT_EQ(a.origin_mm, b.origin_mm);
}

TEST(HeightField, WhatIsNoneIsRefused) {
  const auto refuses = [](const std::vector<Vec3>& points, const char* why = "") {
    EXPECT_TRUE(test::refused(height_field_of(cloud_of(points)), why));
  };
  refuses({{1, 2, 3}}, "fewer");
  refuses(std::vector<Vec3>(50, Vec3(1, 2, 3)));  // all equal
  refuses(posts(30, 1, 1.0, flat));               // collinear
  std::vector<Vec3> points = posts(10, 10, 1.0, flat);
  points[37].x() += 0.3;
  refuses(points);
  Cloud scan = cloud_of(points);
  scan.raster = ScanRaster{10, 10};
  EXPECT_TRUE(test::refused(height_field_of(scan), "37"));
  points = posts(10, 10, 1.0, flat);
  points.emplace_back(4, 4, 1);
  refuses(points, "second");
  points.clear();
  for (int i = 0; i < 1000; ++i) points.emplace_back(i, i, 0);  // a diagonal: a million posts for a thousand
  refuses(points);
  EXPECT_FALSE(height_field_of(made("sinusoid:points=2500:jitter=0.2").cloud));
}

// Posts without a point: what is a gap, a void or outside, what a gap is filled with, what is too thin.

HeightField field_of(std::size_t columns, std::size_t rows, const Gone& gone, const Heights& height = flat) {
  auto field = height_field_of(cloud_of(posts(columns, rows, 1.0, without(gone, height))));
  EXPECT_TRUE(field) << (field ? "" : field.error().message());
  return *std::move(field);
}

/// Heights of all posts that have one, against what they should be: the largest difference.
double worst_difference(const HeightField& field, const Heights& expected) {
  double worst = 0.0;
  for (std::uint32_t row = 0; row < field.rows; ++row)
    for (std::uint32_t column = 0; column < field.columns; ++column) {
      const auto height = static_cast<double>(field.height_mm[field.at(column, row)]);
      if (!std::isnan(height))
        worst = std::max(worst, std::abs(field.origin_mm.z() + height - expected(column, row)));
    }
  return worst;
}

struct Counts {
  std::size_t gaps, voids, outside;
  std::uint32_t widest;
  bool operator==(const Counts&) const = default;
};
void PrintTo(const Counts& c, std::ostream* out) {
  *out << c.gaps << " gaps, " << c.voids << " voids, " << c.outside << " outside, widest " << c.widest;
}
Counts counts(const Gone& gone, std::size_t columns = 40, std::size_t rows = 30) {
  const Holes holes = find_holes(field_of(columns, rows, gone));
  EXPECT_EQ(holes.missing, holes.gaps + holes.voids + holes.outside);
  return {holes.gaps, holes.voids, holes.outside, holes.widest};
}

TEST(Holes, AGapIsWhatNoEmptySquareOfEightCovers) {
  EXPECT_EQ(counts([](std::size_t, std::size_t) { return false; }), (Counts{0, 0, 0, 0}));
  EXPECT_EQ(counts(box(20, 15, 1, 1)), (Counts{1, 0, 0, 1}));
  EXPECT_EQ(counts(box(10, 10, 7, 7)), (Counts{49, 0, 0, 7}));
  EXPECT_EQ(counts(box(10, 10, 7, 12)), (Counts{84, 0, 0, 7})) << "long and narrow";
  EXPECT_EQ(counts(box(10, 10, 8, 8)), (Counts{0, 64, 0, 8}));
  EXPECT_EQ(counts([](std::size_t, std::size_t r) { return r == 12; }), (Counts{40, 0, 0, 1})) << "a row";
  EXPECT_EQ(counts([](std::size_t c, std::size_t) { return c == 12; }), (Counts{30, 0, 0, 1})) << "a column";
  EXPECT_EQ(counts([](std::size_t c, std::size_t r) { return (c + r) % 2 == 1; }), (Counts{598, 0, 2, 1}))
      << "a chessboard: two of its corners are beside the points";
  EXPECT_EQ(counts(box(10, 0, 3, 4)), (Counts{12, 0, 0, 3})) << "a notch is closed";
  EXPECT_EQ(counts(box(10, 0, 12, 9)), (Counts{0, 0, 108, 0})) << "a bay is outside";
  EXPECT_EQ(counts(box(0, 0, 1, 1)), (Counts{0, 0, 1, 0})) << "a corner has points on two sides alone";
  // A void with a notch: the notch is a gap. A void that a channel of 8 joins to the border is outside.
  const Gone hole = box(10, 10, 9, 9), notch = box(19, 13, 2, 2), channel = box(10, 0, 8, 10);
  EXPECT_EQ(counts([&](std::size_t c, std::size_t r) { return hole(c, r) || notch(c, r); }),
            (Counts{4, 81, 0, 9}));
  EXPECT_EQ(counts([&](std::size_t c, std::size_t r) { return hole(c, r) || channel(c, r); }),
            (Counts{0, 0, 161, 0}));
}

/// Whether some empty square of eight covers a post, by trying all.
bool is_covered(const HeightField& field, int column, int row) {
  const int side = static_cast<int>(kGapPosts);
  const auto empty = [&](int c, int r) {
    if (c < 0 || r < 0 || c >= static_cast<int>(field.columns) || r >= static_cast<int>(field.rows))
      return true;
    return std::isnan(
        field.height_mm[field.at(static_cast<std::uint32_t>(c), static_cast<std::uint32_t>(r))]);
  };
  for (int y = row - side + 1; y <= row; ++y)
    for (int x = column - side + 1; x <= column; ++x) {
      bool all = true;
      for (int j = 0; j < side && all; ++j)
        for (int i = 0; i < side && all; ++i) all = empty(x + i, y + j);
      if (all) return true;
    }
  return false;
}

TEST(Holes, AreFoundAsTheirDefinitionSays) {
  for (const std::uint64_t seed : {1u, 2u, 3u, 4u, 5u, 6u}) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const double share = 0.1 * static_cast<double>(seed);
    const std::size_t columns = 40 + random.below(40), rows = 40 + random.below(40);
    std::vector<Gone> boxes;
    for (int i = 0; i < 3; ++i)
      boxes.push_back(
          box(random.below(columns), random.below(rows), 4 + random.below(9), 4 + random.below(9)));
    const Gone gone = [&](std::size_t c, std::size_t r) {
      const bool in_box = std::any_of(boxes.begin(), boxes.end(), [&](const Gone& b) { return b(c, r); });
      return in_box || random.uniform() < share;
    };
    const HeightField field = field_of(columns, rows, gone);
    const Holes holes = find_holes(field);
    for (std::uint32_t row = 0; row < field.rows; ++row)
      for (std::uint32_t column = 0; column < field.columns; ++column) {
        const std::size_t post = field.at(column, row);
        const PostKind kind = holes.of_post[post];
        ASSERT_EQ(kind == PostKind::kPoint, !std::isnan(field.height_mm[post]));
        if (kind == PostKind::kPoint) continue;
        ASSERT_EQ(kind != PostKind::kGap, is_covered(field, static_cast<int>(column), static_cast<int>(row)))
            << column << " " << row;
      }
  }
}

TEST(Holes, WhatChanceLeavesAmongFewPointsIsNoVoid) {
  const Gone thin = at_random(0.88, 7), dense = at_random(0.05, 7), hole = box(100, 100, 30, 30);
  const Holes holes = find_holes(field_of(400, 300, thin));
  EXPECT_GE(holes.widest, 8u) << "else this says nothing";
  EXPECT_EQ(holes.voids, 0u);
  EXPECT_LT(holes.outside, 6000u) << "a rim of two or three posts";
  EXPECT_GE(counts([&](std::size_t c, std::size_t r) { return thin(c, r) || hole(c, r); }, 400, 300).voids,
            900u)
      << "a hole that chance does not leave";
  const auto both = [&](std::size_t c, std::size_t r) { return c < 200 ? thin(c, r) : dense(c, r); };
  EXPECT_EQ(counts(both, 400, 300).voids, 0u);
  const Gone small = box(300, 100, 8, 8);
  EXPECT_EQ(counts([&](std::size_t c, std::size_t r) { return both(c, r) || small(c, r); }, 400, 300).voids,
            64u)
      << "among dense points the same is one";
}

/// The patterns of missing posts that a scan may have, on 60 x 50 posts.
const std::map<std::string, Gone>& patterns() {
  static const std::map<std::string, Gone> all = {
      {"one", box(30, 25, 1, 1)},
      {"cluster of seven", box(20, 20, 7, 7)},
      {"row", [](std::size_t, std::size_t r) { return r == 20; }},
      {"seven rows", [](std::size_t, std::size_t r) { return r >= 20 && r < 27; }},
      {"column", [](std::size_t c, std::size_t) { return c == 31; }},
      {"chessboard", [](std::size_t c, std::size_t r) { return (c + r) % 2 == 1; }},
      {"one in four", [](std::size_t c, std::size_t r) { return (c % 2 == 1 || r % 2 == 1) && c + r != 2; }},
      {"border", [](std::size_t c, std::size_t r) { return r == 0 && c % 3 == 1; }},
      {"70 % at random", at_random(0.7, 17)}};
  return all;
}

TEST(Holes, AFilledPlaneIsThePlane) {
  for (const auto& [name, gone] : patterns()) {
    SCOPED_TRACE(name);
    const Heights plane = [](std::size_t c, std::size_t r) {
      return 0.75 * static_cast<double>(c) - 1.5 * static_cast<double>(r);
    };
    HeightField field = field_of(60, 50, gone, plane);
    const Holes holes = find_holes(field);
    ASSERT_GT(holes.gaps, 0u);
    fill_gaps(field, holes, nullptr, 1);
    EXPECT_EQ(field.holes, holes.voids + holes.outside);
    // Heights of up to 75 mm round to 4e-6.
    EXPECT_LE(worst_difference(field, plane), 8e-6);
    EXPECT_GE(static_cast<double>(field.high_mm), 44.0) << "tops and range are those of the filled field";
  }
}

// Curvature 0.1 per post: over a gap between points w posts apart a plane would be wrong by 0.1 w^2 / 8, 0.05
// for one post, 0.8 for seven rows.
TEST(Holes, AFilledWaveIsTheWave) {
  const Heights wave = [](std::size_t c, std::size_t r) {
    return 10.0 * std::cos(0.1 * static_cast<double>(c)) * std::cos(0.1 * static_cast<double>(r));
  };
  for (const auto& [name, gone] : patterns()) {
    SCOPED_TRACE(name);
    HeightField field = field_of(60, 50, gone, wave);
    fill_gaps(field, find_holes(field), nullptr, 1);
    EXPECT_LT(worst_difference(field, wave), name == "70 % at random"                  ? 0.1
                                             : name.find("seven") != std::string::npos ? 0.3
                                                                                       : 0.01);
  }
}

// Points that say nothing of a direction (all in a row, on a ring) must not become large numbers.
TEST(Holes, AFillingStaysNearTheRangeOfItsPoints) {
  for (const std::uint64_t seed : {1u, 2u, 3u, 4u, 5u, 6u, 7u, 8u}) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const double share = 0.09 * static_cast<double>(seed);
    const Gone gone = [&](std::size_t, std::size_t) { return random.uniform() < share; };
    HeightField field = field_of(
        120, 120, gone, [&](std::size_t, std::size_t) { return random.uniform() < 0.5 ? -1.0 : 1.0; });
    fill_gaps(field, find_holes(field), nullptr, 1);
    for (const float height : field.height_mm)
      if (std::isfinite(height)) {
        ASSERT_LT(std::abs(height), 3.0f) << "points at -1 and 1";
      }
  }
}

TEST(Holes, TheSameFillingForAnyNumberOfThreads) {
  HeightField one = field_of(300, 200, at_random(0.5, 0), rough(1.0, 4));
  HeightField four = one;
  const Holes holes = find_holes(one);
  std::vector<std::uint32_t> first(one.posts(), kNoPoint), second;
  for (std::uint32_t post = 0; post < first.size(); ++post)
    if (holes.of_post[post] == PostKind::kPoint) first[post] = post;
  second = first;
  fill_gaps(one, holes, &first, 1);
  fill_gaps(four, holes, &second, 4);
  // Voids and what is outside are no numbers, which differ from themselves.
  for (std::size_t post = 0; post < one.posts(); ++post)
    ASSERT_TRUE(one.height_mm[post] == four.height_mm[post] ||
                (std::isnan(one.height_mm[post]) && std::isnan(four.height_mm[post])));
  EXPECT_EQ(first, second);
  for (std::uint32_t post = 0; post < first.size(); ++post) {
    if (holes.of_post[post] != PostKind::kGap) continue;
    ASSERT_NE(first[post], kNoPoint);
    const auto distance_sq = [&](std::uint32_t other) {
      const double dx = static_cast<double>(other % one.columns) - post % one.columns;
      const double dy = static_cast<double>(other / one.columns) - post / one.columns;
      return dx * dx + dy * dy;
    };
    for (std::uint32_t dy = 0; dy < 5; ++dy)
      for (std::uint32_t dx = 0; dx < 5; ++dx) {
        const std::uint64_t c = std::uint64_t{post % one.columns} + dx - 2,
                            r = std::uint64_t{post / one.columns} + dy - 2;
        if (c >= one.columns || r >= one.rows) continue;
        const std::size_t other = one.at(static_cast<std::uint32_t>(c), static_cast<std::uint32_t>(r));
        if (holes.of_post[other] != PostKind::kPoint) continue;
        ASSERT_LE(distance_sq(first[post]), distance_sq(static_cast<std::uint32_t>(other)));
      }
  }
}

bool is_height_field(std::size_t columns, std::size_t rows, const Gone& gone) {
  const HeightFieldSummary facts = summarise_height_field(cloud_of(posts(columns, rows, 1.0, without(gone))));
  EXPECT_EQ(facts.words.find("no height field") == std::string::npos, facts.is) << facts.words;
  return facts.is;
}

TEST(Holes, PointsStrewnThinlyOverALatticeAreNoHeightField) {
  EXPECT_TRUE(is_height_field(200, 200, at_random(0.7, 0)));
  EXPECT_TRUE(is_height_field(200, 200, at_random(0.85, 0)));
  EXPECT_FALSE(is_height_field(200, 200, at_random(0.95, 0)));
  EXPECT_TRUE(
      is_height_field(200, 200, [](std::size_t c, std::size_t r) { return c % 3 != 0 || r % 2 != 0; }));
  // Every fifth post each way, of a lattice whose pitch one point alone gives away.
  EXPECT_FALSE(is_height_field(200, 200, [](std::size_t c, std::size_t r) {
    return (c % 5 != 0 || r % 5 != 0) && !(c == 6 && r == 6);
  }));
  // Half of it dense: the thin half counts by its area, not by its few points.
  EXPECT_FALSE(is_height_field(
      200, 200, [](std::size_t c, std::size_t r) { return c >= 100 && (c % 9 != 0 || r % 9 != 0); }));
  // Wide voids in dense data, an island, a strip two posts wide, and lattices below the window's size.
  EXPECT_TRUE(is_height_field(200, 200, [](std::size_t c, std::size_t r) {
    return c % 40 >= 10 && c % 40 < 30 && r % 40 >= 10 && r % 40 < 30;
  }));
  EXPECT_TRUE(is_height_field(100, 100, [](std::size_t c, std::size_t r) {
    return std::hypot(static_cast<double>(c) - 30, static_cast<double>(r) - 30) > 25;
  }));
  EXPECT_TRUE(
      is_height_field(100, 100, [](std::size_t c, std::size_t r) { return c > 60 && r != 50 && r != 51; }));
  EXPECT_TRUE(is_height_field(3, 2, box(1, 1, 1, 1)));
}

}  // namespace
}  // namespace palpate::cloud
