// Triangles that the points agree on: each in the rings of its corners, one side a piece, and the same
// whatever the order of the points and the number of threads.
#include "toolkit/stars/star_mesh.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "tests/toolkit/stars/clouds.h"
#include "tests/toolkit/stars/sound.h"
#include "toolkit/stars/near_places.h"

namespace palpate::stars {
namespace {

using Triple = std::array<std::uint32_t, 3>;

/// Of the cloud's indices, the lowest first, the way around kept.
std::vector<Triple> triangles_of(const StarMesh& mesh) {
  std::vector<Triple> all = mesh.as_mesh().triangles;
  for (Triple& t : all) std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  std::sort(all.begin(), all.end());
  return all;
}

TEST(StarMesh, IsSoundOnAnyPoints) {
  for (const Named& cloud : all_clouds()) {
    SCOPED_TRACE(cloud.name);
    expect_sound(StarMesh::build(cloud_of(cloud.points), 2));
  }
}

TEST(StarMesh, OfRandomPointsIsWhole) {
  const StarMesh torus = StarMesh::build(cloud_of(random_torus(100000, 0.0, 11)), 2);
  EXPECT_EQ(torus.counts().pieces, 1u);
  EXPECT_EQ(torus.counts().closed_pieces, 1u);
  EXPECT_EQ(torus.counts().open_points, 0u);
  EXPECT_EQ(torus.counts().torn, 0u);
  // Euler: V - E + F = 0 on a torus, with 2 E = 3 F.
  const std::uint64_t used = torus.size() - torus.counts().welded - torus.counts().unused;
  EXPECT_EQ(torus.counts().triangles, 2 * used);
  EXPECT_LT(torus.counts().unused + torus.counts().welded, torus.size() / 500);
  EXPECT_LT(torus.counts().voted + torus.counts().filled, torus.size() / 500);
}

/// Noise leaves no holes and no tears: what cannot be settled is made without the points in question, and
/// these are few.
TEST(StarMesh, InNoiseIsWhole) {
  for (const double noise : {0.05, 0.1, 0.15}) {
    SCOPED_TRACE(noise);
    const StarMesh torus = StarMesh::build(cloud_of(random_torus(60000, noise, 18)), 2);
    EXPECT_EQ(torus.counts().torn, 0u);
    EXPECT_LT(torus.counts().open_points, torus.size() / 1000);
    EXPECT_LT(torus.counts().unused + torus.counts().welded, torus.size() / 200);
  }
}

/// More points at each place than a star looks at: one of each place counts.
TEST(StarMesh, PilesAreOnePointEach) {
  const std::vector<Vec3> once = random_torus(2000, 0.0, 19);
  std::vector<Vec3> piled;
  for (int copy = 0; copy < 40; ++copy) piled.insert(piled.end(), once.begin(), once.end());
  const StarMesh single = StarMesh::build(cloud_of(once), 2), many = StarMesh::build(cloud_of(piled), 2);
  EXPECT_EQ(many.counts().triangles, single.counts().triangles);
  EXPECT_EQ(many.counts().welded, single.counts().welded + 39u * 2000u);
  EXPECT_EQ(many.counts().unused, single.counts().unused);
}

TEST(StarMesh, PointsOutOfClosedPieces) {
  const StarMesh mesh = StarMesh::build(cloud_of(random_spheres({10.0}, 0.2, 12)), 2);
  ASSERT_EQ(mesh.counts().closed_pieces, 1u);
  for (std::uint32_t i = 0; i < mesh.size(); ++i)
    mesh.for_triangles_of(i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      const Vec3 n = (mesh.at(b) - mesh.at(a)).cross(mesh.at(c) - mesh.at(a));
      EXPECT_GT(n.dot(mesh.at(a) + mesh.origin_mm()), 0.0);
    });
}

TEST(StarMesh, KeepsSheetsApart) {
  const StarMesh mesh = StarMesh::build(cloud_of(random_spheres({20.0, 19.4}, 0.2, 13)), 2);
  EXPECT_EQ(mesh.counts().closed_pieces, 2u);
  EXPECT_EQ(mesh.counts().open_points, 0u);
  // An even lattice on both, what a scan of sheet metal is: their borders may be joined, as a plate's rim is,
  // and nothing else.
  for (const double gap : {0.2, 0.25, 0.3}) {
    std::vector<Vec3> sheets;
    for (int x = 0; x < 80; ++x)
      for (int y = 0; y < 80; ++y)
        for (const double z : {0.0, gap}) sheets.emplace_back(0.2 * x, 0.2 * y, z);
    const StarMesh thin = StarMesh::build(cloud_of(sheets), 2);
    std::size_t joined = 0, within = 0;
    for (std::uint32_t i = 0; i < thin.size(); ++i)
      thin.for_triangles_of(i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
        const Vec3 p = thin.at(a) + thin.origin_mm();
        const bool rim = p.head<2>().minCoeff() < 0.3 || p.head<2>().maxCoeff() > 15.5;
        const bool across = thin.at(a).z() != thin.at(b).z() || thin.at(b).z() != thin.at(c).z();
        joined += static_cast<std::size_t>(across && !rim);
        within += static_cast<std::size_t>(!across);
      });
    EXPECT_EQ(joined, 0u) << gap;
    EXPECT_GE(within, 2u * 2u * 79u * 79u - 40u) << gap;
  }
}

/// On a plane the stars are the Delaunay triangulation, but for the border and what had to be settled there:
/// no circle of a triangle holds a point.
TEST(StarMesh, IsDelaunayOnAPlane) {
  Random random(14);
  std::vector<Vec3> points;
  for (int i = 0; i < 3000; ++i)
    points.push_back(Vec3{random.uniform(0.0, 50.0), random.uniform(0.0, 50.0), 0.0});
  const StarMesh mesh = StarMesh::build(cloud_of(points), 2);
  EXPECT_GT(mesh.counts().triangles, 5700u);
  std::size_t wrong = 0;
  for (std::uint32_t i = 0; i < mesh.size(); ++i)
    mesh.for_triangles_of(i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      const Vec3 p = mesh.at(a), u = mesh.at(b) - p, v = mesh.at(c) - p, n = u.cross(v);
      const Vec3 middle =
          p + (u.squaredNorm() * v.cross(n) + v.squaredNorm() * n.cross(u)) / (2.0 * n.squaredNorm());
      const double radius_sq = (middle - p).squaredNorm();
      // The weights that settle lattices move a circle by up to a hundredth of the spacing's square.
      const double slack = 0.05 * 50.0 * 50.0 / 3000.0;
      bool empty = true;
      for (std::uint32_t other = 0; other < mesh.size() && empty; ++other)
        empty = (mesh.at(other) - middle).squaredNorm() > radius_sq - slack || other == a || other == b ||
                other == c;
      const bool inner = mesh.ring(a).open == 0 && mesh.ring(b).open == 0 && mesh.ring(c).open == 0;
      wrong += static_cast<std::size_t>(!empty && inner);
    });
  // Those that were settled by vote need not be.
  EXPECT_LE(wrong, mesh.counts().voted + mesh.counts().welded);
  EXPECT_LT(mesh.counts().voted, 30u);
}

TEST(StarMesh, BordersEndWherePointsEnd) {
  const StarMesh roof = StarMesh::build(cloud_of(random_roof(40000, 15)), 2);
  double longest = 0.0;
  for (std::uint32_t i = 0; i < roof.size(); ++i)
    roof.for_triangles_of(i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t) {
      longest = std::max(longest, (roof.at(a) - roof.at(b)).norm());
    });
  const double spacing = std::sqrt(40.0 * 40.0 * std::sqrt(2.0) / 40000.0);
  EXPECT_LT(longest, 7.0 * spacing);
  EXPECT_EQ(roof.counts().pieces, 1u);
  EXPECT_LT(roof.counts().torn, 20u);
}

TEST(StarMesh, IsTheSameForAnyThreadsAndOrder) {
  for (const Named& cloud : all_clouds()) {
    SCOPED_TRACE(cloud.name);
    if (cloud.name == "pile" || cloud.name == "doubled")
      continue;  // which of the doubles stays follows their order
    const std::vector<Triple> once = triangles_of(StarMesh::build(cloud_of(cloud.points), 1));
    EXPECT_EQ(triangles_of(StarMesh::build(cloud_of(cloud.points), 3)), once);
    std::vector<std::uint32_t> order(cloud.points.size());
    for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
    Random random(16);
    for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random.below(i)]);
    std::vector<Vec3> shuffled;
    for (const std::uint32_t i : order) shuffled.push_back(cloud.points[i]);
    std::vector<Triple> again = triangles_of(StarMesh::build(cloud_of(shuffled), 2));
    for (Triple& t : again) {
      for (std::uint32_t& i : t) i = order[i];
      std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    }
    std::sort(again.begin(), again.end());
    EXPECT_EQ(again, once);
  }
}

TEST(StarMesh, KnowsNoScale) {
  const std::vector<Vec3> points = random_torus(20000, 0.0, 17);
  const std::vector<Triple> once = triangles_of(StarMesh::build(cloud_of(points), 2));
  for (const double scale : {0x1p-20, 0x1p30}) {
    std::vector<Vec3> scaled = points;
    for (Vec3& p : scaled) p *= scale;
    EXPECT_TRUE(triangles_of(StarMesh::build(cloud_of(scaled), 2)) == once) << scale;
  }
  std::vector<Vec3> far = points;
  for (Vec3& p : far) p += Vec3(1e6, -2e6, 5e5);
  const StarMesh moved = StarMesh::build(cloud_of(far), 2);
  EXPECT_EQ(moved.counts().closed_pieces, 1u);
  EXPECT_EQ(moved.counts().open_points, 0u);
}

TEST(StarMesh, FewPointsHaveNoSurface) {
  for (const std::size_t count : {std::size_t{1}, std::size_t{2}}) {
    const std::vector<Vec3> points(count, Vec3(1, 2, 3));
    const StarMesh mesh = StarMesh::build(cloud_of(points), 1);
    EXPECT_EQ(mesh.size(), count);
    EXPECT_EQ(mesh.counts().triangles, 0u);
  }
}

/// Against all pairs: even and uneven, lattices with their ties, an outlier, piles, few points.
TEST(NearPlaces, AreTheNearest) {
  std::vector<Vec3> lattice, far = random_torus(1500, 0.0, 20);
  for (int x = 0; x < 30; ++x)
    for (int y = 0; y < 30; ++y) lattice.emplace_back(0.25 * x, 0.25 * y, 0.0);
  far.emplace_back(1e5, 0.0, 0.0);
  std::vector<Vec3> piled(100, Vec3(1, 2, 3));
  for (const Vec3& p : random_torus(300, 0.0, 21)) piled.push_back(p);
  for (const std::vector<Vec3>& points :
       {random_torus(1500, 0.3, 22), density_step(1500, 23), lattice, far, piled, random_torus(5, 0.0, 24)}) {
    const Places places = sort_places(cloud_of(points), 2);
    const NearPlaces near(places.point, places.doubled, 2);
    std::vector<int> asked(points.size(), 0);
    for (const std::size_t most : {std::size_t{16}, std::size_t{128}}) {
      const auto check = [&](std::uint32_t i, const Nearby& nearby) {
        ++asked[i];
        using Pair = std::pair<float, std::uint32_t>;
        std::vector<Pair> all;
        const Placed& p = places.point[i];
        for (std::uint32_t j = 0; j < places.point.size(); ++j) {
          if (j == i || places.doubled[j] != 0) continue;
          const Placed& q = places.point[j];
          const float x = q.x_mm - p.x_mm, y = q.y_mm - p.y_mm, z = q.z_mm - p.z_mm;
          all.emplace_back(x * x + y * y + z * z, j);
        }
        std::sort(all.begin(), all.end());
        all.resize(std::min(all.size(), most));
        ASSERT_EQ(nearby.size, all.size());
        for (std::size_t k = 0; k < all.size(); ++k) EXPECT_EQ(nearby.place[k], all[k].second);
      };
      near.run(most, {}, 2, [&](std::uint32_t first, unsigned bits, const auto& found) {
        for (std::uint32_t k = 0; k < kBlockPlaces; ++k)
          if ((bits >> k & 1u) != 0) check(first + k, found[k]);
      });
    }
    for (std::size_t i = 0; i < points.size(); ++i) EXPECT_EQ(asked[i], places.doubled[i] != 0 ? 0 : 2);
  }
}

}  // namespace
}  // namespace palpate::stars
