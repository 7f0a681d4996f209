// Paths over models without a formula, checked against the formula they were made from: by the faces, and by
// the points alone.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "toolkit/cloud/generate.h"
#include "toolkit/core/random.h"
#include "toolkit/trace/paths.h"

namespace palpate::trace {
namespace {

const char* const kSeen[] = {"weave", "raster", "spiral", "tap", "slide", "hold"};

/// A scan with a truth that no path generator sees.
struct Scan {
  cloud::GeneratedModel model;
  cloud::Cloud cloud;
  geometry::Aabb box;
  PathTarget target;
  [[nodiscard]] double distance(const Vec3& p) const {
    return model.surface->signed_distance_mm(target.world_from_model.inverse() * p);
  }
  /// Beyond its border an open surface of the formula goes on, the scan does not.
  [[nodiscard]] bool is_over(const Vec3& p) const {
    return p.x() >= box.low_mm.x() && p.x() <= box.high_mm.x() && p.y() >= box.low_mm.y() &&
           p.y() <= box.high_mm.y();
  }
};

Scan scan_of(const std::string& spec, bool faces) {
  Scan scan{cloud::generate(*parse_named_options(spec)).value(), {}, {}, {}};
  scan.cloud = scan.model.cloud;
  scan.box = scan.cloud.box_mm();
  scan.target.cloud = &scan.cloud;
  if (faces) scan.target.mesh = scan.model.original_mesh.get();
  return scan;
}

Result<ProbePath> path_of(const std::string& spec, const Scan& scan) {
  PathTarget target = scan.target;
  target.cloud = &scan.cloud;  // the scan may have been moved
  return make_path(*parse_named_options(spec), target);
}

void check(const std::string& spec, const Scan& scan, double tolerance_mm) {
  const Result<ProbePath> path = path_of(spec, scan);
  ASSERT_TRUE(path) << path.error().message();
  ASSERT_EQ(path->size(), 12000u);
  EXPECT_GT(scan.distance(path->hip_mm[0]), 0.0) << "starts free";
  double deepest = 0.0, quickest = 0.0;
  std::size_t inside = 0, outside = 0;
  for (std::size_t k = 0; k < path->size(); ++k) {
    ASSERT_TRUE(is_finite(path->hip_mm[k])) << k;
    if (k > 0) quickest = std::max(quickest, (path->hip_mm[k] - path->hip_mm[k - 1]).norm());
    // The formula's distance takes longer than all the rest.
    if (k % 5 != 0 || !scan.is_over(path->hip_mm[k])) continue;
    const double d = scan.distance(path->hip_mm[k]);
    deepest = std::max(deepest, -d);
    (d < 0 ? inside : outside)++;
  }
  EXPECT_LE(deepest, 1.0 + tolerance_mm);
  EXPECT_GE(deepest, 1.0 - tolerance_mm);
  EXPECT_LE(quickest, 4 * (0.05 + 0.7 * 2 * std::numbers::pi / 900) + 1e-9)
      << "four times surface and offset";
  EXPECT_GT(inside, 200u);
  EXPECT_GT(outside, 10u);
}

TEST(SeenPaths, KeepToTheSurfaceByFacesOrPointsAlone) {
  for (const char* shape : {"sinusoid", "plane", "saddle", "relief", "wedge:angle_deg=80",
                            "wedge:angle_deg=300", "sphere", "pebble", "torus", "slab:thickness_mm=5"})
    for (const bool faces : {true, false}) {
      const Scan scan = scan_of(std::string(shape) + ":points=40000:jitter=0.2:seed=3", faces);
      for (const char* name : kSeen) {
        SCOPED_TRACE(std::string(shape) + (faces ? " faces " : " points ") + name);
        // Facets half a millimetre long cut off the tops of bends by up to a tenth of that, planes fitted to
        // such points by up to a third.
        check(std::string(name) + ":frames=12000:depth_mm=1:clearance_mm=0.4", scan, faces ? 0.05 : 0.17);
      }
    }
}

TEST(SeenPaths, EverySideOfABody) {
  const Scan scan = scan_of("pebble:points=40000", true);
  for (const char* from : {"x", "-x", "y", "-y", "z", "-z"}) {
    SCOPED_TRACE(from);
    const Result<ProbePath> path = path_of(std::string("tap:frames=1000:u=0.5:v=0.5:from=") + from, scan);
    ASSERT_TRUE(path) << path.error().message();
    const Vec3 eye = Vec3::Unit(from[std::string(from).size() - 1] - 'x') * (from[0] == '-' ? -1.0 : 1.0);
    EXPECT_GT(path->hip_mm[0].normalized().dot(eye), 0.8);
    EXPECT_NEAR(scan.distance(path->hip_mm[0]), 0.4, 0.02);
    EXPECT_NEAR(scan.distance(path->hip_mm[450]), -2.0, 0.02);
  }
}

TEST(SeenPaths, RiseOverHolesAndStepsInsteadOfGoingThrough) {
  // Two plates, one 10 mm above the other, with a gap between them and a hole in the lower. Planes are fitted
  // up to a millimetre past a border.
  std::vector<Vec3> points;
  Random random(11);
  for (int i = 0; i < 30000; ++i) {
    const double x = random.uniform(-30, 30), y = random.uniform(-20, 20);
    if (std::abs(x) < 3 || (x < 0 && Vec3(x + 15, y, 0).norm() < 5)) continue;
    points.emplace_back(x, y, x > 0 ? 10.0 : 0.0);
  }
  Scan scan;
  scan.cloud = *cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  for (const char* name : {"weave", "raster", "spiral"}) {
    const Result<ProbePath> path =
        path_of(std::string(name) + ":frames=20000:depth_mm=1:speed_mm_s=100:from=z", scan);
    ASSERT_TRUE(path) << path.error().message();
    std::size_t low = 0, high = 0;
    for (const Vec3& p : path->hip_mm) {
      const bool over_gap = std::abs(p.x()) < 2, over_hole = Vec3(p.x() + 15, p.y(), 0).norm() < 4;
      const double lowest = over_gap || over_hole ? -1e-9 : p.x() > 3.5 ? 10 - 1.001 : -1.001;
      ASSERT_GT(p.z(), lowest) << name << " at " << p.transpose();
      low += p.x() < 0 && p.z() < -0.5;
      high += p.x() > 0 && p.z() < 10 - 0.5;
    }
    EXPECT_GT(low, 1000u) << name;
    EXPECT_GT(high, 1000u) << name;
  }
  const Result<ProbePath> in_hole = path_of("tap:u=0.25:v=0.5:from=z", scan);
  ASSERT_TRUE(in_hole);
  EXPECT_NE(in_hole->name.find("nearest place that shows"), std::string::npos) << in_hole->name;
}

TEST(SeenPaths, TheSameAtEveryScalePlaceAndTime) {
  for (const bool faces : {true, false})
    for (const char* name : kSeen) {
      SCOPED_TRACE(std::string(name) + (faces ? " faces" : " points"));
      const auto made = [&](double f, const std::string& length) {
        const Scan scan = scan_of("sinusoid:points=2500:jitter=0.2:scale=" + length, faces);
        const bool fast = std::string(name) != "tap" && std::string(name) != "hold";
        return path_of(fmt::format("{}:frames=3000:depth_mm={}:clearance_mm={}{}", name, 2 * f, 0.5 * f,
                                   fast ? fmt::format(":speed_mm_s={}", 32 * f) : ""),
                       scan)
            .value();
      };
      const ProbePath one = made(1, "1"), again = made(1, "1"), large = made(0x1p20, "1048576");
      for (std::size_t k = 0; k < one.size(); ++k) {
        ASSERT_EQ(one.hip_mm[k], again.hip_mm[k]) << k;
        ASSERT_EQ(large.hip_mm[k], 0x1p20 * one.hip_mm[k]) << k;
      }
    }
  Scan far = scan_of("sphere:points=10000", false);
  const ProbePath home = path_of("raster:frames=2000", far).value();
  far.cloud.origin_mm += Vec3(1e9, -1e9, 1e9);
  far.target.world_from_model.rotation = Eigen::AngleAxisd(1.0, Vec3(1, 2, 3).normalized());
  const ProbePath away = path_of("raster:frames=2000", far).value();
  for (std::size_t k = 0; k < home.size(); ++k)
    ASSERT_LT((far.target.world_from_model.inverse() * away.hip_mm[k] - Vec3(1e9, -1e9, 1e9) - home.hip_mm[k])
                  .norm(),
              1e-5);
}

TEST(SeenPaths, RefusedWhereNothingShows) {
  // Faces that look away, and points that make no surface.
  Scan plane = scan_of("plane:points=2500", true);
  EXPECT_NE(path_of("raster:from=-z", plane).error().what.find("no face"), std::string::npos);
  const Scan edge_on = scan_of("plane:points=2500", false);
  EXPECT_FALSE(path_of("raster:from=x", edge_on));
  EXPECT_FALSE(path_of("tap:from=x", edge_on));
  Scan line;
  std::vector<Vec3> points;
  for (int i = 0; i < 100; ++i) points.emplace_back(i, 2 * i, 3 * i);
  line.cloud = *cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  for (const char* name : kSeen) EXPECT_FALSE(path_of(name, line)) << name;
  line.cloud = *cloud::build_cloud(std::vector<Vec3>(1000, Vec3(1, 2, 3)), cloud::NonFinite::kRefuse);
  for (const char* name : kSeen) EXPECT_FALSE(path_of(name, line)) << name;
}

}  // namespace
}  // namespace palpate::trace
