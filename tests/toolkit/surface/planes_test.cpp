// Local planes against formulas, and the side that a surface agrees on: closed, open, thin, sharp, hostile.
#include "toolkit/surface/oriented_points.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include <palpate/generate.h>
#include <palpate/options.h>
#include "toolkit/core/random.h"
#include "toolkit/search/knn.h"

namespace palpate::surface {
namespace {

struct Prepared {
  std::vector<OrientedPoint> points;
  std::vector<search::Neighbours> neighbours;
  OrientReport report;
};

Prepared prepared(const cloud::Cloud& cloud, int threads = 0) {
  Prepared p;
  search::NeighbourTable table = search::exact_knn(cloud, threads);
  search::make_walkable(cloud, table, threads);
  p.neighbours = table.of;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    p.points.push_back({cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i], kNoNormal});
  fit_planes(p.points, p.neighbours, threads);
  p.report = orient_planes(p.points, p.neighbours, threads);
  return p;
}

cloud::GeneratedModel generated(const std::string& spec) {
  return cloud::generate(parse_named_options(spec).value()).value();
}

cloud::Cloud cloud_of(const std::vector<Vec3>& points) {
  return cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
}

TEST(Planes, FollowTheFormulaOfASphere) {
  const auto model = generated("sphere:points=20000");
  const Prepared p = prepared(model.cloud);
  const Vec3 middle = model.surface->box_mm().centre_mm();
  for (std::size_t i = 0; i < p.points.size(); ++i) {
    const Vec3 radial = (p.points[i].at() + model.cloud.origin_mm - middle).normalized();
    ASSERT_GT(decode_normal(p.points[i].normal).dot(radial), 0.99);
  }
}

TEST(Planes, OfPointsOnALineOrAtOnePlaceThereAreNone) {
  std::vector<Vec3> line, pile(40, Vec3(1, 2, 3));
  for (int i = 0; i < 40; ++i) line.emplace_back(0.1 * i, 0.2 * i, -0.3 * i);
  for (const auto& points : {line, pile}) {
    const Prepared p = prepared(cloud_of(points));
    for (const OrientedPoint& point : p.points) EXPECT_EQ(point.normal, kNoNormal);
    EXPECT_EQ(p.report.one_sided_points, 0u);
  }
}

TEST(Planes, ClosedSurfacesPointOutwardAtEveryScale) {
  for (const char* spec : {"sphere:points=8000", "torus:points=20000", "sphere:points=8000:jitter=0.3"})
    for (const double scale : {1e-3, 1.0, 1e6}) {
      SCOPED_TRACE(spec);
      const auto model = generated(spec);
      std::vector<Vec3> points;
      for (std::size_t i = 0; i < model.cloud.size(); ++i)
        points.push_back(scale * (model.cloud.local_mm(i) + model.cloud.origin_mm));
      const cloud::Cloud cloud = cloud_of(points);
      const Prepared p = prepared(cloud);
      EXPECT_EQ(p.report.pieces, 1u);
      EXPECT_EQ(p.report.one_sided_points, p.points.size());
      std::size_t inward = 0;
      for (std::size_t i = 0; i < p.points.size(); ++i) {
        ASSERT_TRUE(is_one_sided(p.points[i].normal));
        const Vec3 at = (p.points[i].at() + cloud.origin_mm) / scale;
        const auto closest = model.surface->closest(at);
        inward += decode_normal(p.points[i].normal).dot(closest.normal) <= 0.0;
      }
      EXPECT_EQ(inward, 0u);
    }
}

TEST(Planes, OpenSurfacesAgreeAndStayTwoSided) {
  for (const char* spec : {"sinusoid:points=10201", "plane:points=2601", "saddle:points=10201:jitter=0.3"}) {
    SCOPED_TRACE(spec);
    const Prepared p = prepared(generated(spec).cloud);
    EXPECT_EQ(p.report.one_sided_points, 0u);
    const double sign = decode_normal(p.points[0].normal).z() > 0.0 ? 1.0 : -1.0;
    for (const OrientedPoint& point : p.points) ASSERT_GT(sign * decode_normal(point.normal).z(), 0.0);
  }
}

// A lens: two caps that meet in a sharp rim, where normals compared directly would agree across the rim.
TEST(Planes, TheSideHoldsAcrossASharpRim) {
  std::vector<Vec3> points;
  const double step = 0.05;
  for (double x = -1.0; x <= 1.0; x += step)
    for (double y = -1.0; y <= 1.0; y += step) {
      const double r2 = x * x + y * y;
      if (r2 > 0.97) continue;
      const double z = 0.6 * (1.0 - r2);
      points.emplace_back(x, y, z);
      points.emplace_back(x, y, -z);
    }
  for (int i = 0; i < 126; ++i) points.emplace_back(std::cos(0.05 * i), std::sin(0.05 * i), 0.0);
  const Prepared p = prepared(cloud_of(points));
  std::size_t wrong = 0, judged = 0;
  for (const OrientedPoint& point : p.points) {
    if (point.normal == kNoNormal) continue;
    const Vec3 at = point.at();
    if (std::abs(at.z()) < 3.0 * step) continue;  // the rim itself, where a point has no one plane
    ++judged;
    wrong += decode_normal(point.normal).z() * at.z() < 0.0;
  }
  EXPECT_GT(judged, 1500u);
  EXPECT_EQ(wrong, 0u);
}

TEST(Planes, TheSameForAnyNumberOfThreads) {
  const auto model = generated("torus:points=40000:jitter=0.45");
  const Prepared one = prepared(model.cloud, 1), all = prepared(model.cloud, 0);
  for (std::size_t i = 0; i < one.points.size(); ++i) ASSERT_EQ(one.points[i].normal, all.points[i].normal);
}

// Points without any order: whatever comes out, it comes out.
TEST(Planes, AVolumeOfNoiseIsSurvived) {
  Random random(5);
  std::vector<Vec3> points;
  for (int i = 0; i < 3000; ++i)
    points.emplace_back(random.uniform(), random.uniform(), 1e-30 * random.uniform());
  for (int i = 0; i < 3000; ++i) points.emplace_back(random.uniform(), random.uniform(), random.uniform());
  for (int i = 0; i < 50; ++i) points.emplace_back(0.5, 0.5, 0.5);
  const Prepared p = prepared(cloud_of(points));
  for (const OrientedPoint& point : p.points)
    if (point.normal != kNoNormal) {
      EXPECT_NEAR(decode_normal(point.normal).norm(), 1.0, 1e-12);
    }
}

}  // namespace
}  // namespace palpate::surface
