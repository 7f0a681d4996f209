// A simulated hand that feels: its path stays at the surface, and goes by what it feels alone.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <palpate/generate.h>
#include <palpate/paths.h>
#include <palpate/read_model.h>
#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"

namespace palpate::paths {
namespace {

constexpr double kFeltNPerMm = 0.5;

/// A sphere's points, and the sphere as what is felt.
class HandOnSphere : public testing::Test {
 protected:
  void SetUp() override {
    target_.cloud = &made_.cloud;
    target_.box_mm = made_.cloud.box_mm();
    target_.stiffness_n_per_mm = kFeltNPerMm;
    target_.felt = [this]() -> Result<ForceFunction> {
      ++asked_;
      return ForceFunction([this](const Vec3& hip_mm) -> Vec3 {
        const Vec3 local = target_.world_from_model.inverse() * hip_mm;
        const double r = local.norm();
        if (r >= radius_ || r == 0.0) return Vec3::Zero();
        return target_.world_from_model.rotate(local / r * (kFeltNPerMm * (radius_ - r)));
      });
    };
  }
  [[nodiscard]] trace::ProbePath path(const std::string& spec) const {
    auto made = make_path(parse_named_options(spec).value(), target_);
    EXPECT_TRUE(made) << (made ? "" : made.error().message());
    return made ? *std::move(made) : trace::ProbePath{};
  }

  cloud::GeneratedModel made_ =
      cloud::generate(parse_named_options("sphere:points=20000:extent_mm=100").value()).value();
  double radius_ = 50.0;
  int asked_ = 0;
  PathTarget target_;
};

TEST_F(HandOnSphere, PressesDragsAndLifts) {
  const trace::ProbePath all = path("hand:frames=40000:force_n=0.6:seed=3");
  ASSERT_EQ(all.size(), 40000u);
  EXPECT_EQ(asked_, 1);
  EXPECT_GT(all.hip_mm.front().norm(), radius_) << "it starts free";
  int touched = 0, entries = 0;
  double deepest = 0.0, highest = 0.0, way = 0.0, fastest = 0.0;
  bool before = false;
  Vec3 low = all.hip_mm.front(), high = low;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double depth = radius_ - all.hip_mm[i].norm();
    touched += depth > 0.0;
    entries += depth > 0.0 && !before;
    before = depth > 0.0;
    deepest = std::max(deepest, depth);
    highest = std::max(highest, -depth);
    low = low.cwiseMin(all.hip_mm[i]);
    high = high.cwiseMax(all.hip_mm[i]);
    if (i == 0) continue;
    const double step = (all.hip_mm[i] - all.hip_mm[i - 1]).norm();
    way += step;
    fastest = std::max(fastest, step * 1000.0);
  }
  EXPECT_GT(touched, 24000) << "a hand mostly touches";
  EXPECT_LT(touched, 39000);
  EXPECT_GT(entries, 10) << "and lifts";
  EXPECT_LT(deepest, 1.3 * 0.6 / kFeltNPerMm) << "never deeper than it presses";
  EXPECT_GT(deepest, 0.7 * 0.6 / kFeltNPerMm);
  EXPECT_LT(highest, 10.0);
  EXPECT_GT(way, 600.0) << "mm in 40 s";
  EXPECT_LE(fastest, 2.5 * 60.0 * (1.0 + 1e-9));
  EXPECT_GT((high - low).minCoeff(), 20.0) << "it gets around";
}

TEST_F(HandOnSphere, AModelThatStandsElsewhereIsTouchedThere) {
  const trace::ProbePath here = path("hand:frames=5000");
  target_.world_from_model.translation_mm = Vec3(300, -20, 7);
  target_.world_from_model.rotation = Eigen::Quaterniond(0.0, 0.0, 1.0, 0.0);
  const trace::ProbePath there = path("hand:frames=5000");
  for (std::size_t i = 0; i < here.size(); i += 100)
    EXPECT_LT((target_.world_from_model * here.hip_mm[i] - there.hip_mm[i]).norm(), 1e-6) << i;
}

TEST_F(HandOnSphere, SlowSamplesAreStillSteppedFinely) {
  const trace::ProbePath slow = path("hand:frames=400:rate_hz=20");
  double deepest = 0.0;
  for (const Vec3& hip : slow.hip_mm) deepest = std::max(deepest, radius_ - hip.norm());
  EXPECT_GT(deepest, 0.5);
  EXPECT_LT(deepest, 1.3 * 0.6 / kFeltNPerMm);
}

TEST_F(HandOnSphere, WhatLosesItsHandIsNotDivedThrough) {
  // It stops to push where the sphere is entered: the hand must not go through to the other side.
  target_.felt = []() -> Result<ForceFunction> {
    return ForceFunction([](const Vec3&) -> Vec3 { return Vec3::Zero(); });
  };
  const trace::ProbePath all = path("hand:frames=20000");
  for (const Vec3& hip : all.hip_mm) EXPECT_GT(hip.norm(), 0.8 * radius_);
}

TEST_F(HandOnSphere, RefusesWhatCannotBe) {
  const auto refusal = [&](const std::string& spec) {
    const auto made = make_path(parse_named_options(spec).value(), target_);
    return made ? std::string("accepted") : made.error().message();
  };
  EXPECT_TRUE(test::contains(refusal("hand:slowest_mm_s=50:fastest_mm_s=20"), "more than"));
  EXPECT_TRUE(test::contains(refusal("hand:force_n=0"), "force_n"));
  target_.felt = []() -> Result<ForceFunction> { return Error{"it cannot be prepared"}; };
  EXPECT_TRUE(test::contains(refusal("hand"), "cannot be prepared"));
  target_.felt = {};
  EXPECT_TRUE(test::contains(refusal("hand"), "nothing is there to be felt"));
}

/// Half a model: the hand stays on the points' own side and comes back from the border.
TEST(HandOnPlane, ComesBackFromTheBorderOfAnOpenScan) {
  const cloud::GeneratedModel made =
      cloud::generate(parse_named_options("plane:points=10000:extent_mm=60").value()).value();
  PathTarget target;
  target.cloud = &made.cloud;
  target.box_mm = made.cloud.box_mm();
  target.stiffness_n_per_mm = kFeltNPerMm;
  const geometry::Aabb box = made.cloud.box_mm();
  target.felt = [&]() -> Result<ForceFunction> {
    return ForceFunction([&](const Vec3& hip) -> Vec3 {
      const bool over = hip.x() >= box.low_mm.x() && hip.x() <= box.high_mm.x() &&
                        hip.y() >= box.low_mm.y() && hip.y() <= box.high_mm.y();
      return over && hip.z() < 0.0 ? Vec3(0.0, 0.0, -kFeltNPerMm * hip.z()) : Vec3(Vec3::Zero());
    });
  };
  const trace::ProbePath all = make_path(parse_named_options("hand:frames=40000").value(), target).value();
  int touched = 0;
  for (const Vec3& hip : all.hip_mm) {
    EXPECT_GT(hip.z(), -8.0);
    EXPECT_LT((hip - box.centre_mm()).norm(), 60.0);
    touched += hip.z() < 0.0;
  }
  EXPECT_GT(touched, 16000);
}

// Paths over models without a formula, checked against the one they were made from: by faces, by points.

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

Result<trace::ProbePath> path_of(const std::string& spec, const Scan& scan) {
  PathTarget target = scan.target;
  target.cloud = &scan.cloud;  // the scan may have been moved
  return make_path(*parse_named_options(spec), target);
}

void check(const std::string& spec, const Scan& scan, double tolerance_mm) {
  const auto path = test::value_of(path_of(spec, scan));
  ASSERT_EQ(path.size(), 12000u);
  EXPECT_GT(scan.distance(path.hip_mm[0]), 0.0) << "starts free";
  double deepest = 0.0, quickest = 0.0;
  std::size_t inside = 0, outside = 0;
  for (std::size_t k = 0; k < path.size(); ++k) {
    ASSERT_TRUE(is_finite(path.hip_mm[k])) << k;
    if (k > 0) quickest = std::max(quickest, (path.hip_mm[k] - path.hip_mm[k - 1]).norm());
    // The formula's distance takes longer than all the rest.
    if (k % 5 != 0 || !scan.is_over(path.hip_mm[k])) continue;
    const double d = scan.distance(path.hip_mm[k]);
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
    const auto path = test::value_of(path_of(std::string("tap:frames=1000:u=0.5:v=0.5:from=") + from, scan));
    const Vec3 eye = Vec3::Unit(from[std::string(from).size() - 1] - 'x') * (from[0] == '-' ? -1.0 : 1.0);
    EXPECT_GT(path.hip_mm[0].normalized().dot(eye), 0.8);
    EXPECT_NEAR(scan.distance(path.hip_mm[0]), 0.4, 0.02);
    EXPECT_NEAR(scan.distance(path.hip_mm[450]), -2.0, 0.02);
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
    const auto path =
        test::value_of(path_of(std::string(name) + ":frames=20000:depth_mm=1:speed_mm_s=100:from=z", scan));
    std::size_t low = 0, high = 0;
    for (const Vec3& p : path.hip_mm) {
      const bool over_gap = std::abs(p.x()) < 2, over_hole = Vec3(p.x() + 15, p.y(), 0).norm() < 4;
      const double lowest = over_gap || over_hole ? -1e-9 : p.x() > 3.5 ? 10 - 1.001 : -1.001;
      ASSERT_GT(p.z(), lowest) << name << " at " << p.transpose();
      low += p.x() < 0 && p.z() < -0.5;
      high += p.x() > 0 && p.z() < 10 - 0.5;
    }
    EXPECT_GT(low, 1000u) << name;
    EXPECT_GT(high, 1000u) << name;
  }
  const auto in_hole = test::value_of(path_of("tap:u=0.25:v=0.5:from=z", scan));
  EXPECT_TRUE(test::contains(in_hole.name, "nearest place that shows"));
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
      const trace::ProbePath one = made(1, "1"), again = made(1, "1"), large = made(0x1p20, "1048576");
      for (std::size_t k = 0; k < one.size(); ++k) {
        ASSERT_EQ(one.hip_mm[k], again.hip_mm[k]) << k;
        ASSERT_EQ(large.hip_mm[k], 0x1p20 * one.hip_mm[k]) << k;
      }
    }
  Scan far = scan_of("sphere:points=10000", false);
  const trace::ProbePath home = path_of("raster:frames=2000", far).value();
  far.cloud.origin_mm += Vec3(1e9, -1e9, 1e9);
  far.target.world_from_model.rotation = Eigen::AngleAxisd(1.0, Vec3(1, 2, 3).normalized());
  const trace::ProbePath away = path_of("raster:frames=2000", far).value();
  for (std::size_t k = 0; k < home.size(); ++k)
    ASSERT_LT((far.target.world_from_model.inverse() * away.hip_mm[k] - Vec3(1e9, -1e9, 1e9) - home.hip_mm[k])
                  .norm(),
              1e-5);
}

TEST(SeenPaths, RefusedWhereNothingShows) {
  // Faces that look away, and points that make no surface.
  Scan plane = scan_of("plane:points=2500", true);
  EXPECT_TRUE(test::contains(path_of("raster:from=-z", plane).error().what, "no face"));
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

// Exploration of a real scan, where $PALPATE_DATA is set: near the points, in and out, from free space.

TEST(ScanPath, ExplorationOfTheBunny) {
  const std::string file = shared_data("stanford/bun_zipper.ply.xz").string();
  if (file.empty()) GTEST_SKIP() << "no bunny in PALPATE_DATA";
  io::Readers readers;
  io::add_standard_readers(readers);
  io::ReadOptions options;
  options.unit = io::Unit::kMetre;
  const auto model = test::value_of(readers.read(file, options));
  PathTarget target;
  target.cloud = &model.cloud;
  target.mesh = model.mesh.get();
  target.box_mm = model.cloud.box_mm();
  const auto path = test::value_of(make_path(*parse_named_options("exploration:frames=10000"), target));

  // The start is beyond every point along some direction; it suffices that it is 0.4 mm from the nearest.
  const auto nearest = [&](const Vec3& p) {
    double best = 1e300;
    std::size_t at = 0;
    for (std::size_t i = 0; i < model.cloud.size(); ++i) {
      const double d = (model.cloud.point_mm(i) - p).squaredNorm();
      if (d < best) {
        best = d;
        at = i;
      }
    }
    return std::pair(std::sqrt(best), at);
  };
  EXPECT_NEAR(nearest(path.hip_mm[0]).first, 0.4, 1e-4);
  // Outside and inside by the normals of the scan's own mesh.
  std::vector<Vec3> normals(model.cloud.size(), Vec3::Zero());
  for (const auto& t : model.mesh->triangles) {
    const Vec3& a = model.mesh->vertices_mm[t[0]];
    const Vec3 ab = model.mesh->vertices_mm[t[1]] - a, ac = model.mesh->vertices_mm[t[2]] - a;
    for (const std::uint32_t v : t) normals[v] += ab.cross(ac);
  }
  std::size_t inside = 0, outside = 0;
  geometry::Aabb visited;
  for (std::size_t k = 0; k < path.size(); k += 25) {
    const auto [distance, at] = nearest(path.hip_mm[k]);
    ASSERT_LT(distance, 3.5) << "frame " << k;
    ((path.hip_mm[k] - model.cloud.point_mm(at)).dot(normals[at]) < 0 ? inside : outside)++;
    visited.add(path.hip_mm[k]);
  }
  EXPECT_GT(inside, 150u);
  EXPECT_GT(outside, 50u);
  EXPECT_GT(visited.extent_mm().norm(), 30);
}

}  // namespace
}  // namespace palpate::paths
