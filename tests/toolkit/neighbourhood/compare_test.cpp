// The study of builders: its truths and its counts against what can be worked out by hand.
#include "toolkit/neighbourhood/compare.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/toolkit/neighbourhood/cases.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/neighbourhood/builders.h"
#include "toolkit/neighbourhood/knn.h"

namespace palpate::neighbourhood {
namespace {

TEST(Compare, CountsSharedLinks) {
  NeighbourTable truth, table;
  truth.of = {{1, 2, 0, 0, 0, 0, 0, 0}, {0, 1, 1, 1, 1, 1, 1, 1}, {0, 1, 2, 2, 2, 2, 2, 2}};
  table.of = {{2, 0, 0, 0, 0, 0, 0, 0}, {0, 2, 1, 1, 1, 1, 1, 1}, {2, 2, 2, 2, 2, 2, 2, 2}};
  const LinkAgreement a = link_agreement(table, truth);
  EXPECT_EQ(a.true_links, 5u);
  EXPECT_EQ(a.links, 3u);
  EXPECT_EQ(a.shared, 2u);
  EXPECT_DOUBLE_EQ(a.found_percent(), 40.0);
  EXPECT_DOUBLE_EQ(link_agreement(truth, truth).found_percent(), 100.0);
}

TEST(Compare, TheTruthComesFromTheScannerOrTheMesh) {
  const auto plane = cloud::generate(parse_named_options("plane:points=400").value()).value();
  const SurfaceNeighbours path = surface_neighbours(plane.cloud, plane.original_mesh.get(), 1);
  EXPECT_EQ(path.table.of, scanner_path(plane.cloud, 1)->of);
  cloud::Cloud unordered = plane.cloud;
  unordered.raster.reset();
  // Inside, a grid cut along one diagonal has six edges at a point.
  const SurfaceNeighbours mesh = surface_neighbours(unordered, plane.original_mesh.get(), 1);
  const std::uint32_t middle = 10 * 20 + 10;
  EXPECT_EQ(mesh.table.count(middle), 6u);
  EXPECT_EQ(link_agreement(path.table, mesh.table).found_percent(), 100.0);
  EXPECT_EQ(surface_neighbours(unordered, nullptr, 1).table.of, exact_knn(unordered, 1).of);
}

TEST(Compare, KnowsTheSidesOfAThinWall) {
  for (const double thickness : {0.5, 1.0, 3.0}) {
    ThinWallOptions options;
    options.thickness_spacings = thickness;
    options.across = 30;
    const ThinWall wall = make_thin_wall(options).value();
    const double rim = 0.5 * 30 * wall.spacing_mm - 3.0 * wall.spacing_mm * std::max(1.0, thickness);
    for (std::size_t i = 0; i < wall.cloud.size(); ++i) {
      const Vec3 p = wall.cloud.point_mm(i);
      const bool inner = std::max(std::abs(p.x()), std::abs(p.y())) < rim;
      ASSERT_EQ(wall.side[i], inner ? (p.z() > 0.0 ? 1 : -1) : 0);
      if (inner) {
        ASSERT_NEAR(std::abs(p.z()), 0.5 * thickness * wall.spacing_mm, 1e-6);
      }
    }
    // Brute force: nearest eight, by side.
    const NeighbourTable nearest = brute(wall.cloud);
    std::uint64_t wrong = 0, links = 0;
    for (std::uint32_t i = 0; i < wall.cloud.size(); ++i)
      for (const std::uint32_t j : nearest.of[i]) {
        links += wall.side[i] != 0 && wall.side[j] != 0 && j != i;
        wrong += wall.side[i] * wall.side[j] == -1;
      }
    const WallLinks found = links_through(wall, nearest);
    EXPECT_EQ(found.wrong, wrong);
    EXPECT_EQ(found.links, links);
    EXPECT_EQ(found.wrong > 0, thickness < 2.0);
    // A scanner on either side never sees the other face.
    const Result<Built> looked = build_neighbours("lookup-table", wall.cloud, 1);
    ASSERT_TRUE(looked) << looked.error().message();
    EXPECT_EQ(links_through(wall, looked->table).wrong, 0u);
  }
  ThinWallOptions cube;
  cube.across = 10;
  cube.thickness_spacings = 11;
  EXPECT_FALSE(make_thin_wall(cube));
}

TEST(Compare, ScoresEveryBuilder) {
  const auto model = cloud::generate(parse_named_options("sphere:points=2000").value()).value();
  const SurfaceNeighbours truth = surface_neighbours(model.cloud, model.original_mesh.get(), 1);
  ThinWallOptions wall;
  wall.across = 30;
  const std::vector<ThinWall> walls = {make_thin_wall(wall).value()};
  const std::vector<std::string> names = {"exact-knn", "scanner-path", "directional-knn:frame=plan",
                                          "nonsense"};
  CompareOptions options;
  options.repeats = 1;
  const std::vector<BuilderScore> scores =
      compare_neighbours(names, model.cloud, truth.table, walls, options, no_progress());
  ASSERT_EQ(scores.size(), names.size());
  for (std::size_t i = 0; i < names.size(); ++i) EXPECT_EQ(scores[i].builder, names[i]);
  EXPECT_TRUE(scores[0].failure.empty());
  EXPECT_EQ(scores[0].agreement.shared, link_agreement(exact_knn(model.cloud, 1), truth.table).shared);
  EXPECT_GT(scores[0].agreement.found_percent(), 90.0);
  EXPECT_EQ(scores[0].walls.at(0).wrong, links_through(walls[0], exact_knn(walls[0].cloud, 1)).wrong);
  EXPECT_FALSE(scores[1].failure.empty());
  EXPECT_FALSE(scores[1].wall_failures.at(0).empty());
  EXPECT_TRUE(scores[2].failure.empty());
  EXPECT_FALSE(scores[3].failure.empty());
}

}  // namespace
}  // namespace palpate::neighbourhood
