// Round and nested bodies, open sheets, and the ways of sampling: exactness, spacing, determinism, refusals.
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <string>
#include <vector>

#include "tests/toolkit/cloud/made.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/cloud/rings.h"

namespace palpate::cloud {
namespace {

const char* const kRound[] = {"ellipsoid", "rounded-box", "bowl", "bowl:rim_deg=150:felt=outside",
                              "shells:gap_mm=2"};
const char* const kAllSamplings[] = {
    "sinusoid",    "plane",  "saddle",         "relief:finest_mm=8",  "wedge:angle_deg=70",
    "sphere",      "pebble", "torus",          "slab:thickness_mm=5", "ellipsoid",
    "rounded-box", "bowl",   "shells:gap_mm=2"};

/// Distance to the nearest other point, by brute force over the points nearest in x; where it is above the
/// reach it is not told.
std::vector<double> nearest_distances(const Cloud& cloud, double reach_mm) {
  std::vector<std::uint32_t> by_x(cloud.size());
  for (std::uint32_t i = 0; i < by_x.size(); ++i) by_x[i] = i;
  std::sort(by_x.begin(), by_x.end(), [&](auto a, auto b) { return cloud.x_mm[a] < cloud.x_mm[b]; });
  std::vector<double> found(cloud.size(), reach_mm);
  for (std::size_t i = 0; i < by_x.size(); ++i)
    for (std::size_t j = i + 1; j < by_x.size(); ++j) {
      const Vec3 way = cloud.local_mm(by_x[j]) - cloud.local_mm(by_x[i]);
      if (way.x() > reach_mm) break;
      found[by_x[i]] = std::min(found[by_x[i]], way.norm());
      found[by_x[j]] = std::min(found[by_x[j]], way.norm());
    }
  return found;
}

double mean(const std::vector<double>& x) {
  double sum = 0.0;
  for (const double v : x) sum += v;
  return sum / static_cast<double>(x.size());
}

TEST(Round, PointsLieOnTheSurfaceAndMeshesFaceOutward) {
  for (const char* scale : {"0.001", "1", "1000000"})
    for (const char* name : kRound)
      for (const char* how : {"", ":jitter=0.2", ":jitter=0.2:nonuniform=0.5", ":shuffle"}) {
        const std::string text = std::string(name) + how + ":points=2000:scale=" + scale;
        const GeneratedModel model = made(text);
        EXPECT_NEAR(static_cast<double>(model.cloud.size()), 2000, 300) << text;
        EXPECT_FALSE(model.cloud.raster);
        const double size = model.surface->box_mm().extent_mm().norm();
        ASSERT_NE(model.original_mesh, nullptr) << text;
        const auto& mesh = *model.original_mesh;
        for (std::size_t i = 0; i < model.cloud.size(); ++i) {
          ASSERT_NEAR(model.surface->signed_distance_mm(model.cloud.point_mm(i)), 0.0, 5e-7 * size) << text;
          ASSERT_LT((mesh.vertices_mm[i] - model.cloud.point_mm(i)).norm(), 1e-7 * size) << text;
          ASSERT_NEAR(model.surface->signed_distance_mm(mesh.vertices_mm[i]), 0.0, 1e-13 * size) << text;
        }
        std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
        std::size_t open = 0;
        for (const auto& t : mesh.triangles) {
          for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
          const Vec3 &a = mesh.vertices_mm[t[0]], &b = mesh.vertices_mm[t[1]], &c = mesh.vertices_mm[t[2]];
          ASSERT_GT((b - a).cross(c - a).dot(model.surface->closest((a + b + c) / 3).normal), 0.0) << text;
        }
        for (const auto& [edge, count] : edges) {
          ASSERT_EQ(count, 1) << text;
          open += edges.count({edge.second, edge.first}) == 0;
        }
        const bool sheet = text.substr(0, 4) == "bowl";
        EXPECT_EQ(open > 0, sheet) << text;
        const long euler = static_cast<long>(mesh.vertices_mm.size()) -
                           static_cast<long>((edges.size() + open) / 2) +
                           static_cast<long>(mesh.triangles.size());
        EXPECT_EQ(euler, sheet ? 1 : text.substr(0, 6) == "shells" ? 4 : 2) << text;
      }
}

TEST(Round, RingsAreNumberedOnce) {
  const Rings rings(10, 2.0, 0.7);
  std::size_t next = 0;
  for (std::uint32_t ring = 0; ring <= rings.rings(); ++ring)
    for (std::uint32_t spoke = 0;; ++spoke, ++next) {
      const Rings::Place at = rings.place(next);
      if (at.ring != ring) break;
      ASSERT_EQ(at.spoke, spoke);
      if (next + 1 == rings.size()) {
        ++next;
        break;
      }
    }
  EXPECT_EQ(next, rings.size());
}

TEST(Sampling, EveryWayLiesOnTheSurface) {
  for (const char* scale : {"0.001", "1", "1000000"})
    for (const char* name : kAllSamplings)
      for (const char* how : {"random", "blue", "lines"}) {
        // One way a scale: each makes a table of the surface's areas.
        const bool its_own = how == std::string(scale[0] == '0'   ? "random"
                                                : scale[1] == '0' ? "lines"
                                                                  : "blue");
        if (!its_own) continue;
        const std::string text =
            std::string(name) + ":points=1500:sampling=" + how + ":seed=3:scale=" + scale;
        const GeneratedModel model = made(text);
        EXPECT_EQ(model.original_mesh, nullptr);
        EXPECT_FALSE(model.cloud.raster);
        const bool lines = std::string(how) == "lines";
        EXPECT_NEAR(static_cast<double>(model.cloud.size()), 1500, lines ? 400 : 0) << text;
        const double size = model.surface->box_mm().extent_mm().norm();
        for (std::size_t i = 0; i < model.cloud.size(); i += 3)
          ASSERT_NEAR(model.surface->signed_distance_mm(model.cloud.point_mm(i)), 0.0, 5e-7 * size) << text;
        const geometry::Aabb whole = model.surface->box_mm().grown(1e-6 * size);
        EXPECT_TRUE(whole.contains(model.cloud.box_mm().low_mm) &&
                    whole.contains(model.cloud.box_mm().high_mm))
            << text;
      }
}

TEST(Sampling, RandomIsEvenByArea) {
  // Of a sphere every zone of equal height has equal area (Archimedes); of a torus the outer half has more.
  const int n = 40000, zones = 20;
  const Cloud sphere = made("sphere:points=40000:sampling=random").cloud;
  std::vector<int> count(zones);
  for (std::size_t i = 0; i < sphere.size(); ++i)
    ++count[static_cast<std::size_t>(
        std::clamp((sphere.point_mm(i).z() / 50 + 0.5) * zones, 0.0, zones - 1.0))];
  // Five standard deviations of a binomial count.
  for (const int c : count) EXPECT_NEAR(c, n / zones, 5 * std::sqrt(n / zones));
  const Cloud torus = made("torus:points=40000:tube=0.5:sampling=random").cloud;
  const double major = 50 / 1.5;
  int outer = 0;
  for (std::size_t i = 0; i < torus.size(); ++i) {
    const Vec3 p = torus.point_mm(i);
    outer += std::hypot(p.x(), p.y()) > major;
  }
  EXPECT_NEAR(outer, n * (0.5 + 0.5 / std::numbers::pi), 5 * std::sqrt(n / 4.0));
  // Nearest neighbours of random points: half of the root of area over points (Clark and Evans 1954).
  const GeneratedModel plane = made("plane:points=20000:sampling=random");
  EXPECT_NEAR(plane.nominal_spacing_mm, 100 / std::sqrt(20000.0), 1e-9);
  EXPECT_NEAR(mean(nearest_distances(plane.cloud, 4 * plane.nominal_spacing_mm)) / plane.nominal_spacing_mm,
              0.5, 0.01);
}

TEST(Sampling, BlueNoiseKeepsItsDistance) {
  for (const char* name : {"plane", "torus", "rounded-box", "sinusoid"}) {
    const GeneratedModel model = made(std::string(name) + ":points=20000:sampling=blue");
    const std::vector<double> nearest = nearest_distances(model.cloud, 4 * model.nominal_spacing_mm);
    EXPECT_GT(*std::min_element(nearest.begin(), nearest.end()), 0.65 * model.nominal_spacing_mm) << name;
    EXPECT_LT(mean(nearest), 0.9 * model.nominal_spacing_mm) << name;
  }
  // The sheets of a thin wall do not keep apart.
  const GeneratedModel shells = made("shells:points=20000:gap_mm=0.1:sampling=blue");
  EXPECT_EQ(shells.cloud.size(), 20000u);
  const std::vector<double> across = nearest_distances(shells.cloud, 4 * shells.nominal_spacing_mm);
  EXPECT_LT(*std::min_element(across.begin(), across.end()), 0.5 * shells.nominal_spacing_mm);
  const auto outer = std::count_if(shells.cloud.x_mm.begin(), shells.cloud.x_mm.end(), [&](const float& x) {
    return shells.cloud.local_mm(static_cast<std::size_t>(&x - shells.cloud.x_mm.data())).norm() > 19.95;
  });
  EXPECT_NEAR(static_cast<double>(outer), 10000, 500);
}

TEST(Sampling, LinesHaveTheirRatio) {
  for (const double ratio : {1.0, 8.0, 30.0}) {
    const GeneratedModel model = made("plane:points=20000:sampling=lines:ratio=" + std::to_string(ratio));
    std::map<float, std::vector<float>> lines;
    for (std::size_t i = 0; i < model.cloud.size(); ++i)
      lines[model.cloud.y_mm[i]].push_back(model.cloud.x_mm[i]);
    const double across = 100.0 / static_cast<double>(lines.size());
    const double along = 100.0 / static_cast<double>(lines.begin()->second.size());
    EXPECT_NEAR(across / along, ratio, 0.03 * ratio);
    EXPECT_NEAR(across * along, model.nominal_spacing_mm * model.nominal_spacing_mm, 0.02 * across * along);
  }
}

TEST(Sampling, ADensityStepHasItsRatio) {
  for (const char* how : {"random", "blue"}) {
    const Cloud cloud = made(std::string("plane:points=34000:density=16:sampling=") + how).cloud;
    const auto dense = std::count_if(cloud.x_mm.begin(), cloud.x_mm.end(), [](float x) { return x > 0; });
    EXPECT_NEAR(static_cast<double>(dense) / static_cast<double>(cloud.size()), 16.0 / 17.0, 0.01) << how;
  }
}

TEST(Sampling, NoiseIsNormalAndAlongTheNormal) {
  for (const char* how : {"", ":sampling=blue"})
    for (const char* name : {"plane", "sphere", "sinusoid", "ellipsoid"}) {
      const GeneratedModel model = made(std::string(name) + ":points=10000:noise=0.2" + how);
      EXPECT_EQ(model.original_mesh, nullptr);
      const double sigma = 0.2 * model.nominal_spacing_mm;
      double sum = 0.0, square = 0.0;
      int beyond = 0;
      for (std::size_t i = 0; i < model.cloud.size(); ++i) {
        const double d = model.surface->signed_distance_mm(model.cloud.point_mm(i)) / sigma;
        sum += d;
        square += d * d;
        beyond += std::abs(d) > 2.0;
      }
      const auto n = static_cast<double>(model.cloud.size());
      EXPECT_NEAR(sum / n, 0.0, 0.06) << name;
      EXPECT_NEAR(std::sqrt(square / n), 1.0, 0.04) << name;
      EXPECT_NEAR(beyond / n, 0.0455, 0.01) << name;
    }
  // A plane's points keep their places.
  const Cloud clean = made("plane:points=400").cloud, noisy = made("plane:points=400:noise=0.3").cloud;
  EXPECT_EQ(clean.x_mm, noisy.x_mm);
  EXPECT_NE(clean.z_mm, noisy.z_mm);
}

TEST(Sampling, OutliersAreAsManyAndWhereTheyShould) {
  for (const char* at : {"near", "box"}) {
    const GeneratedModel model = made(std::string("torus:points=40000:outliers=0.01:outliers_at=") + at);
    int off = 0;
    for (std::size_t i = 0; i < model.cloud.size(); ++i) {
      const double d = std::abs(model.surface->signed_distance_mm(model.cloud.point_mm(i)));
      off += d > 1.9 * model.nominal_spacing_mm;
      if (std::string(at) == "near") {
        ASSERT_LT(d, 10.1 * model.nominal_spacing_mm);
      }
    }
    EXPECT_NEAR(off, 400, 100) << at;
  }
}

TEST(Sampling, ShuffleChangesTheOrderAlone) {
  const Cloud one = made("plane:points=400:mesh=false").cloud, other = made("plane:points=400:shuffle").cloud;
  EXPECT_TRUE(one.raster);
  EXPECT_FALSE(other.raster);
  EXPECT_NE(one.x_mm, other.x_mm);
  const auto sorted = [](const Cloud& cloud) {
    std::vector<std::array<float, 3>> all;
    for (std::size_t i = 0; i < cloud.size(); ++i)
      all.push_back({cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]});
    std::sort(all.begin(), all.end());
    return all;
  };
  EXPECT_EQ(sorted(one), sorted(other));
}

TEST(Sampling, TheSeedDecidesAndTheNameTells) {
  for (const char* how : {"sampling=random", "sampling=blue", "sampling=lines", "noise=0.1", "outliers=0.1",
                          "shuffle", "sampling=blue:density=4:noise=0.1:outliers=0.02:shuffle"}) {
    const std::string text = std::string("torus:points=5000:") + how;
    const GeneratedModel a = made(text + ":seed=2"), b = made(text + ":seed=2"), c = made(text + ":seed=3");
    EXPECT_EQ(a.cloud.x_mm, b.cloud.x_mm) << text;
    EXPECT_NE(a.cloud.x_mm, c.cloud.x_mm) << text;
    const GeneratedModel again = made(a.spec);
    EXPECT_EQ(a.cloud.z_mm, again.cloud.z_mm) << a.spec;
    EXPECT_EQ(a.spec, again.spec);
  }
  EXPECT_EQ(made("plane:points=100").spec.find("noise"), std::string::npos) << "as usual";
  EXPECT_NE(made("plane:points=100:noise=0.1").spec.find(":noise=0.1"), std::string::npos);
}

TEST(Sampling, RefusesWithAReason) {
  EXPECT_NE(refusal("plane:sampling=poisson").find("sampling"), std::string::npos);
  EXPECT_NE(refusal("plane:ratio=4").find("does nothing with sampling=grid"), std::string::npos);
  EXPECT_NE(refusal("plane:density=4:sampling=lines").find("does nothing"), std::string::npos);
  EXPECT_NE(refusal("plane:sampling=random:jitter=0.1").find("does nothing with sampling=random"),
            std::string::npos);
  EXPECT_NE(refusal("plane:sampling=random:order=boustrophedon").find("does nothing"), std::string::npos);
  EXPECT_NE(refusal("plane:outliers_at=box").find("does nothing with outliers"), std::string::npos);
  EXPECT_NE(refusal("plane:sampling=random:mesh=true").find("no mesh can be made"), std::string::npos);
  EXPECT_NE(refusal("plane:noise=0.1:mesh=true").find("no mesh can be made"), std::string::npos);
  EXPECT_NE(refusal("plane:seed=7").find("seed=7 does nothing with jitter=0"), std::string::npos);
  EXPECT_EQ(refusal("plane:seed=7:points=100:noise=0.1"), "accepted");
  EXPECT_NE(refusal("plane:outliers=1").find("0.9"), std::string::npos);
  EXPECT_NE(refusal("plane:noise=-1").find("noise"), std::string::npos);
  EXPECT_NE(refusal("sphere:spacing_mm=0.006:sampling=random").find("makes"), std::string::npos);
  EXPECT_NE(refusal("rounded-box:radius_mm=11").find("edges"), std::string::npos);
  EXPECT_NE(refusal("shells:gap_mm=30").find("no surface"), std::string::npos);
}

}  // namespace
}  // namespace palpate::cloud
