// Every builder against brute force over distributions that break grids and trees.
#include "toolkit/neighbourhood/knn.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "tests/toolkit/neighbourhood/cases.h"
#include "toolkit/core/random.h"

namespace palpate::neighbourhood {
namespace {

TEST(ExactKnn, EqualsBruteForceForAnyThreads) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const cloud::Cloud cloud = built(c.points);
    const NeighbourTable expected = brute(cloud);
    for (const int threads : {1, 3}) {
      const NeighbourTable table = exact_knn(cloud, threads);
      ASSERT_EQ(table.of.size(), expected.of.size());
      for (std::size_t i = 0; i < table.size(); ++i) ASSERT_EQ(table.of[i], expected.of[i]) << "point " << i;
    }
  }
}

// The printed procedure, step by step: refine while the block holds more than nine, grow while it holds
// fewer.
Neighbours stepwise(const cloud::Cloud& cloud, std::uint32_t self, const ModifiedKnnOptions& options,
                    double start_mm, ModifiedKnnReport& report) {
  // The half edge of the smallest block that has each point in it.
  std::vector<std::pair<double, std::uint32_t>> reached;
  for (std::uint32_t j = 0; j < cloud.size(); ++j)
    reached.emplace_back((cloud.local_mm(j) - cloud.local_mm(self)).cwiseAbs().maxCoeff(), j);
  std::sort(reached.begin(), reached.end());
  const auto held = [&](double half) {
    const std::pair last(half, std::numeric_limits<std::uint32_t>::max());
    return static_cast<std::size_t>(std::upper_bound(reached.begin(), reached.end(), last) - reached.begin());
  };
  const double limit = 1.5 * start_mm * options.growth_limit;
  double half = 1.5 * start_mm;
  while (half / options.refinement <= limit) half /= options.refinement;
  std::size_t smallest_enough = held(half);
  const bool limited = smallest_enough < 9;
  std::size_t at_most = limited ? smallest_enough : 0;
  if (!limited) {
    std::size_t next = smallest_enough;
    for (int step = 0; step < 4000 && next >= 9; ++step) {
      smallest_enough = next;
      half *= options.refinement;
      next = held(half);
    }
    at_most = smallest_enough == 9 ? smallest_enough : next;
  }
  const bool at_nine = !limited && (smallest_enough == 9 || !options.complete_to_eight);
  report.stopped_at_limit += limited;
  report.stopped_at_nine += at_nine;
  const std::size_t chosen = options.complete_to_eight && !limited ? smallest_enough : at_most;
  std::vector<std::pair<double, std::uint32_t>> order;
  for (std::size_t k = 0; k < chosen; ++k)
    if (const std::uint32_t j = reached[k].second; j != self) {
      const Vec3 d = cloud.local_mm(j) - cloud.local_mm(self);
      order.emplace_back(d.x() * d.x() + d.y() * d.y() + d.z() * d.z(), j);
    }
  report.fewer_than_eight += order.size() < kNeighbours;
  std::sort(order.begin(), order.end());
  Neighbours n;
  n.fill(self);
  for (std::size_t k = 0; k < std::min(order.size(), kNeighbours); ++k) n[k] = order[k].second;
  return n;
}

TEST(ModifiedKnn, IsThePrintedProcedure) {
  for (const bool complete : {true, false}) {
    for (const Case& c : cases()) {
      if (c.name == "all at one place" || c.name == "pile beside a sheet")
        continue;  // no block separates a pile
      SCOPED_TRACE(c.name + (complete ? ", completed" : ", as printed"));
      const cloud::Cloud cloud = built(c.points);
      ModifiedKnnOptions options;
      options.complete_to_eight = complete;
      ModifiedKnnReport report;
      const NeighbourTable table = modified_knn(cloud, options, 2, &report);
      const double start = mean_spacing_mm(cloud);
      // All points of small clouds, and then the report too; every seventh of others.
      constexpr std::size_t kSmall = 1000;
      const std::uint32_t stride = cloud.size() <= kSmall ? 1 : 7;
      ModifiedKnnReport expected;
      for (std::uint32_t i = 0; i < cloud.size(); i += stride)
        ASSERT_EQ(table.of[i], stepwise(cloud, i, options, start, expected)) << "point " << i;
      if (stride > 1) continue;
      EXPECT_EQ(report.stopped_at_nine, expected.stopped_at_nine);
      EXPECT_EQ(report.stopped_at_limit, expected.stopped_at_limit);
      EXPECT_EQ(report.fewer_than_eight, expected.fewer_than_eight);
    }
  }
}

// However fine its steps: none of the sizes between the limit and the points may be left out.
TEST(ModifiedKnn, IsThePrintedProcedureInFineStepsToo) {
  const cloud::Cloud cloud = built(sheet(20, 20, 0.1, 0.3, 6));
  const double start = mean_spacing_mm(cloud);
  for (const double refinement : {0.5, 0.9, 0.98, 0.99}) {
    SCOPED_TRACE(refinement);
    ModifiedKnnOptions options;
    options.complete_to_eight = false;
    options.refinement = refinement;
    const NeighbourTable table = modified_knn(cloud, options, 2);
    ModifiedKnnReport expected;
    for (std::uint32_t i = 0; i < cloud.size(); ++i)
      ASSERT_EQ(table.of[i], stepwise(cloud, i, options, start, expected)) << "point " << i;
  }
}

TEST(ModifiedKnn, StopsAtTheGrowthLimit) {
  // A pair far from a sheet: no block up to the limit reaches nine points, so only each other are found.
  std::vector<Vec3> points = sheet(30, 30, 0.1, 0.2, 5);
  points.emplace_back(1000, 0, 0);
  points.emplace_back(1000.1, 0, 0);
  const cloud::Cloud cloud = built(points);
  ModifiedKnnReport report;
  const NeighbourTable table = modified_knn(cloud, {}, 1, &report);
  EXPECT_EQ(report.stopped_at_limit, 2u);
  EXPECT_EQ(report.fewer_than_eight, 2u);
  EXPECT_EQ(table.count(900), 1u);
  EXPECT_EQ(table.of[900][0], 901u);
}

TEST(ModifiedKnn, PilesKeepEightAtDistanceZero) {
  const cloud::Cloud cloud = built(std::vector<Vec3>(300, Vec3(5, 5, 5)));
  const NeighbourTable table = modified_knn(cloud, {}, 1);
  for (std::uint32_t i = 0; i < cloud.size(); ++i) EXPECT_EQ(table.count(i), 8u);
}

TEST(ScannerPath, IsTheThreeByThreePatch) {
  cloud::Cloud cloud = built(sheet(5, 4, 1.0, 0.0, 1));
  EXPECT_FALSE(scanner_path(cloud, 1));
  cloud.raster = cloud::ScanRaster{5, 4};
  const auto table = scanner_path(cloud, 2);
  ASSERT_TRUE(table);
  Neighbours middle = table->of[7];
  std::sort(middle.begin(), middle.end());
  EXPECT_EQ(middle, (Neighbours{1, 2, 3, 6, 8, 11, 12, 13}));
  EXPECT_EQ(table->count(0), 3u);
  EXPECT_EQ(table->count(2), 5u);
  cloud.raster = cloud::ScanRaster{5, 5};
  EXPECT_FALSE(scanner_path(cloud, 1));
}

TEST(ScannerPath, AgreesExactlyInsideAFlatGridOnly) {
  cloud::Cloud cloud = built(sheet(60, 50, 0.25, 0.0, 1));  // 0.25 is exact, so distances tie exactly
  cloud.raster = cloud::ScanRaster{60, 50};
  const NeighbourTable path = scanner_path(cloud, 0).value();
  for (const NeighbourTable& table : {modified_knn(cloud, {}, 0), exact_knn(cloud, 0)}) {
    std::size_t equal = 0, interior = 0;
    for (std::uint32_t i = 0; i < cloud.size(); ++i) {
      if (path.count(i) < kNeighbours) continue;
      ++interior;
      Neighbours a = path.of[i], b = table.of[i];
      std::sort(a.begin(), a.end());
      std::sort(b.begin(), b.end());
      equal += a == b;
    }
    EXPECT_EQ(interior, 58u * 48u);
    EXPECT_EQ(equal, interior);
    const Agreement counted = agreement(path, table);
    EXPECT_EQ(counted.interior_equal, interior);
    EXPECT_LT(counted.equal_sets, counted.points);  // borders differ
  }
}

}  // namespace
}  // namespace palpate::neighbourhood
