// Surfaces known by formula, against hand-computed answers and dense brute force.
#include <gtest/gtest.h>
#include <Eigen/Geometry>  // cross products

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::geometry {
namespace {

constexpr std::uint64_t kSeed = 20260101;

struct Shape {
  std::string name;
  std::function<std::shared_ptr<const AnalyticSurface>(double scale)> make;
  bool smooth = true;
  bool open = true;
};

std::vector<Shape> shapes() {
  return {
      {"plane", [](double s) { return make_plane(100 * s); }},
      {"sinusoid", [](double s) { return make_sinusoid(10 * s, 50 * s, 100 * s); }},
      {"steep sinusoid", [](double s) { return make_sinusoid(10 * s, 10 * s, 30 * s); }},
      {"saddle", [](double s) { return make_saddle(0.05 / s, 100 * s); }},
      {"ridge", [](double s) { return make_wedge(70, 100 * s); }, false},
      {"valley", [](double s) { return make_wedge(300, 100 * s); }, false},
      {"sphere", [](double s) { return make_sphere(25 * s); }, true, false},
      {"torus", [](double s) { return make_torus(37 * s, 13 * s); }, true, false},
      {"slab", [](double s) { return make_slab(50 * s, 1 * s); }, false, false},
      {"ellipsoid", [](double s) { return make_ellipsoid(s * Vec3(30, 18, 22)); }, true, false},
      {"rounded box", [](double s) { return make_rounded_box(s * Vec3(40, 20, 30), 3 * s); }, true, false},
      {"shells", [](double s) { return make_shells(25 * s, 0.6 * s); }, true, false},
  };
}

Vec3 random_point(Random& random, double half) {
  return {random.uniform(-half, half), random.uniform(-half, half), random.uniform(-half, half)};
}

/// Points all over a shape and so many of its sides beyond it, denser than any tolerance used with them.
std::vector<Vec3> dense_samples(const AnalyticSurface& surface, int side, double beyond) {
  const auto at = [&](int i) { return static_cast<double>(i) / side * (1 + 2 * beyond) - beyond; };
  std::vector<Vec3> samples;
  for (int i = 0; i <= side; ++i)
    for (int j = 0; j <= side; ++j) samples.push_back(surface.at(at(i), at(j)).point_mm);
  return samples;
}

double nearest_of(const std::vector<Vec3>& samples, const Vec3& p) {
  double best = std::numeric_limits<double>::infinity();
  for (const Vec3& q : samples) best = std::min(best, (q - p).norm());
  return best;
}

TEST(Analytic, MakersRefuseWhatIsNoShape) {
  const double nan = std::nan("");
  const std::shared_ptr<const AnalyticSurface> none[] = {
      make_plane(0),
      make_plane(nan),
      make_sinusoid(10, 1, 100),  // a slope of 63
      make_sinusoid(-1, 50, 100),
      make_saddle(0, 1),
      make_wedge(5, 1),
      make_relief(1, 1, 2, 0.3, 1),
      make_relief(1, nan, 0.1, 0.3, 1),
      make_sphere(nan),
      make_torus(1, 2),
      make_slab(1, 0),
      make_pebble(0, 1, 0.2, 1),
      make_pebble(10, 20, 0.2, 1),
      make_pebble(10, 1, 2, 1),
      make_pebble(nan, 1, 0.2, 1),
      make_ellipsoid({1, 0, 1}),
      make_ellipsoid({1, 1, nan}),
      make_rounded_box({10, 3, 10}, 1.6),  // the edges meet
      make_rounded_box({10, 3, 10}, 0),
      make_bowl(1, 0.5, Felt::kInside),
      make_bowl(1, 179.5, Felt::kInside),
      make_bowl(nan, 90, Felt::kInside),
      make_shells(1, 1),
      make_shells(1, -0.1)};
  for (const auto& shape : none) EXPECT_EQ(shape, nullptr) << &shape - none;
  EXPECT_NE(make_rounded_box({10, 3, 10}, 1.5), nullptr);
}

TEST(Analytic, KnownPoints) {
  const auto sinusoid = make_sinusoid(10, 50, 100);
  EXPECT_DOUBLE_EQ(sinusoid->at(0.5, 0.5).point_mm.z(), 20.0);
  EXPECT_NEAR(sinusoid->at(0.75, 0.75).point_mm.z(), -20.0, 1e-13);
  EXPECT_EQ(sinusoid->box_mm().high_mm, Vec3(50, 50, 20));
  EXPECT_EQ(sinusoid->box_mm().low_mm, Vec3(-50, -50, -20));
  // Above a crest within its radius of curvature the crest is closest.
  EXPECT_NEAR((sinusoid->closest({0, 0, 30}).point_mm - Vec3(0, 0, 20)).norm(), 0.0, 1e-9);
  EXPECT_NEAR(sinusoid->signed_distance_mm({0, 0, 30}), 10.0, 1e-9);
  EXPECT_NEAR(sinusoid->signed_distance_mm({0, 0, 18}), -2.0, 1e-9);
  EXPECT_DOUBLE_EQ(make_sphere(2)->signed_distance_mm({0, 0, 5}), 3.0);
  EXPECT_DOUBLE_EQ(make_torus(4, 1)->signed_distance_mm({4, 0, 0}), -1.0);
  EXPECT_DOUBLE_EQ(make_torus(4, 1)->signed_distance_mm({0, 0, 0}), 3.0);
  EXPECT_DOUBLE_EQ(make_slab(10, 1)->signed_distance_mm({8, 9, 0}), 5.0);
  EXPECT_DOUBLE_EQ(make_slab(10, 1)->signed_distance_mm({1, 1, 0.3}), -0.2);
  // A right-angled ridge: z = -|x|.
  const auto ridge = make_wedge(90, 10);
  EXPECT_NEAR(ridge->signed_distance_mm({0, 3, 2}), 2.0, 1e-14);
  EXPECT_NEAR(ridge->signed_distance_mm({0, 3, -2}), -std::sqrt(2.0), 1e-14);
  EXPECT_NEAR(ridge->at(0.7, 0.5).point_mm.z(), -2.0, 1e-14);
  const auto valley = make_wedge(270, 10);
  EXPECT_NEAR(valley->at(0.7, 0.5).point_mm.z(), 2.0, 1e-14);
  EXPECT_NEAR(valley->signed_distance_mm({0, 3, -2}), -2.0, 1e-14);
  EXPECT_NEAR(valley->signed_distance_mm({0, 3, 2}), std::sqrt(2.0), 1e-14);
}

TEST(Analytic, AReliefHasItsSlopeItsNormalsAndItsClosestPoints) {
  for (const double scale : {1e-3, 1.0, 1e6}) {
    const auto relief = make_relief(20 * scale, 10 * scale, 2 * scale, 0.3, 5);
    const int side = 400;
    double slope_sq = 0.0;
    std::vector<Vec3> samples;
    for (int i = 0; i <= side; ++i)
      for (int j = 0; j <= side; ++j) {
        const SurfacePoint p = relief->at(static_cast<double>(i) / side, static_cast<double>(j) / side);
        slope_sq += 1.0 / (p.normal.z() * p.normal.z()) - 1.0;
        samples.push_back(p.point_mm);
        ASSERT_TRUE(relief->box_mm().grown(1e-9 * scale).contains(p.point_mm));
      }
    EXPECT_NEAR(std::sqrt(slope_sq / static_cast<double>(samples.size())), 0.3, 0.1);
    const SurfacePoint a = relief->at(0.4, 0.6);
    const double h = 1e-6;
    EXPECT_NEAR(a.normal.dot(relief->at(0.4 + h, 0.6).point_mm - a.point_mm), 0.0, 1e-4 * h * 20 * scale);
    EXPECT_NEAR(a.normal.dot(relief->at(0.4, 0.6 + h).point_mm - a.point_mm), 0.0, 1e-4 * h * 20 * scale);
    Random random(kSeed);
    for (int n = 0; n < 50; ++n) {
      const SurfacePoint at = relief->at(random.uniform(0.3, 0.7), random.uniform(0.3, 0.7));
      const Vec3 p = at.point_mm + random.uniform(-2.0, 2.0) * scale * at.normal;
      const double best = nearest_of(samples, p);
      const double found = (relief->closest(p).point_mm - p).norm();
      EXPECT_LE(found, best + 1e-9 * scale);
      EXPECT_GE(found, best - 0.05 * scale);
    }
  }
}

TEST(Analytic, ClosestAgainstBruteForce) {
  for (const Shape& shape : shapes()) {
    Random random(kSeed);
    const auto surface = shape.make(1.0);
    if (shape.name == "slab" || shape.name == "shells") continue;  // at() covers one face; see below
    const int side = 900;
    // An open surface goes on beyond its square.
    const std::vector<Vec3> samples = dense_samples(*surface, side, shape.open ? 1.0 : 0.0);
    // Twice the widest gap of the samples along the surface.
    const double gap = surface->box_mm().extent_mm().norm() * 3 / side * 8;
    for (int n = 0; n < 40; ++n) {
      const Vec3 p = random_point(random, 0.55 * surface->box_mm().extent_mm().maxCoeff());
      const double best = nearest_of(samples, p);
      const SurfacePoint found = surface->closest(p);
      const double distance = (found.point_mm - p).norm();
      SCOPED_TRACE(shape.name + ", seed 20260101, query " + std::to_string(n));
      EXPECT_LE(distance, best * (1 + 1e-12));
      EXPECT_GE(distance, best - gap);
      EXPECT_NEAR(std::abs(surface->signed_distance_mm(p)), distance, 1e-12 * 100);
      EXPECT_NEAR(surface->signed_distance_mm(found.point_mm), 0.0, 1e-11);
    }
  }
}

TEST(Analytic, ClosestIsPerpendicularAtEveryScale) {
  for (const double scale : {1e-3, 1.0, 1e6})
    for (const Shape& shape : shapes()) {
      if (!shape.smooth) continue;
      Random random(kSeed);
      const auto surface = shape.make(scale);
      for (int n = 0; n < 100; ++n) {
        const Vec3 p = random_point(random, 40 * scale);
        const SurfacePoint g = surface->closest(p);
        const Vec3 offset = p - g.point_mm;
        // The position is exact to some ulps of the coordinates, which at a small distance is all there is.
        const double tolerance = 1e-9 * offset.norm() + 1e-14 * 100 * scale;
        SCOPED_TRACE(shape.name + " scale " + std::to_string(scale) + " query " + std::to_string(n));
        EXPECT_LE((offset - offset.dot(g.normal) * g.normal).norm(), tolerance);
        EXPECT_NEAR(g.normal.norm(), 1.0, 1e-14);
      }
    }
}

TEST(Analytic, SaddleClosestInItsPlanesOfSymmetry) {
  // High above the saddle's valley line the two points at +-x are closest; below, those at +-y.
  const auto saddle = make_saddle(0.05, 100);
  const std::vector<Vec3> samples = dense_samples(*saddle, 1500, 1.0);
  for (const Vec3& p :
       {Vec3(0, 0, 45), Vec3(0, 0, -45), Vec3(0, 5, 45), Vec3(5, 0, -45), Vec3(0, 5, -45), Vec3(5, 0, 45)}) {
    const double found = (saddle->closest(p).point_mm - p).norm(), best = nearest_of(samples, p);
    EXPECT_LE(found, best + 1e-12) << p.transpose();
    EXPECT_GE(found, best - 0.5) << p.transpose();
  }
}

TEST(Analytic, TrackFollowsAndConverges) {
  for (const double scale : {1e-3, 1.0, 1e6})
    for (const Shape& shape : shapes()) {
      if (!shape.smooth || shape.name == "steep sinusoid") continue;
      const auto surface = shape.make(scale);
      SurfacePoint g = surface->at(0.2, 0.3);
      for (int k = 1; k <= 400; ++k) {
        const double s = k / 400.0;
        const SurfacePoint above = surface->at(0.2 + 0.3 * s, 0.3 + 0.2 * s);
        const Vec3 hip = above.point_mm - 2 * scale * s * above.normal;
        g = surface->track(g, hip);
        SCOPED_TRACE(shape.name + " scale " + std::to_string(scale) + " step " + std::to_string(k));
        // Shallower than every radius of curvature here, so the foot of the normal is the local minimum.
        ASSERT_LE((g.point_mm - above.point_mm).norm(), 1e-9 * scale);
        const Vec3 offset = g.point_mm - hip;
        ASSERT_LE((offset - offset.dot(g.normal) * g.normal).norm(), 1e-9 * offset.norm() + 1e-12 * scale);
      }
    }
}

TEST(Analytic, TrackStaysOnTheEntrySheetOfTheSlab) {
  const auto slab = make_slab(50, 1);
  SurfacePoint g = slab->first_entry({3, 4, 2}, {3, 4, 0.4}).value();
  EXPECT_EQ(g.point_mm, Vec3(3, 4, 0.5));
  for (int k = 0; k < 1000; ++k) {
    const Vec3 hip(3 + 0.01 * k, 4, 0.4 - 0.02 * k);  // to 19 mm below the other side
    g = slab->track(g, hip);
    ASSERT_EQ(g.point_mm, Vec3(hip.x(), 4, 0.5));
    ASSERT_EQ(g.normal, Vec3(0, 0, 1));
  }
  // Beyond its side it slides over the edge, down the side face: the HIP is outside there.
  g = slab->track(g, {26, 4, 0.2});
  EXPECT_EQ(g.point_mm, Vec3(25, 4, 0.2));
  EXPECT_EQ(g.normal, Vec3(1, 0, 0));
}

TEST(Analytic, TrackOnTheRidgePassesTheMiddleAndOnlyThenTheEdge) {
  const auto ridge = make_wedge(90, 100);
  SurfacePoint g = ridge->first_entry({-3, 0, 5}, {-3, 0, -4}).value();
  EXPECT_NEAR((g.point_mm - Vec3(-3, 0, -3)).norm(), 0, 1e-14);
  // Across the middle plane the left face is no longer nearest, and still the sheet it is held by.
  g = ridge->track(g, {0.5, 0, -2});
  EXPECT_NEAR((g.point_mm - Vec3(-0.75, 0, -0.75)).norm(), 0, 1e-14);
  // With the foot beyond the edge it goes over to the other face; that needs a blunt ridge.
  const auto blunt = make_wedge(120, 100);
  g = blunt->first_entry({-3, 0, 5}, {-3, 0, -4}).value();
  g = blunt->track(g, {2, 0, -1.5});
  const double along = 2 * std::sqrt(0.75) + 1.5 * 0.5;
  EXPECT_NEAR((g.point_mm - Vec3(along * std::sqrt(0.75), 0, -along * 0.5)).norm(), 0, 1e-14);
}

TEST(Analytic, TrackInTheValleyRestsOnTheEdge) {
  const auto valley = make_wedge(270, 100);
  SurfacePoint g = valley->first_entry({-1, 0, 3}, {-1, 0, 0}).value();
  g = valley->track(g, {0.1, 2, -1});
  EXPECT_NEAR((g.point_mm - Vec3(0, 2, 0)).norm(), 0, 1e-14);
  EXPECT_GT((g.point_mm - Vec3(0.1, 2, -1)).dot(g.normal), 0) << "still inside";
}

TEST(Analytic, TrackLeavesACrestThatIsNoMinimum) {
  // Ten below the crest, deeper than its radius of curvature, 6.33: the crest is a maximum of the distance.
  const auto sinusoid = make_sinusoid(10, 50, 100);
  const Vec3 hip(0, 0, 10);
  const SurfacePoint g = sinusoid->track({{0, 0, 20}, Vec3::UnitZ()}, hip);
  EXPECT_LT((g.point_mm - hip).norm(), 9.5);
}

TEST(Analytic, FirstEntryAgainstFineSampling) {
  for (const double scale : {1e-3, 1.0, 1e6})
    for (const Shape& shape : shapes()) {
      Random random(kSeed);
      const auto surface = shape.make(scale);
      int entries = 0;
      for (int n = 0; n < 60; ++n) {
        const Vec3 a = random_point(random, 60 * scale), b = random_point(random, 60 * scale);
        constexpr int kSamples = 4000;
        double expected = -1;
        bool inside = surface->signed_distance_mm(a) < 0;
        const bool use_all = shape.name.find("sinusoid") == std::string::npos;
        for (int i = 1; i <= kSamples && expected < 0; ++i) {
          const Vec3 p = a + (b - a) * (static_cast<double>(i) / kSamples);
          // The sinusoid's distance is costly; its sign is that of the height over it.
          const double d = use_all ? surface->signed_distance_mm(p)
                                   : p.z() - surface
                                                 ->at(p.x() / surface->box_mm().extent_mm().x() + 0.5,
                                                      p.y() / surface->box_mm().extent_mm().y() + 0.5)
                                                 .point_mm.z();
          if (!use_all && i == 1) inside = d < 0;
          if (d < 0 && !inside) expected = static_cast<double>(i) / kSamples;
          inside = d < 0;
        }
        const auto found = surface->first_entry(a, b);
        SCOPED_TRACE(shape.name + " scale " + std::to_string(scale) + " segment " + std::to_string(n));
        if (expected < 0 && found) {  // a dip between two samples
          EXPECT_LT(std::abs(surface->signed_distance_mm(found->point_mm)), 1e-9 * scale);
          continue;
        }
        ASSERT_EQ(found.has_value(), expected >= 0);
        if (!found) continue;
        ++entries;
        const double t = (found->point_mm - a).dot(b - a) / (b - a).squaredNorm();
        EXPECT_LE(t, expected + 1e-9);
        EXPECT_LT((a + t * (b - a) - found->point_mm).norm(), 1e-9 * scale) << "on the segment";
        EXPECT_LT(found->normal.dot(b - a), 1e-6 * (b - a).norm()) << "going in";
        if (t < expected - 1.5 / kSamples) {  // a dip between samples before the first one seen
          EXPECT_LT(std::abs(surface->signed_distance_mm(found->point_mm)), 1e-9 * scale);
        }
      }
      EXPECT_GT(entries, 5) << shape.name;
    }
}

TEST(Analytic, TheThinnestSlabIsNeverTunnelled) {
  const auto slab = make_slab(50, 1e-9);
  Random random(kSeed);
  for (int n = 0; n < 2000; ++n) {
    const Vec3 a(random.uniform(-20, 20), random.uniform(-20, 20), random.uniform(1e-3, 1e6));
    const Vec3 b(random.uniform(-20, 20), random.uniform(-20, 20), -random.uniform(1e-3, 1e6));
    const auto found = slab->first_entry(a, b);
    ASSERT_TRUE(found) << n;
    EXPECT_EQ(found->point_mm.z(), 5e-10);
  }
}

TEST(Analytic, EntryFromTheSurfaceItself) {
  for (const Shape& shape : shapes()) {
    const auto surface = shape.make(1.0);
    const SurfacePoint s = surface->at(0.31, 0.27);
    EXPECT_TRUE(surface->first_entry(s.point_mm, s.point_mm - 0.01 * s.normal)) << shape.name;
    EXPECT_FALSE(surface->first_entry(s.point_mm, s.point_mm + 0.01 * s.normal)) << shape.name;
    EXPECT_FALSE(surface->first_entry(s.point_mm - 0.01 * s.normal, s.point_mm - 0.02 * s.normal))
        << shape.name;
    EXPECT_FALSE(surface->first_entry(s.point_mm - 0.01 * s.normal, s.point_mm + 0.01 * s.normal))
        << shape.name;
    EXPECT_FALSE(surface->first_entry(s.point_mm + s.normal, s.point_mm + s.normal)) << shape.name;
  }
}

TEST(Analytic, GrazingARowOfCrestsFindsNone) {
  const auto sinusoid = make_sinusoid(10, 50, 100);
  EXPECT_FALSE(sinusoid->first_entry({-500, 0, 20.0001}, {500, 0, 20.0001}));
  const auto found = sinusoid->first_entry({-20, 0, 19.9999}, {500, 0, 19.9999});
  ASSERT_TRUE(found);
  // 10 (1 - cos w x) = 1e-4 at x = 0.03559.
  EXPECT_NEAR(found->point_mm.x(), -std::acos(1 - 1e-5) * 25 / std::numbers::pi, 1e-9);
}

// A HIP fast over fine relief goes over thousands of waves in a frame: the entry is that of short segments.
TEST(Analytic, FindsTheEntryThousandsOfWavesOn) {
  const auto relief = make_relief(200.0, 200.0, 0.05, 0.3, 5);
  const double top = relief->box_mm().high_mm.z();
  int found_any = 0;
  for (double down = 0.1; down < 0.7; down += 0.02) {
    const Vec3 a(-95, 3, down * top), b(95, 4, down * top);
    std::optional<SurfacePoint> pieces;
    constexpr int kPieces = 2000;
    for (int k = 0; k < kPieces && !pieces; ++k)
      pieces = relief->first_entry(a + (b - a) * (static_cast<double>(k) / kPieces),
                                   a + (b - a) * (static_cast<double>(k + 1) / kPieces));
    const auto whole = relief->first_entry(a, b);
    ASSERT_EQ(whole.has_value(), pieces.has_value()) << down;
    if (!whole) continue;
    ++found_any;
    EXPECT_LT((whole->point_mm - pieces->point_mm).norm(), 1e-6) << down;
  }
  EXPECT_GT(found_any, 3);
}

// The detailed closed surface against its own definition and a dense sampling.

class PebbleAt : public testing::TestWithParam<double> {
 protected:
  double scale() const { return GetParam(); }
  std::shared_ptr<const AnalyticSurface> pebble() const {
    return make_pebble(20 * scale(), 3 * scale(), 0.2, 5);
  }
};

Vec3 direction(Random& random) {
  return Vec3(random.normal(), random.normal(), random.normal()).normalized();
}

TEST_P(PebbleAt, NormalsAreThoseOfTheSurface) {
  const auto surface = pebble();
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    const double u = random.uniform(0.05, 0.95), v = random.uniform(0.05, 0.95), e = 1e-5;
    const Vec3 across = surface->at(u + e, v).point_mm - surface->at(u - e, v).point_mm;
    const Vec3 along = surface->at(u, v + e).point_mm - surface->at(u, v - e).point_mm;
    const SurfacePoint here = surface->at(u, v);
    EXPECT_NEAR(here.normal.norm(), 1.0, 1e-12);
    EXPECT_LT(std::abs(here.normal.dot(across.normalized())), 1e-5);
    EXPECT_LT(std::abs(here.normal.dot(along.normalized())), 1e-5);
    EXPECT_GT(here.normal.dot(here.point_mm), 0.0);
  }
}

TEST_P(PebbleAt, ClosestIsTheClosestOfADenseSampling) {
  const auto surface = pebble();
  Random random(2);
  for (int i = 0; i < 5; ++i) {
    const SurfacePoint near = surface->at(random.uniform(), random.uniform(0.2, 0.8));
    const double height = random.uniform(-0.8, 0.8) * scale();
    const Vec3 p = near.point_mm + height * near.normal;
    const SurfacePoint found = surface->closest(p);
    EXPECT_LT((p - found.point_mm).cross(found.normal).norm(), 1e-6 * scale()) << "square to the surface";
    EXPECT_EQ(surface->signed_distance_mm(p) > 0.0, height > 0.0);
    double best = std::numeric_limits<double>::infinity();
    for (int a = 0; a < 300; ++a)
      for (int b = 0; b < 150; ++b)
        best = std::min(best, (surface->at(a / 300.0, (b + 0.5) / 150.0).point_mm - p).norm());
    EXPECT_LE((p - found.point_mm).norm(), best + 1e-9 * scale()) << i;
  }
}

TEST_P(PebbleAt, EntriesAreTheFirstOnes) {
  const auto surface = pebble();
  Random random(3);
  int entered = 0;
  for (int i = 0; i < 60; ++i) {
    const Vec3 a = direction(random) * (26 * scale());
    const Vec3 b = a + (direction(random) * (10 * scale()) - a) * 0.6;
    const auto entry = surface->first_entry(a, b);
    // By small steps: outside at a, the first place inside.
    double t = 0.0;
    while (t <= 1.0 && surface->signed_distance_mm(a + t * (b - a)) >= 0.0) t += 1e-3;
    ASSERT_EQ(entry.has_value(), t <= 1.0) << i;
    if (!entry) continue;
    ++entered;
    EXPECT_LT((entry->point_mm - (a + t * (b - a))).norm(), 3e-3 * (b - a).norm());
    EXPECT_NEAR(surface->signed_distance_mm(entry->point_mm), 0.0, 1e-9 * scale());
  }
  EXPECT_GT(entered, 20);
}

INSTANTIATE_TEST_SUITE_P(Scales, PebbleAt, testing::Values(1e-3, 1.0, 1e5));

}  // namespace
}  // namespace palpate::geometry
