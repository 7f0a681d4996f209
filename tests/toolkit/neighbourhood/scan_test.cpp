// Statistics of real scans, where $PALPATE_DATA is set, against numbers found independently (the data's own
// manifest).
#include <gtest/gtest.h>

#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "toolkit/cloud/statistics.h"
#include "toolkit/io/read_model.h"
#include "toolkit/neighbourhood/knn.h"
#include "toolkit/neighbourhood/spacing.h"

namespace palpate::neighbourhood {
namespace {

/// As printed: distances in the file's unit with four digits.
struct Known {
  const char* file;
  std::size_t points, duplicates;
  Vec3 low, high;
  double nearest_p50, nearest_p999, nearest_max;
  bool single_valued;
};

const Known kKnown[] = {
    {"stanford/bun_zipper.ply.xz",
     35947,
     0,
     {-0.0946899, 0.0329874, -0.0618736},
     {0.0610091, 0.187321, 0.0587997},
     0.001012,
     0.001616,
     0.00224,
     false},
    {"stanford/dragon_vrip_res3.ply.gz",
     22998,
     0,
     {-0.107673, 0.0527743, -0.050051},
     {0.0959825, 0.196644, 0.0408262},
     0.001358,
     0.002131,
     0.002303,
     false},
    {"stanford/dragon_vrip.ply.gz",
     437645,
     2100,
     {-0.108324, 0.0527295, -0.0504143},
     {0.0965662, 0.197173, 0.0412075},
     0.0002184,
     0.0007889,
     0.001885,
     false},
    {"lidar/lone-star.ply.xz",
     518862,
     0,
     {515369, 4.91834e+06, 2322.9},
     {515401, 4.91838e+06, 2338.58},
     0.02977,
     0.1914,
     1.331,
     false},
};

class RealScan : public ::testing::TestWithParam<Known> {};

TEST_P(RealScan, HasTheNumbersOfTheManifest) {
  const char* folder = std::getenv("PALPATE_DATA");
  if (folder == nullptr) GTEST_SKIP() << "set PALPATE_DATA to a folder with the scans";
  const Known& known = GetParam();
  const std::string file = (std::filesystem::path(folder) / known.file).string();
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "not there: " << known.file;
  io::Readers readers;
  io::add_standard_readers(readers);
  io::ReadOptions options;
  options.unit = io::Unit::kMillimetre;  // numbers stay as the file has them
  const auto model = readers.read(file, options);
  ASSERT_TRUE(model) << model.error().message();

  const cloud::Statistics s = cloud::describe(model->cloud);
  EXPECT_EQ(s.points, known.points);
  EXPECT_EQ(s.duplicates, known.duplicates);
  // Six digits are printed.
  EXPECT_LT((s.box_mm.low_mm - known.low).cwiseQuotient(known.low).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_LT((s.box_mm.high_mm - known.high).cwiseQuotient(known.high).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_EQ(s.single_valued, known.single_valued);
  EXPECT_FALSE(s.raster);

  const Spacing spacing = describe_spacing(model->cloud, exact_knn(model->cloud, 0));
  EXPECT_NEAR(spacing.nearest_mm.p50, known.nearest_p50, 1e-3 * known.nearest_p50);
  EXPECT_NEAR(spacing.nearest_mm.p999, known.nearest_p999, 5e-3 * known.nearest_p999);
  EXPECT_NEAR(spacing.nearest_mm.max, known.nearest_max, 1e-3 * known.nearest_max);
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
}  // namespace palpate::neighbourhood
