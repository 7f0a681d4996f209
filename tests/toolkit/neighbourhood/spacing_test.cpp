// Resolution and spacing, by hand and against the thesis's printed values.
#include "toolkit/neighbourhood/spacing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "toolkit/cloud/generate.h"

namespace palpate::neighbourhood {
namespace {

/// The eight nearest by trying all.
NeighbourTable brute_force(const cloud::Cloud& cloud) {
  NeighbourTable table;
  table.of.resize(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    std::vector<std::pair<double, std::uint32_t>> all;
    for (std::size_t j = 0; j < cloud.size(); ++j)
      if (j != i)
        all.emplace_back((cloud.local_mm(j) - cloud.local_mm(i)).squaredNorm(),
                         static_cast<std::uint32_t>(j));
    std::sort(all.begin(), all.end());
    table.of[i].fill(static_cast<std::uint32_t>(i));
    for (std::size_t k = 0; k < std::min(kNeighbours, all.size()); ++k) table.of[i][k] = all[k].second;
  }
  return table;
}

/// The eight around each place of a raster, fewer at its border.
NeighbourTable raster_table(const cloud::Cloud& cloud) {
  NeighbourTable table;
  table.of.resize(cloud.size());
  const int columns = static_cast<int>(cloud.raster->columns), rows = static_cast<int>(cloud.raster->rows);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c) {
      Neighbours& of = table.of[static_cast<std::size_t>(r * columns + c)];
      of.fill(static_cast<std::uint32_t>(r * columns + c));
      std::size_t n = 0;
      for (int dr = -1; dr <= 1; ++dr)
        for (int dc = -1; dc <= 1; ++dc)
          if ((dr != 0 || dc != 0) && r + dr >= 0 && r + dr < rows && c + dc >= 0 && c + dc < columns)
            of[n++] = static_cast<std::uint32_t>((r + dr) * columns + c + dc);
    }
  return table;
}

TEST(Spacing, ThePrintedResolutionOfTable7AndTheOneIn3D) {
  // A quarter of a wave holds the steepest place: 21 x 21 points 0.1 mm apart around x = y = 12.5 would do;
  // the whole surface at 0.1 mm costs little.
  const auto model = cloud::generate(*parse_named_options("sinusoid:points=1002001:mesh=false"));
  ASSERT_TRUE(model);
  const Spacing s = describe_spacing(model->cloud, raster_table(model->cloud));
  EXPECT_NEAR(s.plan_resolution_mm, 0.1414, 5e-5);
  EXPECT_NEAR(s.resolution_mm, 0.288, 5e-4);
  EXPECT_EQ(s.median_index_distance, 1.0);
  EXPECT_TRUE(s.high_resolution);
  EXPECT_NEAR(s.nearest_mm.min, 0.1, 1e-5);
}

TEST(Spacing, ByHand) {
  // On a line: 0, 1, 3, 7; and a duplicate of 7.
  const std::vector<Vec3> points = {{0, 0, 0}, {1, 0, 0}, {3, 0, 0}, {7, 0, 0}, {7, 0, 0}};
  const cloud::Cloud cloud = *cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  const Spacing s = describe_spacing(cloud, brute_force(cloud));
  EXPECT_DOUBLE_EQ(s.resolution_mm, 7.0);
  EXPECT_FALSE(s.high_resolution);
  // Nearest of the four places: 1, 1, 2, 4.
  EXPECT_DOUBLE_EQ(s.nearest_mm.min, 1.0);
  EXPECT_DOUBLE_EQ(s.nearest_mm.p50, 1.0);
  EXPECT_DOUBLE_EQ(s.nearest_mm.max, 4.0);
  EXPECT_DOUBLE_EQ(s.nearest_mm.p99, 4.0);
  EXPECT_EQ(s.without_nearest, 0u);
  EXPECT_DOUBLE_EQ(s.median_index_distance, 1.0);
}

TEST(Spacing, PointsAllInOnePlaceHaveNoNearest) {
  const std::vector<Vec3> points(12, Vec3(1, 2, 3));
  const cloud::Cloud cloud = *cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  const Spacing s = describe_spacing(cloud, brute_force(cloud));
  EXPECT_EQ(s.without_nearest, 1u) << "one position";
  EXPECT_EQ(s.resolution_mm, 0.0);
  EXPECT_EQ(s.nearest_mm.max, 0.0);
}

TEST(Spacing, OnePointHasNone) {
  const cloud::Cloud cloud = *cloud::build_cloud(std::vector<Vec3>{{1, 2, 3}}, cloud::NonFinite::kRefuse);
  const Spacing s = describe_spacing(cloud, brute_force(cloud));
  EXPECT_EQ(s.resolution_mm, 0.0);
  EXPECT_EQ(s.without_nearest, 1u);
}

TEST(Spacing, ScalesWithTheModel) {
  const auto one = cloud::generate(*parse_named_options("sphere:points=1500:jitter=0.3"));
  const auto big = cloud::generate(*parse_named_options("sphere:points=1500:jitter=0.3:scale=1048576"));
  const Spacing a = describe_spacing(one->cloud, brute_force(one->cloud));
  const Spacing b = describe_spacing(big->cloud, brute_force(big->cloud));
  EXPECT_EQ(b.resolution_mm, 1048576 * a.resolution_mm);
  EXPECT_EQ(b.nearest_mm.p50, 1048576 * a.nearest_mm.p50);
  EXPECT_EQ(b.eighth_mm.p999, 1048576 * a.eighth_mm.p999);
  EXPECT_GT(a.eighth_mm.min, a.nearest_mm.min);
}

}  // namespace
}  // namespace palpate::neighbourhood
