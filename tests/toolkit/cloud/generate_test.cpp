// Generated models: counts, exactness, order, triangulation, determinism, refusals.
#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <string>
#include <vector>

#include <palpate/generate.h>
#include "tests/toolkit/cloud/posts.h"
#include "tests/toolkit/messages.h"
#include "toolkit/cloud/height_field.h"

namespace palpate::cloud {
namespace {

/// Each of `step` points lies on the surface within the rounding of floats of half its extent times a slope,
/// and in its box; the vertices of its mesh, where it has one, are on it and at their points.
void expect_on_surface(const GeneratedModel& model, std::size_t step) {
  const double size = model.surface->box_mm().extent_mm().norm();
  for (std::size_t i = 0; i < model.cloud.size(); i += step) {
    ASSERT_NEAR(model.surface->signed_distance_mm(model.cloud.point_mm(i)), 0.0, 5e-7 * size) << i;
    if (!model.original_mesh) continue;
    const Vec3& vertex = model.original_mesh->vertices_mm[i];
    ASSERT_NEAR(model.surface->signed_distance_mm(vertex), 0.0, 1e-13 * size);
    ASSERT_LT((vertex - model.cloud.point_mm(i)).norm(), 1e-7 * size);
  }
  const geometry::Aabb whole = model.surface->box_mm().grown(1e-6 * size), box = model.cloud.box_mm();
  EXPECT_TRUE(whole.contains(box.low_mm) && whole.contains(box.high_mm));
}

struct Topology {
  std::size_t open = 0;
  long euler = 0;
};
/// Every point is a vertex, an edge has one facet on a side; `facet` is told of each normal and centre.
template <class Facet>
Topology expect_manifold(const GeneratedModel& model, Facet&& facet) {
  const auto& mesh = *model.original_mesh;
  EXPECT_EQ(mesh.vertices_mm.size(), model.cloud.size());
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  std::set<std::uint32_t> used;
  for (const auto& t : mesh.triangles) {
    used.insert(t.begin(), t.end());
    for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
    const Vec3 &a = mesh.vertices_mm[t[0]], &b = mesh.vertices_mm[t[1]], &c = mesh.vertices_mm[t[2]];
    facet((b - a).cross(c - a), (a + b + c) / 3);
  }
  EXPECT_EQ(used.size(), model.cloud.size()) << "every point is a vertex of the mesh";
  Topology found;
  for (const auto& [edge, count] : edges) {
    EXPECT_EQ(count, 1) << "an edge is used twice in one direction";
    found.open += edges.count({edge.second, edge.first}) == 0;
  }
  found.euler = static_cast<long>(mesh.vertices_mm.size()) -
                static_cast<long>((edges.size() + found.open) / 2) + static_cast<long>(mesh.triangles.size());
  return found;
}

const char* const kAll[] = {
    "sinusoid", "plane", "saddle", "relief:finest_mm=8", "wedge:angle_deg=70", "wedge:angle_deg=300",
    "sphere",   "torus", "slab"};

TEST(Generate, Table7IsTheGridOfTheThesis) {
  const GeneratedModel model = made("sinusoid:points=1002001:mesh=false");
  ASSERT_EQ(model.cloud.size(), 1002001u);
  ASSERT_TRUE(model.cloud.raster);
  EXPECT_EQ(model.cloud.raster->columns, 1001u);
  EXPECT_EQ(model.cloud.raster->rows, 1001u);
  EXPECT_DOUBLE_EQ(model.nominal_spacing_mm, 0.1);
  EXPECT_EQ(model.original_mesh, nullptr);
  // Row 3, column 500: x = 0, y = -49.7.
  const Vec3 p = model.cloud.point_mm(3 * 1001 + 500);
  EXPECT_EQ(p.x(), 0.0);
  EXPECT_NEAR(p.y(), -49.7, 2e-6);
  EXPECT_NEAR(p.z(), 10 + 10 * std::cos(0.04 * 3.14159265358979 * 49.7), 2e-6);
}

TEST(Generate, SpacingAndPointsAgree) {
  EXPECT_EQ(made("plane:spacing_mm=0.5").cloud.size(), 201u * 201u);
  EXPECT_EQ(made("plane:spacing_mm=0.5:scale=10").cloud.size(), 201u * 201u);
  EXPECT_EQ(made("plane:points=10000").cloud.size(), 10000u);
  EXPECT_DOUBLE_EQ(made("plane:points=10201").nominal_spacing_mm, 1.0);
}

TEST(Generate, PointsLieOnTheSurfaceAtEveryScale) {
  for (const char* scale : {"0.001", "1", "1000000"})
    for (const char* name : kAll)
      for (const char* how : {"", ":jitter=0.2", ":jitter=0.45:nonuniform=0.5"}) {
        const std::string text = std::string(name) + how + ":points=900:scale=" + scale;
        SCOPED_TRACE(text);
        const GeneratedModel model = made(text);
        expect_on_surface(model, 7);
        EXPECT_EQ(model.original_mesh != nullptr, std::string(how).find("0.45") == std::string::npos);
      }
}

TEST(Generate, MeshesAreManifoldAndFaceOutward) {
  for (const char* name : kAll)
    for (const char* how :
         {":points=600", ":points=600:jitter=0.24", ":points=600:nonuniform=0.8", ":points=8"}) {
      const std::string text = std::string(name) + how;
      SCOPED_TRACE(text);
      const GeneratedModel model = made(text);
      ASSERT_NE(model.original_mesh, nullptr);
      const bool coarse = std::string(how) == ":points=8";
      const Topology found = expect_manifold(model, [&](const Vec3& n, const Vec3& centre) {
        ASSERT_GT(n.norm(), 0.0);
        // Across a crease a triangle may face either side's normal, but never down.
        if (model.cloud.raster) {
          ASSERT_GT(n.z(), 0.0);
        } else if (!coarse) {
          ASSERT_GT(n.dot(model.surface->closest(centre).normal), 0.0);
        }
      });
      EXPECT_EQ(found.open, model.cloud.raster ? 4u * (model.cloud.raster->columns - 1) : 0u);
      if (!model.cloud.raster) {
        EXPECT_EQ(found.euler, std::string(name) == "torus" ? 0 : 2);
      }
    }
}

TEST(Generate, AnOrderChangesPlacesInTheStoreAlone) {
  for (const std::string name : {"sinusoid:points=400:jitter=0.2", "wedge:points=100", "plane:points=49"}) {
    const GeneratedModel one = generate(parse_named_options(name).value()).value();
    const GeneratedModel fro = generate(parse_named_options(name + ":order=boustrophedon").value()).value();
    const ScanRaster &r = *one.cloud.raster, &f = *fro.cloud.raster;
    EXPECT_EQ(f.order, ScanOrder::kBoustrophedon);
    ASSERT_EQ(f.columns, r.columns);
    std::vector<std::uint32_t> place(one.cloud.size());
    for (std::size_t row = 0; row < r.rows; ++row)
      for (std::size_t column = 0; column < r.columns; ++column) {
        const std::size_t i = r.index(row, column), j = f.index(row, column);
        place[i] = static_cast<std::uint32_t>(j);
        EXPECT_EQ(f.column(j), column);
        EXPECT_EQ(one.cloud.local_mm(i), fro.cloud.local_mm(j));
        if (column > 0) {
          EXPECT_EQ(j > f.index(row, column - 1), row % 2 == 0);
        }
      }
    auto triangles = one.original_mesh->triangles;
    for (auto& t : triangles)
      for (std::uint32_t& corner : t) corner = place[corner];
    EXPECT_EQ(triangles, fro.original_mesh->triangles);
  }
  const Cloud rings = generate(parse_named_options("torus:points=900").value())->cloud;
  const Cloud table = generate(parse_named_options("torus:points=900:order=turntable").value())->cloud;
  EXPECT_FALSE(rings.raster);
  ASSERT_TRUE(table.raster);
  EXPECT_EQ(table.raster->columns * table.raster->rows, table.size());
  EXPECT_EQ(rings.x_mm, table.x_mm);
}

TEST(Generate, ClosedShapesHaveAboutTheWantedNumber) {
  for (const char* name : {"sphere", "torus", "slab"}) {
    const double n = static_cast<double>(made(std::string(name) + ":points=50000").cloud.size());
    EXPECT_NEAR(n, 50000, 1000) << name;
  }
}

std::string refusal(const std::string& text) {
  const auto model = generate(*parse_named_options(text));
  return model ? "accepted" : model.error().message();
}

TEST(Generate, RefusesWithAReason) {
  const std::pair<const char*, const char*> refused[] = {
      {"sinusoidal", "choose from sinusoid, plane"},
      {"plane:points=100:spacing_mm=1", "keep one"},
      {"plane:radius=1", "no option"},
      {"plane:spacing_mm=1e-9", "too many points"},
      {"plane:points=1000000000", "is not a whole number from"},
      {"sinusoid:wavelength_mm=1", "slope"},
      {"slab:thickness_mm=100", "thickness"},
      {"plane:scale=1e40:points=100", "single precision"},
      {"plane:jitter=nan", "number"},
      {"plane:sampling=poisson", "sampling"},
      {"plane:ratio=4", "does nothing with sampling=grid"},
      {"plane:density=4:sampling=lines", "does nothing"},
      {"plane:sampling=random:jitter=0.1", "does nothing with sampling=random"},
      {"plane:sampling=random:order=boustrophedon", "does nothing"},
      {"plane:outliers_at=box", "does nothing with outliers"},
      {"plane:sampling=random:mesh=true", "no mesh can be made"},
      {"plane:noise=0.1:mesh=true", "no mesh can be made"},
      {"plane:seed=7", "seed=7 does nothing with jitter=0"},
      {"plane:seed=7:points=100:noise=0.1", "accepted"},
      {"plane:outliers=1", "0.9"},
      {"plane:noise=-1", "noise"},
      {"sphere:spacing_mm=0.006:sampling=random", "makes"},
      {"rounded-box:radius_mm=11", "edges"},
      {"shells:gap_mm=30", "no surface"}};
  for (const auto& [text, why] : refused) EXPECT_TRUE(test::contains(refusal(text), why)) << text;
}

// Round and nested bodies, open sheets, and the ways of sampling: exactness, spacing, determinism.

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
  return std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
}

TEST(Round, PointsLieOnTheSurfaceAndMeshesFaceOutward) {
  for (const char* scale : {"0.001", "1", "1000000"})
    for (const char* name : kRound)
      for (const char* how : {"", ":jitter=0.2", ":jitter=0.2:nonuniform=0.5", ":shuffle"}) {
        const std::string text = std::string(name) + how + ":points=2000:scale=" + scale;
        SCOPED_TRACE(text);
        const GeneratedModel model = made(text);
        EXPECT_NEAR(static_cast<double>(model.cloud.size()), 2000, 300);
        EXPECT_FALSE(model.cloud.raster);
        ASSERT_NE(model.original_mesh, nullptr);
        expect_on_surface(model, 1);
        const Topology found = expect_manifold(model, [&](const Vec3& n, const Vec3& centre) {
          ASSERT_GT(n.dot(model.surface->closest(centre).normal), 0.0);
        });
        const bool sheet = text.substr(0, 4) == "bowl";
        EXPECT_EQ(found.open > 0, sheet);
        EXPECT_EQ(found.euler, sheet ? 1 : text.substr(0, 6) == "shells" ? 4 : 2);
      }
}

TEST(Sampling, EveryWayLiesOnTheSurface) {
  // One way a scale: each makes a table of the surface's areas.
  for (const auto& [scale, how] :
       {std::pair("0.001", "random"), std::pair("1", "blue"), std::pair("1000000", "lines")})
    for (const char* name : kAllSamplings) {
      const std::string text = std::string(name) + ":points=1500:sampling=" + how + ":seed=3:scale=" + scale;
      SCOPED_TRACE(text);
      const GeneratedModel model = made(text);
      EXPECT_EQ(model.original_mesh, nullptr);
      EXPECT_FALSE(model.cloud.raster);
      EXPECT_NEAR(static_cast<double>(model.cloud.size()), 1500, std::string(how) == "lines" ? 400 : 0);
      expect_on_surface(model, 3);
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
    const GeneratedModel model = made(std::string(name) + ":points=5000:sampling=blue");
    const std::vector<double> nearest = nearest_distances(model.cloud, 4 * model.nominal_spacing_mm);
    EXPECT_GT(*std::min_element(nearest.begin(), nearest.end()), 0.65 * model.nominal_spacing_mm) << name;
    EXPECT_LT(mean(nearest), 0.9 * model.nominal_spacing_mm) << name;
  }
  // The sheets of a thin wall do not keep apart.
  const GeneratedModel shells = made("shells:points=5000:gap_mm=0.1:sampling=blue");
  EXPECT_EQ(shells.cloud.size(), 5000u);
  const std::vector<double> across = nearest_distances(shells.cloud, 4 * shells.nominal_spacing_mm);
  EXPECT_LT(*std::min_element(across.begin(), across.end()), 0.5 * shells.nominal_spacing_mm);
  const auto outer = std::count_if(shells.cloud.x_mm.begin(), shells.cloud.x_mm.end(), [&](const float& x) {
    return shells.cloud.local_mm(static_cast<std::size_t>(&x - shells.cloud.x_mm.data())).norm() > 19.95;
  });
  EXPECT_NEAR(static_cast<double>(outer), 2500, 125);
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
  for (const char* how :
       {"jitter=0.3", "sampling=random", "sampling=blue", "sampling=lines", "noise=0.1", "outliers=0.1",
        "shuffle", "sampling=blue:density=4:noise=0.1:outliers=0.02:shuffle",
        "sampling=scan:views=3:noise=0.2:flying=0.02:dropout=0.1"}) {
    const std::string text = std::string("torus:points=5000:") + how;
    const GeneratedModel a = made(text + ":seed=2"), b = made(text + ":seed=2"), c = made(text + ":seed=3");
    EXPECT_EQ(a.cloud.x_mm, b.cloud.x_mm) << text;
    EXPECT_NE(a.cloud.x_mm, c.cloud.x_mm) << text;
    const GeneratedModel again = made(a.spec);
    EXPECT_EQ(a.cloud.z_mm, again.cloud.z_mm) << a.spec;
    EXPECT_EQ(a.spec, again.spec);
  }
  EXPECT_FALSE(test::contains(made("plane:points=100").spec, "noise")) << "as usual";
  EXPECT_TRUE(test::contains(made("plane:points=100:noise=0.1").spec, ":noise=0.1"));
}

}  // namespace
}  // namespace palpate::cloud
