// Generated models: counts, exactness, order, triangulation, determinism, refusals.
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <cmath>
#include <map>
#include <set>
#include <string>

#include "tests/toolkit/cloud/made.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/cloud/lattice.h"

namespace palpate::cloud {
namespace {

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
        const GeneratedModel model = made(text);
        const double size = model.surface->box_mm().extent_mm().norm();
        geometry::Aabb box = model.cloud.box_mm();
        for (std::size_t i = 0; i < model.cloud.size(); i += 7) {
          // Slope times the float rounding of half the extent.
          ASSERT_NEAR(model.surface->signed_distance_mm(model.cloud.point_mm(i)), 0.0, 5e-7 * size)
              << text << ' ' << i;
          if (model.original_mesh) {
            ASSERT_NEAR(model.surface->signed_distance_mm(model.original_mesh->vertices_mm[i]), 0.0,
                        1e-13 * size)
                << text;
            ASSERT_LT((model.original_mesh->vertices_mm[i] - model.cloud.point_mm(i)).norm(), 1e-7 * size);
          }
        }
        const geometry::Aabb whole = model.surface->box_mm().grown(1e-6 * size);
        EXPECT_TRUE(whole.contains(box.low_mm) && whole.contains(box.high_mm)) << text;
        EXPECT_EQ(model.original_mesh != nullptr, std::string(how).find("0.45") == std::string::npos) << text;
      }
}

TEST(Generate, MeshesAreManifoldAndFaceOutward) {
  for (const char* name : kAll)
    for (const char* how :
         {":points=600", ":points=600:jitter=0.24", ":points=600:nonuniform=0.8", ":points=8"}) {
      const std::string text = std::string(name) + how;
      const GeneratedModel model = made(text);
      ASSERT_NE(model.original_mesh, nullptr) << text;
      const auto& mesh = *model.original_mesh;
      ASSERT_EQ(mesh.vertices_mm.size(), model.cloud.size());
      std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
      std::set<std::uint32_t> used;
      const bool coarse = std::string(how) == ":points=8";
      for (const auto& t : mesh.triangles) {
        for (int k = 0; k < 3; ++k) {
          used.insert(t[static_cast<std::size_t>(k)]);
          ++edges[{t[static_cast<std::size_t>(k)], t[static_cast<std::size_t>((k + 1) % 3)]}];
        }
        const Vec3 &a = mesh.vertices_mm[t[0]], &b = mesh.vertices_mm[t[1]], &c = mesh.vertices_mm[t[2]];
        const Vec3 n = (b - a).cross(c - a);
        ASSERT_GT(n.norm(), 0.0) << text;
        // Across a crease a triangle may face either side's normal, but never down.
        if (model.cloud.raster) {
          ASSERT_GT(n.z(), 0.0) << text;
        } else if (!coarse) {
          ASSERT_GT(n.dot(model.surface->closest((a + b + c) / 3).normal), 0.0) << text;
        }
      }
      EXPECT_EQ(used.size(), model.cloud.size()) << text << ": every point is a vertex of the mesh";
      std::size_t open = 0;
      for (const auto& [edge, count] : edges) {
        ASSERT_EQ(count, 1) << text << ": an edge is used twice in one direction";
        open += edges.count({edge.second, edge.first}) == 0;
      }
      const bool closed = !model.cloud.raster;
      if (closed) {
        EXPECT_EQ(open, 0u) << text;
        const long euler = static_cast<long>(mesh.vertices_mm.size()) - static_cast<long>(edges.size() / 2) +
                           static_cast<long>(mesh.triangles.size());
        EXPECT_EQ(euler, std::string(name) == "torus" ? 0 : 2) << text;
      } else {
        EXPECT_EQ(open, 4u * (model.cloud.raster->columns - 1)) << text;
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

TEST(Generate, LatticeNumbersEverySurfacePointOnce) {
  for (const auto& n : {std::array<std::uint32_t, 3>{1, 1, 1}, {2, 1, 1}, {1, 3, 2}, {4, 5, 6}, {7, 2, 1}}) {
    const BoxLattice lattice(n[0], n[1], n[2]);
    std::size_t on_surface = 0;
    for (std::uint32_t k = 0; k <= n[2]; ++k)
      for (std::uint32_t j = 0; j <= n[1]; ++j)
        for (std::uint32_t i = 0; i <= n[0]; ++i)
          on_surface += i == 0 || j == 0 || k == 0 || i == n[0] || j == n[1] || k == n[2];
    ASSERT_EQ(lattice.size(), on_surface);
    for (std::size_t i = 0; i < lattice.size(); ++i) {
      const auto c = lattice.coordinates(i);
      ASSERT_EQ(lattice.index(c[0], c[1], c[2]), i);
      ASSERT_LE(c[0], n[0]);
      ASSERT_LE(c[1], n[1]);
      ASSERT_LE(c[2], n[2]);
    }
  }
}

TEST(Generate, ClosedShapesHaveAboutTheWantedNumber) {
  for (const char* name : {"sphere", "torus", "slab"}) {
    const double n = static_cast<double>(made(std::string(name) + ":points=50000").cloud.size());
    EXPECT_NEAR(n, 50000, 1000) << name;
  }
}

TEST(Generate, TheSeedDecides) {
  const GeneratedModel a = made("sinusoid:points=400:jitter=0.3:seed=1");
  const GeneratedModel b = made("sinusoid:points=400:jitter=0.3:seed=1");
  const GeneratedModel c = made("sinusoid:points=400:jitter=0.3:seed=2");
  EXPECT_EQ(a.cloud.x_mm, b.cloud.x_mm);
  EXPECT_EQ(a.cloud.z_mm, b.cloud.z_mm);
  EXPECT_NE(a.cloud.x_mm, c.cloud.x_mm);
}

TEST(Generate, RefusesWithAReason) {
  EXPECT_NE(refusal("sinusoidal").find("choose from sinusoid, plane"), std::string::npos);
  EXPECT_NE(refusal("plane:points=100:spacing_mm=1").find("keep one"), std::string::npos);
  EXPECT_NE(refusal("plane:radius=1").find("no option"), std::string::npos);
  EXPECT_NE(refusal("plane:spacing_mm=1e-9").find("too many points"), std::string::npos);
  EXPECT_NE(refusal("plane:points=1000000000").find("is not a whole number from"), std::string::npos);
  EXPECT_NE(refusal("sinusoid:wavelength_mm=1").find("slope"), std::string::npos);
  EXPECT_NE(refusal("slab:thickness_mm=100").find("thickness"), std::string::npos);
  EXPECT_NE(refusal("plane:scale=1e40:points=100").find("single precision"), std::string::npos);
  EXPECT_NE(refusal("plane:jitter=nan").find("number"), std::string::npos);
}

}  // namespace
}  // namespace palpate::cloud
