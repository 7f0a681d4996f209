// Stars read from a raster: sound, the surface that any points would have, and nothing bridged that the
// raster alone would bridge.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <functional>
#include <numbers>
#include <set>

#include "tests/toolkit/local_delaunay/clouds.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"

namespace palpate::local_delaunay {
namespace {

/// at(row, column) over the positions of a raster.
template <class At>
cloud::Cloud scan_of(std::uint32_t rows, std::uint32_t columns, At&& at, bool columns_wrap = false,
                     bool rows_wrap = false) {
  std::vector<Vec3> points;
  for (std::uint32_t r = 0; r < rows; ++r)
    for (std::uint32_t c = 0; c < columns; ++c) points.push_back(at(r, c));
  cloud::Cloud cloud = cloud_of(points);
  cloud.raster = cloud::ScanRaster{columns, rows, cloud::ScanOrder::kRaster, columns_wrap, rows_wrap};
  return cloud;
}

/// On a sphere of 40 mm, `u` around z and `v` from it.
Vec3 on_ball(double u, double v) {
  return 40.0 * Vec3(std::sin(v) * std::cos(u), std::sin(v) * std::sin(u), std::cos(v));
}

/// height(x, y) over `rows` x `columns` positions, rows `apart` as far apart as columns.
cloud::Cloud raster_of(std::uint32_t rows, std::uint32_t columns,
                       const std::function<double(double, double)>& height, double apart = 1.0) {
  return scan_of(rows, columns, [&](double r, double c) { return Vec3(c, apart * r, height(c, apart * r)); });
}
double waves(double x, double y) {
  return 4.0 * std::cos(x / 9.0) * std::cos(y / 7.0);
}
/// Without the positions that `is_hole` says, as reading a raster with holes leaves it.
cloud::Cloud with_holes(const cloud::Cloud& full, const std::function<bool(double, double)>& is_hole) {
  std::vector<Vec3> points;
  cloud::Property row{"row", {}}, column{"column", {}};
  for (std::uint32_t i = 0; i < full.size(); ++i) {
    const std::uint32_t r = i / full.raster->columns, c = i % full.raster->columns;
    if (is_hole(c, r)) continue;
    points.push_back(full.point_mm(i));
    row.values.push_back(static_cast<float>(r));
    column.values.push_back(static_cast<float>(c));
  }
  cloud::Cloud cloud = cloud_of(points);
  cloud.properties = {row, column};
  return cloud;
}
LocalDelaunayMesh without_raster(cloud::Cloud cloud) {
  cloud.raster.reset();
  cloud.properties.clear();
  return LocalDelaunayMesh::build(cloud, 2);
}
LocalDelaunayMesh sound_mesh(const cloud::Cloud& cloud) {
  LocalDelaunayMesh mesh = LocalDelaunayMesh::build(cloud, 2);
  expect_sound(mesh);
  return mesh;
}
/// Triangles with corners both below and above the height.
std::size_t across(const LocalDelaunayMesh& mesh, double height) {
  std::size_t count = 0;
  each_triangle(mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const auto above = [&](std::uint32_t p) { return (mesh.at(p) + mesh.origin_mm()).z() > height; };
    count += static_cast<std::size_t>(above(a) != above(b) || above(b) != above(c));
  });
  return count;
}

TEST(RasterStars, OfAWholeRasterAreTwoTrianglesACell) {
  for (const auto order : {cloud::ScanOrder::kRaster, cloud::ScanOrder::kBoustrophedon})
    for (const auto& [rows, columns] : {std::pair{97u, 61u}, std::pair{40u, 300u}, std::pair{7u, 8u}}) {
      cloud::Cloud cloud = raster_of(rows, columns, waves);
      if (order == cloud::ScanOrder::kBoustrophedon) {
        std::vector<Vec3> points;
        cloud.raster->order = order;
        for (std::size_t i = 0; i < cloud.size(); ++i)
          points.push_back(cloud.point_mm(i / columns * columns + cloud.raster->column(i)));
        const cloud::ScanRaster raster = *cloud.raster;
        cloud = cloud_of(points);
        cloud.raster = raster;
      }
      const LocalDelaunayMesh mesh = sound_mesh(cloud);
      EXPECT_EQ(mesh.counts().raster_points, cloud.size());
      EXPECT_EQ(mesh.counts().triangles, 2u * (rows - 1) * (columns - 1));
      EXPECT_EQ(mesh.counts().open_points, 2u * (rows + columns) - 4);
      EXPECT_EQ(mesh.counts().agreed_points, cloud.size() - mesh.counts().open_points);
      EXPECT_EQ(mesh.counts().pieces, 1u);
      EXPECT_EQ(mesh.counts().closed_components, 0u);
      EXPECT_EQ(mesh.counts().unused, 0u);
    }
}

/// The shorter diagonal, by the positions themselves.
TEST(RasterStars, TakeTheShorterDiagonal) {
  const std::uint32_t columns = 50;
  const cloud::Cloud cloud =
      raster_of(40, columns, [](double x, double y) { return 0.3 * x + 0.2 * y * x / 30.0; });
  const LocalDelaunayMesh mesh = LocalDelaunayMesh::build(cloud, 1);
  ASSERT_EQ(mesh.counts().raster_points, cloud.size());
  std::set<std::array<std::uint32_t, 2>> edges;
  for (const Triple& t : triangles_of(mesh))
    for (std::size_t k = 0; k < 3; ++k)
      edges.insert({std::min(t[k], t[(k + 1) % 3]), std::max(t[k], t[(k + 1) % 3])});
  for (std::uint32_t r = 0; r + 1 < 40; ++r)
    for (std::uint32_t c = 0; c + 1 < columns; ++c) {
      const std::uint32_t a = r * columns + c, b = a + 1, below = a + columns, d = below + 1;
      const double down = (cloud.point_mm(d) - cloud.point_mm(a)).norm();
      const double up = (cloud.point_mm(b) - cloud.point_mm(below)).norm();
      if (std::abs(down - up) < 1e-5 * down) continue;
      EXPECT_EQ(edges.count({a, d}), down < up ? 1u : 0u);
      EXPECT_EQ(edges.count({b, below}), down < up ? 0u : 1u);
    }
}

TEST(RasterStars, AreTheSameForAnyNumberOfThreads) {
  const auto stepped = [](double x, double y) { return waves(x, y) + (x > 100.5 ? 30.0 : 0.0); };
  const cloud::Cloud holes = with_holes(raster_of(200, 180, stepped),
                                        [](double x, double y) { return std::hypot(x - 40, y - 60) < 9.0; });
  for (const cloud::Cloud& cloud : {raster_of(200, 180, waves), raster_of(200, 180, stepped), holes}) {
    const LocalDelaunayMesh once = LocalDelaunayMesh::build(cloud, 1);
    EXPECT_GT(once.counts().raster_points, cloud.size() / 2);
    for (const int threads : {2, 3}) {
      const LocalDelaunayMesh again = LocalDelaunayMesh::build(cloud, threads);
      EXPECT_EQ(again.order(), once.order());
      EXPECT_EQ(triangles_of(again), triangles_of(once));
      for (std::uint32_t i = 0; i < once.size(); ++i) {
        const Ring a = once.ring(i), b = again.ring(i);
        ASSERT_EQ(a.size, b.size);
        EXPECT_EQ(a.open, b.open);
        EXPECT_TRUE(std::equal(a.of, a.of + a.size, b.of));
      }
    }
  }
}

TEST(RasterStars, OffMakesTheStarsOfAnyPoints) {
  const cloud::Cloud cloud = raster_of(80, 90, waves);
  const LocalDelaunayMesh off =
      LocalDelaunayMesh::build(cloud, 2, {}, {.both_sides = false, .raster = false});
  EXPECT_EQ(off.counts().raster_points, 0u);
  EXPECT_EQ(triangles_of(off), triangles_of(without_raster(cloud)));
}

/// A step in depth is bridged by no triangle, whichever rows or columns it runs along, and what is far from
/// it is still the raster's.
TEST(RasterStars, StepsAreNotBridged) {
  for (const double step : {6.0, 10.0, 60.0})
    for (const double slant : {0.0, 0.4, 1.0}) {
      SCOPED_TRACE(step);
      SCOPED_TRACE(slant);
      const auto height = [&](double x, double y) { return x - slant * y > 30.3 ? step : 0.0; };
      const cloud::Cloud cloud = raster_of(70, 120, height);
      const LocalDelaunayMesh mesh = sound_mesh(cloud);
      EXPECT_EQ(across(mesh, 0.5 * step), 0u);
      EXPECT_GT(mesh.counts().raster_points, cloud.size() * 8 / 10);
      EXPECT_LT(mesh.counts().raster_points, cloud.size());
      EXPECT_EQ(mesh.counts().pieces, 2u);
      EXPECT_EQ(mesh.counts().unused, 0u);
    }
}

/// What falls short of a jump is as it was: a raster's stars bridge no step that those of points leave open.
TEST(RasterStars, BridgeNoMoreThanThoseOfAnyPoints) {
  for (double step = 0.5; step < 6.0; step += 0.25) {
    const cloud::Cloud cloud = raster_of(40, 60, [&](double x, double) { return x > 29.5 ? step : 0.0; });
    const LocalDelaunayMesh mesh = sound_mesh(cloud);
    if (across(without_raster(cloud), 0.5 * step) == 0) {
      EXPECT_EQ(across(mesh, 0.5 * step), 0u) << step;
    }
  }
}

TEST(RasterStars, GoAroundHoles) {
  const cloud::Cloud full = raster_of(90, 100, waves);
  const cloud::Cloud cloud = with_holes(full, [](double x, double y) {
    return std::hypot(x - 30.0, y - 40.0) < 8.0 || (x == 70.0 && y == 20.0) || (x == 0.0 && y > 80.0);
  });
  const LocalDelaunayMesh mesh = sound_mesh(cloud);
  EXPECT_GT(mesh.counts().raster_points, cloud.size() * 9 / 10);
  EXPECT_EQ(mesh.counts().pieces, 1u);
  EXPECT_EQ(mesh.counts().unused, 0u);
  // The wide hole is open, the missing point is closed over.
  const auto covered = [&](double x, double y) {
    std::size_t over = 0;
    each_triangle(mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      const auto cross = [&](std::uint32_t p, std::uint32_t q) {
        const Vec3 u = mesh.at(p) + mesh.origin_mm() - Vec3(x, y, 0), v = mesh.at(q) - mesh.at(p);
        return u.x() * v.y() - u.y() * v.x();
      };
      const double s = cross(a, b), t = cross(b, c), r = cross(c, a);
      over += static_cast<std::size_t>((s > 0 && t > 0 && r > 0) || (s < 0 && t < 0 && r < 0));
    });
    return over;
  };
  EXPECT_EQ(covered(30.1, 40.2), 0u);
  EXPECT_EQ(covered(26.1, 44.2), 0u);
  EXPECT_EQ(covered(70.1, 20.2), 1u);
  EXPECT_EQ(covered(50.1, 60.2), 1u);
}

/// Missing at random, as of a dark surface.
TEST(RasterStars, AreSoundWithManyPointsMissing) {
  for (const double share : {0.02, 0.2, 0.5}) {
    Random random(92);
    const cloud::Cloud cloud =
        with_holes(raster_of(60, 70, waves), [&](double, double) { return random.uniform() < share; });
    (void)sound_mesh(cloud);
  }
}

TEST(RasterStars, OneRowIsNoRaster) {
  const cloud::Cloud row = raster_of(1, 50, waves), column = raster_of(50, 1, waves);
  for (const cloud::Cloud& cloud : {row, column}) {
    const LocalDelaunayMesh mesh = sound_mesh(cloud);
    EXPECT_EQ(mesh.counts().raster_points, 0u);
    EXPECT_EQ(triangles_of(mesh), triangles_of(without_raster(cloud)));
  }
  const LocalDelaunayMesh two = LocalDelaunayMesh::build(raster_of(2, 50, waves), 2);
  expect_sound(two);
  EXPECT_EQ(two.counts().triangles, 2u * 49u);
}

/// Whoever says a wrong width is not believed: the cells are none.
TEST(RasterStars, AFalseWidthChangesNothing) {
  const cloud::Cloud cloud = raster_of(60, 80, waves);
  for (const auto& [columns, rows] :
       {std::pair{40u, 120u}, std::pair{160u, 30u}, std::pair{75u, 64u}, std::pair{81u, 60u}}) {
    cloud::Cloud lying = cloud;
    lying.raster = cloud::ScanRaster{columns, rows};
    const LocalDelaunayMesh mesh = LocalDelaunayMesh::build(lying, 2);
    EXPECT_EQ(mesh.counts().raster_points, 0u) << columns;
    EXPECT_EQ(triangles_of(mesh), triangles_of(without_raster(cloud))) << columns;
  }
  cloud::Cloud to_and_fro = cloud;
  to_and_fro.raster->order = cloud::ScanOrder::kBoustrophedon;
  EXPECT_EQ(triangles_of(LocalDelaunayMesh::build(to_and_fro, 2)), triangles_of(without_raster(cloud)));
}

/// The same place seen twice: what lies on another part is laid out as any points are.
TEST(RasterStars, OverlappingViewsAreLaidOut) {
  const auto twice = [](double x) { return x < 120.0 ? x : x - 30.25; };
  const cloud::Cloud cloud =
      scan_of(60, 200, [&](double r, double c) { return Vec3(twice(c), r, waves(twice(c), r)); });
  const LocalDelaunayMesh mesh = sound_mesh(cloud);
  // Of 200 columns some 60 lie double.
  EXPECT_LT(mesh.counts().raster_points, cloud.size() * 7 / 10);
  const LocalDelaunayMesh any = without_raster(cloud);
  EXPECT_NEAR(static_cast<double>(mesh.counts().triangles), static_cast<double>(any.counts().triangles),
              0.01 * static_cast<double>(any.counts().triangles));
}

TEST(RasterStars, DuplicatesAreOnePoint) {
  // A pole: a whole row at one place. And single points that stand where the next one does.
  const std::uint32_t columns = 60, rows = 150;
  const cloud::Cloud cloud = scan_of(
      rows, columns,
      [&](std::uint32_t r, std::uint32_t c) {
        if (r == 30 && c == 7) c = 8;
        return on_ball(2.0 * std::numbers::pi * c / columns, 0.5 * std::numbers::pi * r / rows);
      },
      true);
  const LocalDelaunayMesh mesh = sound_mesh(cloud);
  EXPECT_GE(mesh.counts().welded, columns - 1u + 1u);
  EXPECT_EQ(mesh.counts().pieces, 1u);
  EXPECT_GT(mesh.counts().raster_points, cloud.size() / 3);
  EXPECT_LT(mesh.counts().raster_points, cloud.size() - columns);
  // At the pole rows are far apart and columns are not: it is as open as that of any points.
  const auto open = static_cast<double>(without_raster(cloud).counts().open_points);
  EXPECT_NEAR(static_cast<double>(mesh.counts().open_points), open, 0.05 * open);
}

/// A turntable's raster goes round both ways.
TEST(RasterStars, OfATorusAreClosedAndOutward) {
  for (const bool inside_out : {false, true}) {
    const cloud::Cloud cloud = scan_of(
        180, 60,
        [&](double r, double c) {
          const double turn = 2.0 * std::numbers::pi;
          return on_torus(turn * r / 180, (inside_out ? -1.0 : 1.0) * turn * c / 60, 10);
        },
        true, true);
    const LocalDelaunayMesh mesh = sound_mesh(cloud);
    EXPECT_EQ(mesh.counts().raster_points, cloud.size());
    EXPECT_EQ(mesh.counts().closed_components, 1u);
    EXPECT_EQ(mesh.counts().components_with_holes, 0u);
    EXPECT_EQ(mesh.counts().open_points, 0u);
    double volume = 0.0;
    each_triangle(mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      volume += mesh.at(a).dot(mesh.at(b).cross(mesh.at(c))) / 6.0;
    });
    EXPECT_NEAR(volume, 2.0 * std::numbers::pi * std::numbers::pi * 30.0 * 100.0, 0.01 * 59218.0);
  }
}

/// A bottle with an open mouth encloses a volume but for that, as those of any points would.
TEST(RasterStars, AreFacedOutWhereTheyEncloseAVolumeButForAMouth) {
  const cloud::Cloud cloud = scan_of(
      70, 90,
      [](double r, double c) {
        return on_ball(2.0 * std::numbers::pi * c / 90, std::numbers::pi * (0.14 + 0.72 * r / 70));
      },
      true);
  const LocalDelaunayMesh mesh = sound_mesh(cloud), any = without_raster(cloud);
  EXPECT_EQ(mesh.counts().raster_points, cloud.size());
  EXPECT_EQ(mesh.counts().components_with_holes, any.counts().components_with_holes);
  EXPECT_EQ(mesh.counts().components_with_holes, 1u);
  EXPECT_NEAR(mesh.counts().min_enclosed, any.counts().min_enclosed, 0.02);
  expect_outward(mesh);
}

/// Whatever a raster says of any points, the mesh is sound.
TEST(RasterStars, AreSoundOnAnyPoints) {
  for (const Named& named : all_clouds()) {
    const auto n = static_cast<std::uint32_t>(named.points.size());
    for (const std::uint32_t columns : {2u, 5u, 10u, 64u}) {
      if (n / columns < 2) continue;
      SCOPED_TRACE(named.name);
      cloud::Cloud cloud = cloud_of({named.points.begin(), named.points.begin() + n / columns * columns});
      for (const bool wraps : {false, true}) {
        cloud.raster = cloud::ScanRaster{columns, n / columns, cloud::ScanOrder::kRaster, wraps, wraps};
        (void)sound_mesh(cloud);
      }
    }
  }
  // Noise that leaves some cells, and a raster of three columns that goes round.
  Random random(93);
  for (const double noise : {0.1, 0.3, 0.6, 2.0}) {
    SCOPED_TRACE(noise);
    expect_sound(LocalDelaunayMesh::build(
        raster_of(60, 60, [&](double x, double y) { return waves(x, y) + noise * random.normal(); }), 2));
  }
}

TEST(RasterStars, ScanLinesFarApartAreARaster) {
  const cloud::Cloud cloud = raster_of(
      40, 300, [](double x, double y) { return waves(x / 4.0, y / 4.0); }, 8.0);
  const LocalDelaunayMesh mesh = sound_mesh(cloud);
  EXPECT_EQ(mesh.counts().raster_points, cloud.size());
}

}  // namespace
}  // namespace palpate::local_delaunay
