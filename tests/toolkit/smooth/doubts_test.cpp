// What `cloud-smooth` says beforehand of points that it cannot follow, and of which it says nothing.
#include "toolkit/smooth/doubts.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "tests/toolkit/smooth/smooth_scenes.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/smooth/first_ball.h"

namespace palpate::render {
namespace {

PointDoubts doubts_of(const cloud::Cloud& cloud) {
  const SmoothPoints points(cloud, 1);
  return find_doubts(points, measure_noise(points, 1), 1);
}
cloud::Cloud generated(const std::string& text) {
  return cloud::generate(parse_named_options(text).value()).value().cloud;
}

TEST(PointDoubts, OfThinPlates) {
  for (const double thickness : {0.01, 0.03, 0.1}) {
    const PointDoubts d =
        doubts_of(generated(fmt::format("slab:extent_mm=16:thickness_mm={}:spacing_mm=0.3", thickness)));
    EXPECT_GT(d.layered, 0.5) << thickness;
    EXPECT_NEAR(d.layers_mm, thickness, 0.2 * thickness);
    EXPECT_LT(d.scattered, 0.01);
  }
  EXPECT_LT(doubts_of(generated("slab:extent_mm=16:thickness_mm=1:spacing_mm=0.3")).layered, 0.02);
}

TEST(PointDoubts, NoneOfSurfaces) {
  for (const char* text : {"sinusoid:points=10201", "sinusoid:points=10000:sampling=random:noise=0.2",
                           "sphere:points=5000", "sinusoid:points=10000:sampling=random:noise=0.5",
                           "pebble:points=6000", "slab:points=20000:noise=0.15",
                           "sinusoid:sampling=scan:points=20000:noise=0.1:dropout=0.05:flying=0.01:seed=1"}) {
    const PointDoubts d = doubts_of(generated(text));
    EXPECT_LT(d.layered, 0.02) << text;
    EXPECT_LT(d.scattered, 0.05) << text;
  }
}

TEST(PointDoubts, OfVolumes) {
  Random random(9);
  const auto length = [&] { return random.uniform(-5.0, 5.0); };
  std::vector<Vec3> points;
  for (int i = 0; i < 3000; ++i) points.push_back(Vec3{length(), length(), length()});
  EXPECT_GT(doubts_of(cloud::build_cloud(points, cloud::NonFinite::kRefuse).value()).scattered, 0.3);
}

}  // namespace
}  // namespace palpate::render
