// Real scans from $PALPATE_DATA, against what is known of each.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "toolkit/io/read_model.h"

namespace palpate::io {
namespace {

struct Scan {
  const char* file;
  std::size_t points;
  std::size_t faces;
  std::size_t properties;
  Unit unit;
  double extent_x_mm;
};

TEST(Scans, AreReadWhole) {
  const char* data = std::getenv("PALPATE_DATA");
  if (data == nullptr) GTEST_SKIP() << "set PALPATE_DATA to the folder of scans to run this test";
  const std::vector<Scan> scans{
      {"stanford/dragon_vrip.ply.gz", 437645, 871414, 0, Unit::kMetre, 204.89},
      {"stanford/dragon_vrip_res2.ply.gz", 100250, 202520, 0, Unit::kMetre, 204.594},
      {"stanford/dragon_vrip_res3.ply.gz", 22998, 47794, 0, Unit::kMetre, 203.656},
      {"stanford/dragon_vrip_res4.ply.gz", 5205, 11102, 0, Unit::kMetre, 202.821},
      {"stanford/bun_zipper.ply.xz", 35947, 69451, 2, Unit::kMetre, 155.699},
      // Raw scans say the row and column of each point.
      {"stanford/bunny_range/bun000.ply.xz", 40256, 0, 2, Unit::kMetre, 155.75},
      {"stanford/bunny_range/ear_back.ply.xz", 32193, 0, 2, Unit::kMetre, 190.5},
      {"stanford/bunny_range_merged.ply.xz", 362272, 0, 3, Unit::kMetre, 175.647},
      {"stanford/dragon_stand_merged.ply.xz", 469193, 0, 3, Unit::kMetre, 247.731},
      {"lidar/lone-star.ply.xz", 518862, 0, 1, Unit::kMetre, 32440.8},
      // A street scan in metres of 73 m: the guess takes it for a 73 mm object, and says so.
      {"lidar/small_gicp_source.ply.xz", 69792, 0, 1, Unit::kMillimetre, 42.239}};
  Readers readers;
  add_standard_readers(readers);
  std::size_t found = 0;
  for (const Scan& scan : scans) {
    const std::filesystem::path path = std::filesystem::path(data) / scan.file;
    if (!std::filesystem::exists(path)) continue;
    ++found;
    SCOPED_TRACE(scan.file);
    const Result<ReadModel> model = readers.read(path.string(), {});
    ASSERT_TRUE(model) << model.error().message();
    EXPECT_EQ(model->cloud.size(), scan.points);
    EXPECT_EQ(model->non_finite, 0u);
    EXPECT_EQ(model->mesh ? model->mesh->triangles.size() : 0, scan.faces);
    EXPECT_EQ(model->dropped_faces, 0u);
    EXPECT_EQ(model->cloud.properties.size(), scan.properties);
    EXPECT_EQ(model->unit, scan.unit);
    EXPECT_TRUE(model->unit_guessed);
    EXPECT_NEAR(model->cloud.box_mm().extent_mm().x(), scan.extent_x_mm, 1e-5 * scan.extent_x_mm);
    EXPECT_FALSE(model->cloud.raster);
  }
  if (found == 0) GTEST_SKIP() << "none of the scans is under PALPATE_DATA";
}

}  // namespace
}  // namespace palpate::io
