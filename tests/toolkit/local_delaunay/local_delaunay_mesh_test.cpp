// Triangles that the points agree on: each in the rings of its corners, one side a piece, and the same
// whatever the order of the points and the number of threads.
#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <algorithm>

#include "tests/toolkit/local_delaunay/clouds.h"
#include "toolkit/local_delaunay/block_knn.h"
#include "toolkit/local_delaunay/deformable_mesh.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"
#include "toolkit/local_delaunay/mesh_contact.h"

namespace palpate::local_delaunay {
namespace {

TEST(LocalDelaunayMesh, IsSoundOnAnyPoints) {
  for (const Named& cloud : all_clouds()) {
    SCOPED_TRACE(cloud.name);
    expect_sound(LocalDelaunayMesh::build(cloud_of(cloud.points), 2));
  }
}

TEST(LocalDelaunayMesh, OfRandomPointsIsWhole) {
  const LocalDelaunayMesh torus = LocalDelaunayMesh::build(cloud_of(random_torus(100000, 0.0, 11)), 2);
  EXPECT_EQ(torus.counts().pieces, 1u);
  EXPECT_EQ(torus.counts().closed_components, 1u);
  EXPECT_EQ(torus.counts().open_points, 0u);
  EXPECT_EQ(torus.counts().unorientable, 0u);
  // Euler: V - E + F = 0 on a torus, with 2 E = 3 F.
  const std::uint64_t used = torus.size() - torus.counts().welded - torus.counts().unused;
  EXPECT_EQ(torus.counts().triangles, 2 * used);
  EXPECT_LT(torus.counts().unused + torus.counts().welded, torus.size() / 500);
  EXPECT_LT(torus.counts().voted + torus.counts().filled, torus.size() / 500);
}

/// Noise leaves no holes and no tears: what cannot be settled is made without the points in question, few.
TEST(LocalDelaunayMesh, InNoiseIsWhole) {
  for (const double noise : {0.05, 0.1, 0.15}) {
    SCOPED_TRACE(noise);
    const LocalDelaunayMesh torus = LocalDelaunayMesh::build(cloud_of(random_torus(60000, noise, 18)), 2);
    EXPECT_EQ(torus.counts().unorientable, 0u);
    EXPECT_LT(torus.counts().open_points, torus.size() / 1000);
    EXPECT_LT(torus.counts().unused + torus.counts().welded, torus.size() / 200);
  }
}

/// More points at each place than a star looks at: one of each place counts.
TEST(LocalDelaunayMesh, PilesAreOnePointEach) {
  const std::vector<Vec3> once = random_torus(2000, 0.0, 19);
  std::vector<Vec3> piled;
  for (int copy = 0; copy < 40; ++copy) piled.insert(piled.end(), once.begin(), once.end());
  const LocalDelaunayMesh single = LocalDelaunayMesh::build(cloud_of(once), 2),
                          many = LocalDelaunayMesh::build(cloud_of(piled), 2);
  EXPECT_EQ(many.counts().triangles, single.counts().triangles);
  EXPECT_EQ(many.counts().welded, single.counts().welded + 39u * 2000u);
  EXPECT_EQ(many.counts().unused, single.counts().unused);
}

TEST(LocalDelaunayMesh, KeepsSheetsApart) {
  const LocalDelaunayMesh mesh = LocalDelaunayMesh::build(cloud_of(random_spheres({20.0, 19.4}, 0.2, 13)), 2);
  EXPECT_EQ(mesh.counts().closed_components, 2u);
  EXPECT_EQ(mesh.counts().open_points, 0u);
  // An even lattice on both, what a scan of sheet metal is: their borders may be joined, as a plate's rim is,
  // and nothing else.
  for (const double gap : {0.2, 0.25, 0.3}) {
    std::vector<Vec3> sheets;
    for (int x = 0; x < 80; ++x)
      for (int y = 0; y < 80; ++y)
        for (const double z : {0.0, gap}) sheets.emplace_back(0.2 * x, 0.2 * y, z);
    const LocalDelaunayMesh thin = LocalDelaunayMesh::build(cloud_of(sheets), 2);
    std::size_t joined = 0, within = 0;
    each_triangle(thin, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
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
TEST(LocalDelaunayMesh, IsDelaunayOnAPlane) {
  Random random(14);
  std::vector<Vec3> points;
  for (int i = 0; i < 3000; ++i)
    points.push_back(Vec3{random.uniform(0.0, 50.0), random.uniform(0.0, 50.0), 0.0});
  const LocalDelaunayMesh mesh = LocalDelaunayMesh::build(cloud_of(points), 2);
  EXPECT_GT(mesh.counts().triangles, 5700u);
  std::size_t wrong = 0;
  each_triangle(mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
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

TEST(LocalDelaunayMesh, IsTheSameForAnyThreadsAndOrder) {
  for (const Named& cloud : all_clouds()) {
    SCOPED_TRACE(cloud.name);
    if (cloud.name == "pile" || cloud.name == "doubled")
      continue;  // which of the doubles stays follows their order
    const std::vector<Triple> once = triangles_of(LocalDelaunayMesh::build(cloud_of(cloud.points), 1));
    EXPECT_EQ(triangles_of(LocalDelaunayMesh::build(cloud_of(cloud.points), 3)), once);
    Random random(16);
    const std::vector<std::uint32_t> order = shuffled_order(cloud.points.size(), random);
    std::vector<Vec3> shuffled;
    for (const std::uint32_t i : order) shuffled.push_back(cloud.points[i]);
    std::vector<Triple> again = triangles_of(LocalDelaunayMesh::build(cloud_of(shuffled), 2));
    for (Triple& t : again) t = {order[t[0]], order[t[1]], order[t[2]]};
    EXPECT_EQ(in_order(again), once);
  }
}

TEST(LocalDelaunayMesh, KnowsNoScale) {
  const std::vector<Vec3> points = random_torus(20000, 0.0, 17);
  const std::vector<Triple> once = triangles_of(LocalDelaunayMesh::build(cloud_of(points), 2));
  for (const double scale : {0x1p-20, 0x1p30}) {
    std::vector<Vec3> scaled = points;
    for (Vec3& p : scaled) p *= scale;
    EXPECT_TRUE(triangles_of(LocalDelaunayMesh::build(cloud_of(scaled), 2)) == once) << scale;
  }
  std::vector<Vec3> far = points;
  for (Vec3& p : far) p += Vec3(1e6, -2e6, 5e5);
  const LocalDelaunayMesh moved = LocalDelaunayMesh::build(cloud_of(far), 2);
  EXPECT_EQ(moved.counts().closed_components, 1u);
  EXPECT_EQ(moved.counts().open_points, 0u);
}

/// Against all pairs: even and uneven, lattices with their ties, an outlier, piles, few points.
TEST(BlockKnn, AreTheNearest) {
  std::vector<Vec3> lattice, far = random_torus(1500, 0.0, 20);
  for (int x = 0; x < 30; ++x)
    for (int y = 0; y < 30; ++y) lattice.emplace_back(0.25 * x, 0.25 * y, 0.0);
  far.emplace_back(1e5, 0.0, 0.0);
  std::vector<Vec3> piled(100, Vec3(1, 2, 3));
  for (const Vec3& p : random_torus(300, 0.0, 21)) piled.push_back(p);
  for (const std::vector<Vec3>& points :
       {random_torus(1500, 0.3, 22), density_step(1500, 23), lattice, far, piled, random_torus(5, 0.0, 24)}) {
    const SortedPoints places = spatial_sort(cloud_of(points), 2);
    const BlockKnn near(places.point, places.duplicate, 2);
    std::vector<int> asked(points.size(), 0);
    for (const std::size_t most : {std::size_t{16}, std::size_t{128}}) {
      const auto check = [&](std::uint32_t i, const KnnResult& nearby) {
        ++asked[i];
        using Pair = std::pair<float, std::uint32_t>;
        std::vector<Pair> all;
        const SortedPoint& p = places.point[i];
        for (std::uint32_t j = 0; j < places.point.size(); ++j) {
          if (j == i || places.duplicate[j] != 0) continue;
          const SortedPoint& q = places.point[j];
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
    for (std::size_t i = 0; i < points.size(); ++i) EXPECT_EQ(asked[i], places.duplicate[i] != 0 ? 0 : 2);
  }
}

// Star meshes whose points move: sound after any splits, the same to the bit when they are taken back, with a
// tree that finds what a new one would, and a contact that a moving surface meets.

struct Moving {
  Moving(const std::vector<Vec3>& points, std::size_t spare)
      : mesh(LocalDelaunayMesh::build(cloud_of(points), 2)), stars(mesh, tree, spare, 2) {}
  LocalDelaunayMesh mesh;
  BlockBvh tree;
  DeformableMesh stars;
};

std::vector<Named> clouds() {
  return {{"torus", random_torus(3000, 0.0, 31)},
          {"noisy torus", random_torus(3000, 0.2, 32)},  // long rings, gaps
          {"shells", random_spheres({10.0, 9.6}, 0.5, 33)},
          {"roof", random_roof(2000, 34)},
          {"step", density_step(3000, 35)},
          {"three", {Vec3(1, 1, 1), Vec3(2, 1, 1), Vec3(1, 2, 1)}}};
}

/// Rings and places of a mesh, to be compared.
struct Written {
  std::vector<std::vector<std::uint32_t>> ring;
  std::vector<std::uint32_t> open;
  std::vector<Vec3> at;
  explicit Written(const LocalDelaunayMesh& mesh) {
    for (std::uint32_t i = 0; i < mesh.size(); ++i) {
      const Ring r = mesh.ring(i);
      ring.emplace_back(r.of, r.of + r.size);
      open.push_back(r.open);
      at.push_back(mesh.at(i));
    }
  }
};

/// A place that some triangle has, or any.
std::uint32_t random_place(const DeformableMesh& stars, Random& random) {
  for (int i = 0; i < 100; ++i) {
    const auto place = static_cast<std::uint32_t>(random.below(stars.used()));
    if (stars.mesh().ring(place).size > 0) return place;
  }
  return 0;
}

TEST(DeformableMesh, StaySoundAndComeBackToTheBit) {
  for (const Named& cloud : clouds()) {
    SCOPED_TRACE(cloud.name);
    Moving moving(cloud.points, 4000);
    const LocalDelaunayMesh built = LocalDelaunayMesh::build(cloud_of(cloud.points), 2);
    const Written before(moving.mesh), as_built(built);
    ASSERT_GE(before.ring.size(), as_built.ring.size());
    for (std::size_t i = 0; i < as_built.ring.size(); ++i) {
      ASSERT_EQ(before.ring[i], as_built.ring[i]) << i;
      ASSERT_EQ(before.open[i], as_built.open[i]) << i;
    }
    Random random(36);
    std::vector<Vec3> from;
    std::vector<std::uint32_t> moved;
    const std::uint64_t triangles = expect_rings_sound(moving.mesh);
    std::uint64_t made = 0;
    // Some places are split again and again, so that rings outgrow their rows.
    const std::uint32_t hub = random_place(moving.stars, random);
    for (int i = 0; i < 3000; ++i) {
      const std::uint32_t a = i % 4 == 0 ? hub : random_place(moving.stars, random);
      const Ring ring = moving.mesh.ring(a);
      if (ring.size == 0) continue;
      const std::uint32_t b = ring.of[random.below(ring.size)];
      const std::uint32_t k = ring.find(b);
      const int sides = ring.has_sector(k) + ring.has_sector(ring.previous(k));
      const std::uint32_t place = moving.stars.split(a, b);
      if (place == kNoPlace) continue;
      EXPECT_EQ(moving.stars.parents(place), (std::array<std::uint32_t, 2>{a, b}));
      made += static_cast<std::uint64_t>(sides);
    }
    EXPECT_GT(made, cloud.name == "three" ? 10u : 2000u);
    EXPECT_EQ(expect_rings_sound(moving.mesh), triangles + made);
    while (moving.stars.used() > moving.stars.built()) moving.stars.undo_split();
    EXPECT_EQ(expect_rings_sound(moving.mesh), triangles);
    const Written after(moving.mesh);
    for (std::size_t i = 0; i < moving.stars.built(); ++i) {
      ASSERT_EQ(after.ring[i], before.ring[i]) << i;
      ASSERT_EQ(after.open[i], before.open[i]) << i;
    }
    for (std::size_t i = moving.stars.built(); i < after.ring.size(); ++i) ASSERT_TRUE(after.ring[i].empty());
  }
}

TEST(DeformableMesh, ASplitDividesItsTrianglesInPlace) {
  Moving moving(random_torus(2000, 0.0, 37), 100);
  const auto area = [&] {
    double sum = 0.0;
    each_triangle(moving.mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      sum += Facet(moving.mesh, a, b, c).area_normal().norm();
    });
    return sum;
  };
  const double before = area();
  Random random(38);
  for (int i = 0; i < 100; ++i) {
    const std::uint32_t a = random_place(moving.stars, random);
    EXPECT_NE(moving.stars.split(a, moving.mesh.ring(a).of[0]), kNoPlace);
  }
  EXPECT_EQ(moving.stars.split(0, moving.mesh.ring(0).of[0]), kNoPlace) << "no place is left";
  EXPECT_NEAR(area(), before, 1e-6 * before);
}

std::vector<std::uint32_t> blocks_in(const BlockBvh& tree, const geometry::Aabb& box) {
  std::vector<std::uint32_t> blocks;
  EXPECT_TRUE(
      tree.for_blocks(box, kMaxNodes, [&](std::uint32_t block, const BvhNode&, std::uint32_t) noexcept {
        blocks.push_back(block);
        return true;
      }));
  return blocks;
}

/// Every triangle in a box is in one of the blocks, and in its block's layer.
void expect_found(const Moving& moving, const geometry::Aabb& box) {
  const std::vector<std::uint32_t> blocks = blocks_in(moving.tree, box);
  each_triangle(moving.mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (moving.mesh.triangle_misses(a, b, c, FloatBox::around(box))) return;
    const std::uint32_t block = a / kBlockPlaces;
    EXPECT_TRUE(std::find(blocks.begin(), blocks.end(), block) != blocks.end()) << a;
    for (const std::uint32_t corner : {a, b, c})
      EXPECT_FALSE(moving.tree.layer(block).misses(moving.mesh.at(corner), moving.mesh.at(corner))) << a;
  });
}

void expect_as_new(const Moving& moving, const geometry::Aabb& box) {
  const BlockBvh fresh = BlockBvh::build(moving.mesh, 2);
  const std::vector<std::uint32_t> blocks = blocks_in(moving.tree, box);
  EXPECT_EQ(blocks, blocks_in(fresh, box));
  for (const std::uint32_t block : blocks) {
    EXPECT_EQ(moving.tree.layer(block).normal, fresh.layer(block).normal);
    EXPECT_EQ(moving.tree.layer(block).low, fresh.layer(block).low);
    EXPECT_EQ(moving.tree.layer(block).high, fresh.layer(block).high);
  }
}

// With few changes a round, and with many more than a refit makes anew.
TEST(DeformableMesh, TheTreeFindsWhatANewOneFinds) {
  for (const Named& cloud : clouds())
    for (const int changes : {60, 3000}) {
      SCOPED_TRACE(cloud.name);
      Moving moving(cloud.points, 1000);
      Random random(39);
      const auto somewhere = [&] {
        const Vec3 middle = moving.mesh.at(random_place(moving.stars, random)),
                   half = Vec3::Constant(random.uniform(0.0, 2.0));
        return geometry::Aabb{middle - half, middle + half};
      };
      for (int round = 0; round < 12; ++round) {
        for (int i = 0; i < changes; ++i) {
          const std::uint32_t a = random_place(moving.stars, random);
          const Ring ring = moving.mesh.ring(a);
          if (ring.size > 0 && i % 3 == 0) (void)moving.stars.split(a, ring.of[random.below(ring.size)]);
          const Vec3 by{random.normal(), random.normal(), random.normal()};
          moving.stars.set(a, (moving.mesh.at(a) + (round % 5 == 0 ? 20.0 : 0.3) * by).cast<float>());
        }
        if (round % 4 == 3)
          for (int i = 0; i < 40 && moving.stars.used() > moving.stars.built(); ++i)
            moving.stars.undo_split();
        moving.stars.refit();
        for (int i = 0; i < 5; ++i) expect_found(moving, somewhere());
        if (round % 3 != 2) continue;  // what waits for its turn waits on
        moving.stars.refit_all();
        for (int i = 0; i < 5; ++i) expect_as_new(moving, somewhere());
      }
    }
}

/// Solid angle of the whole mesh: 4 pi inside of a closed one.
double around(const LocalDelaunayMesh& mesh, const Vec3& h) {
  double sum = 0.0;
  each_triangle(mesh, [&](std::uint32_t p, std::uint32_t q, std::uint32_t r) {
    const Vec3 a = mesh.at(p) - h, b = mesh.at(q) - h, c = mesh.at(r) - h;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    sum += 2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  });
  return sum;
}

// Every point goes its own way, in any order, edges are split in between: a HIP that rests is in contact
// where it is inside in the end.
TEST(DeformableMesh, MeetARestingHip) {
  Random random(40);
  int met = 0, stayed = 0;
  for (int run = 0; run < 150; ++run) {
    Moving moving(random_spheres({10.0}, 1.0, 41 + static_cast<std::uint64_t>(run % 4)), 50);
    ASSERT_EQ(moving.mesh.counts().closed_components, 1u);
    MeshContact contact;
    contact.attach(moving.mesh, moving.tree);
    const Vec3 d = Vec3{random.normal(), random.normal(), random.normal()}.normalized();
    const Vec3 h = (10.0 + random.uniform(0.1, 1.5)) * d - moving.mesh.origin_mm();
    contact.reset(h);
    ContactCounters counters;
    ASSERT_FALSE(contact.update(h, counters));
    const std::vector<std::uint32_t> order = shuffled_order(moving.stars.built(), random);
    const double phase = random.uniform(0.0, 6.3), depth = random.uniform(0.3, 1.2);
    for (int stage = 0; stage < 3; ++stage) {
      for (const std::uint32_t place : order) {
        const Vec3 from = moving.mesh.at(place), out = (from + moving.mesh.origin_mm()).normalized();
        const double by = depth * std::sin(3.0 * out.x() + phase) * std::cos(2.0 * out.y() + out.z());
        const Vec3f to = (from + out * by).cast<float>();
        moving.stars.set(place, to);
        contact.point_moved(place, from, moving.mesh.at(place));
      }
      const std::uint32_t a = random_place(moving.stars, random);
      (void)moving.stars.split(a, moving.mesh.ring(a).of[0]);
      moving.stars.refit();
      contact.points_moved([](std::uint32_t place) { return place; });
      const double angle = around(moving.mesh, h);
      const bool inside = std::abs(angle) > 2.0 * M_PI;
      const bool held = contact.update(h, counters);
      EXPECT_EQ(held, inside) << run << ", stage " << stage;
      met += held;
      stayed += !held;
    }
  }
  EXPECT_GT(met, 30);
  EXPECT_GT(stayed, 50);
}

}  // namespace
}  // namespace palpate::local_delaunay
