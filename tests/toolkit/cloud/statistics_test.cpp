#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "toolkit/cloud/generate.h"
#include "toolkit/cloud/sample.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/random.h"

namespace palpate::cloud {
namespace {

Cloud cloud_of(const std::vector<Vec3>& points) {
  return *build_cloud(points, NonFinite::kRefuse);
}
Cloud generated(const std::string& text) {
  return generate(*parse_named_options(text))->cloud;
}
/// The same points in another order.
Cloud shuffled(Cloud cloud, std::uint64_t seed) {
  Random random(seed);
  for (std::size_t i = cloud.size(); i-- > 1;) {
    const std::size_t j = random.below(i + 1);
    std::swap(cloud.x_mm[i], cloud.x_mm[j]);
    std::swap(cloud.y_mm[i], cloud.y_mm[j]);
    std::swap(cloud.z_mm[i], cloud.z_mm[j]);
  }
  cloud.raster.reset();
  return cloud;
}

TEST(Statistics, DensityIsPointsPerBoxVolume) {
  const Statistics s = describe(cloud_of({{0, 0, 0}, {2, 0, 0}, {2, 5, 0}, {1, 1, 0.5}}));
  EXPECT_EQ(s.points, 4u);
  EXPECT_DOUBLE_EQ(s.density_per_mm3, 4.0 / (2 * 5 * 0.5));
  EXPECT_TRUE(std::isinf(describe(generated("plane:points=100")).density_per_mm3));
}

TEST(Statistics, DuplicatesAreCountedAsPointsMinusPlaces) {
  const Cloud c = cloud_of({{1, 1, 1}, {0, 0, 0}, {1, 1, 1}, {-1, 2, 0}, {1, 1, 1}, {0, 0, -0.0}});
  EXPECT_EQ(count_duplicates(c), 3u);
  EXPECT_EQ(count_duplicates(generated("sphere:points=5000")), 0u);
}

TEST(Statistics, BoundsWhatStoringLoses) {
  constexpr std::uint64_t kSeed = 7;
  SCOPED_TRACE(kSeed);
  for (const double scale : {1e-3, 1.0, 1e6}) {
    Random random(kSeed);
    std::vector<Vec3> points;
    for (int i = 0; i < 1000; ++i)
      points.push_back(scale * Vec3(random.uniform() + 1e3, 5.0 * random.uniform(), random.uniform()));
    const Cloud cloud = cloud_of(points);
    double worst = 0.0;
    for (std::size_t i = 0; i < points.size(); ++i)
      worst = std::max(worst, (cloud.point_mm(i) - points[i]).norm());
    EXPECT_LE(worst, stored_rounding_mm(cloud)) << scale;
    EXPECT_GT(worst, 0.1 * stored_rounding_mm(cloud)) << "no looser than needed";
  }
  EXPECT_EQ(stored_rounding_mm(Cloud{}), 0.0);
}

TEST(Statistics, FindsTheScannersRaster) {
  for (const char* how : {"", ":jitter=0.4", ":nonuniform=0.8", ":scale=0.001", ":scale=1000000"}) {
    Cloud c = generated(std::string("sinusoid:points=900") + how);
    c.raster.reset();
    const auto raster = find_raster(c);
    ASSERT_TRUE(raster) << how;
    EXPECT_EQ(raster->columns, 30u);
    EXPECT_EQ(raster->rows, 30u);
    EXPECT_EQ(raster->order, ScanOrder::kRaster);
    EXPECT_FALSE(find_raster(shuffled(c, 5))) << how;
  }
  // To and fro, with turns that are never exact.
  for (const char* how : {"", ":jitter=0.4", ":nonuniform=0.8", ":scale=0.001", ":scale=1000000"}) {
    Cloud c = generated(std::string("sinusoid:points=900:order=boustrophedon") + how);
    c.raster.reset();
    Random random(3);
    for (std::size_t i = 0; i < c.size(); ++i) {
      const auto shift = static_cast<float>(random.uniform(-0.002, 0.002)) * c.x_mm[0];
      if (std::string(how).empty()) c.x_mm[i] += shift;
    }
    const auto raster = find_raster(c);
    ASSERT_TRUE(raster) << how;
    EXPECT_EQ(raster->columns, 30u);
    EXPECT_EQ(raster->rows, 30u);
    EXPECT_EQ(raster->order, ScanOrder::kBoustrophedon);
    EXPECT_FALSE(find_raster(shuffled(c, 5))) << how;
  }
  Cloud round = generated("torus:points=3000:order=turntable");
  ASSERT_TRUE(round.raster);
  EXPECT_TRUE(round.raster->columns_wrap && round.raster->rows_wrap);
  round.raster.reset();
  EXPECT_FALSE(find_raster(round)) << "what goes round is not recognised";
  // Rows along z, falling, as a scanner that stands upright delivers them.
  std::vector<Vec3> upright;
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 7; ++column)
      upright.push_back({0.1 * row * column, 2.0 * row, -1.0 * column});
  const auto raster = find_raster(cloud_of(upright));
  ASSERT_TRUE(raster);
  EXPECT_EQ(raster->columns, 7u);
  EXPECT_EQ(raster->rows, 4u);
  upright.pop_back();
  EXPECT_FALSE(find_raster(cloud_of(upright))) << "a hole";
  EXPECT_FALSE(find_raster(generated("sphere:points=3000")));
  EXPECT_FALSE(find_raster(cloud_of({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}}))) << "one row";
}

TEST(Statistics, TellsHeightFieldsFromBodies) {
  for (const char* field :
       {"sinusoid", "plane", "saddle", "wedge:angle_deg=60", "sinusoid:jitter=0.4:nonuniform=0.5"})
    for (const char* scale : {"0.001", "1000000"}) {
      const Cloud c = generated(std::string(field) + ":points=10000:scale=" + scale);
      EXPECT_TRUE(is_single_valued(c)) << field;
      EXPECT_TRUE(is_single_valued(shuffled(c, 3))) << field << ", whatever the order";
    }
  for (const char* body : {"sphere:points=10000", "torus:points=10000", "slab:points=10000",
                           "slab:points=10000:thickness_mm=0.01"})
    EXPECT_FALSE(is_single_valued(generated(body))) << body;
  EXPECT_FALSE(is_single_valued(cloud_of({{0, 0, 0}, {0, 1, 0}, {0, 2, 5}}))) << "no extent in x";
}

TEST(Sample, IsSomeOfThePointsInTheirOrder) {
  const Cloud whole = generated("torus:points=5000");
  const Cloud some = sample_of(whole, 700, 3);
  ASSERT_EQ(some.size(), 700u);
  std::size_t at = 0;
  for (std::size_t i = 0; i < some.size(); ++i) {
    while (at < whole.size() && whole.point_mm(at) != some.point_mm(i)) ++at;
    ASSERT_LT(at++, whole.size()) << "no point of the cloud, or out of order: " << i;
  }
  EXPECT_EQ(sample_of(whole, 700, 3).x_mm, some.x_mm) << "the same for the same seed";
  EXPECT_NE(sample_of(whole, 700, 4).x_mm, some.x_mm);
  EXPECT_EQ(sample_of(whole, whole.size(), 3).x_mm, whole.x_mm);
  EXPECT_EQ(sample_of(whole, 2 * whole.size(), 3).size(), whole.size());
}

TEST(Cloud, MorePointsThanPlacesAreRefusedUnread) {
  const Vec3 only = Vec3::Zero();
  // No such memory is there: the count alone is looked at.
  const std::span<const Vec3> many(&only, std::size_t{1} << 31);
  const auto built = build_cloud(many, NonFinite::kRefuse);
  ASSERT_FALSE(built.ok());
  EXPECT_NE(built.error().remedy.find("several models"), std::string::npos);
}

}  // namespace
}  // namespace palpate::cloud
