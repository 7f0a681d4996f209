// Resolution and spacing, by hand and against the thesis's printed values.
#include <gtest/gtest.h>

#include <cctype>
#include <string>
#include <vector>

#include <palpate/generate.h>
#include <palpate/read_model.h>
#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "tests/toolkit/search/cases.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {
namespace {

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
  const auto model =
      test::value_of(cloud::generate(*parse_named_options("sinusoid:points=1002001:mesh=false")));
  const Spacing s = describe_spacing(model.cloud, raster_table(model.cloud));
  EXPECT_NEAR(s.plan_resolution_mm, 0.1414, 5e-5);
  EXPECT_NEAR(s.resolution_mm, 0.288, 5e-4);
  EXPECT_EQ(s.median_index_distance, 1.0);
  EXPECT_TRUE(s.high_resolution);
  EXPECT_NEAR(s.nearest_mm.min, 0.1, 1e-5);
}

TEST(Spacing, ByHand) {
  // On a line: 0, 1, 3, 7; and a duplicate of 7.
  const cloud::Cloud cloud = cloud_of({{0, 0, 0}, {1, 0, 0}, {3, 0, 0}, {7, 0, 0}, {7, 0, 0}});
  const Spacing s = describe_spacing(cloud, brute(cloud));
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
  for (const std::size_t points : {12u, 1u}) {
    const cloud::Cloud cloud = cloud_of(std::vector<Vec3>(points, Vec3(1, 2, 3)));
    const Spacing s = describe_spacing(cloud, brute(cloud));
    EXPECT_EQ(s.without_nearest, 1u) << "one position";
    EXPECT_EQ(s.resolution_mm, 0.0);
    EXPECT_EQ(s.nearest_mm.max, 0.0);
  }
}

TEST(Spacing, ScalesWithTheModel) {
  const auto one = cloud::generate(*parse_named_options("sphere:points=1500:jitter=0.3"));
  const auto big = cloud::generate(*parse_named_options("sphere:points=1500:jitter=0.3:scale=1048576"));
  const Spacing a = describe_spacing(one->cloud, brute(one->cloud));
  const Spacing b = describe_spacing(big->cloud, brute(big->cloud));
  EXPECT_EQ(b.resolution_mm, 1048576 * a.resolution_mm);
  EXPECT_EQ(b.nearest_mm.p50, 1048576 * a.nearest_mm.p50);
  EXPECT_EQ(b.eighth_mm.p999, 1048576 * a.eighth_mm.p999);
  EXPECT_GT(a.eighth_mm.min, a.nearest_mm.min);
}

// Statistics of real scans, where $PALPATE_DATA is set, against numbers found independently (the data's own
// manifest).

/// Distances in the file's unit with four digits.
struct Known {
  const char* file;
  std::size_t points, duplicates;
  Vec3 low, high;
  Vec3 nearest;  // median, 99.9 % and the most
};

const Known kKnown[] = {{"stanford/bun_zipper.ply.xz", 35947, 0, Vec3(-0.0946899, 0.0329874, -0.0618736),
                         Vec3(0.0610091, 0.187321, 0.0587997), Vec3(0.001012, 0.001616, 0.00224)},
                        {"stanford/dragon_vrip_res3.ply.gz", 22998, 0, Vec3(-0.107673, 0.0527743, -0.050051),
                         Vec3(0.0959825, 0.196644, 0.0408262), Vec3(0.001358, 0.002131, 0.002303)},
                        {"stanford/dragon_vrip.ply.gz", 437645, 2100, Vec3(-0.108324, 0.0527295, -0.0504143),
                         Vec3(0.0965662, 0.197173, 0.0412075), Vec3(0.0002184, 0.0007889, 0.001885)},
                        {"lidar/lone-star.ply.xz", 518862, 0, Vec3(515369, 4.91834e+06, 2322.9),
                         Vec3(515401, 4.91838e+06, 2338.58), Vec3(0.02977, 0.1914, 1.331)}};

class RealScan : public ::testing::TestWithParam<Known> {};

TEST_P(RealScan, HasTheNumbersOfTheManifest) {
  const Known& known = GetParam();
  const std::string file = shared_data(known.file).string();
  if (file.empty()) GTEST_SKIP() << "not in PALPATE_DATA: " << known.file;
  io::Readers readers;
  io::add_standard_readers(readers);
  io::ReadOptions options;
  options.unit = io::Unit::kMillimetre;  // numbers stay as the file has them
  const auto model = test::value_of(readers.read(file, options));

  const cloud::Statistics s = cloud::describe(model.cloud);
  EXPECT_EQ(s.points, known.points);
  EXPECT_EQ(s.duplicates, known.duplicates);
  // Six digits are printed.
  EXPECT_LT((s.box_mm.low_mm - known.low).cwiseQuotient(known.low).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_LT((s.box_mm.high_mm - known.high).cwiseQuotient(known.high).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_FALSE(s.single_valued);
  EXPECT_FALSE(s.raster);

  const Spacing spacing = describe_spacing(model.cloud, exact_knn(model.cloud, 0));
  EXPECT_NEAR(spacing.nearest_mm.p50, known.nearest.x(), 1e-3 * known.nearest.x());
  EXPECT_NEAR(spacing.nearest_mm.p999, known.nearest.y(), 5e-3 * known.nearest.y());
  EXPECT_NEAR(spacing.nearest_mm.max, known.nearest.z(), 1e-3 * known.nearest.z());
  EXPECT_LE(spacing.without_nearest, 1u);  // one place of the dragon holds nine points
  RecordProperty("resolution", std::to_string(spacing.resolution_mm));
  RecordProperty("median_index_distance", std::to_string(spacing.median_index_distance));
}

INSTANTIATE_TEST_SUITE_P(Manifest, RealScan, ::testing::ValuesIn(kKnown), [](const auto& known) {
  std::string name = known.param.file;
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  return name;
});

}  // namespace
}  // namespace palpate::search
