// Star meshes whose points move: sound after any splits, the same to the bit when they are taken back, with a
// tree that finds what a new one would, and a contact that a moving surface meets.
#include "toolkit/stars/moving_stars.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <string>

#include "tests/toolkit/stars/clouds.h"
#include "tests/toolkit/stars/sound.h"
#include "toolkit/stars/star_contact.h"

namespace palpate::stars {
namespace {

struct Moving {
  Moving(const std::vector<Vec3>& points, std::size_t spare)
      : mesh(StarMesh::build(cloud_of(points), 2)), stars(mesh, tree, spare, 2) {}
  StarMesh mesh;
  StarTree tree;
  MovingStars stars;
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
  explicit Written(const StarMesh& mesh) {
    for (std::uint32_t i = 0; i < mesh.size(); ++i) {
      const Ring r = mesh.ring(i);
      ring.emplace_back(r.of, r.of + r.size);
      open.push_back(r.open);
      at.push_back(mesh.at(i));
    }
  }
};

/// A place that some triangle has, or any.
std::uint32_t random_place(const MovingStars& stars, Random& random) {
  for (int i = 0; i < 100; ++i) {
    const auto place = static_cast<std::uint32_t>(random.below(stars.used()));
    if (stars.mesh().ring(place).size > 0) return place;
  }
  return 0;
}

TEST(MovingStars, StaySoundAndComeBackToTheBit) {
  for (const Named& cloud : clouds()) {
    SCOPED_TRACE(cloud.name);
    Moving moving(cloud.points, 4000);
    const StarMesh built = StarMesh::build(cloud_of(cloud.points), 2);
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
    while (moving.stars.used() > moving.stars.built()) moving.stars.join_last();
    EXPECT_EQ(expect_rings_sound(moving.mesh), triangles);
    const Written after(moving.mesh);
    for (std::size_t i = 0; i < moving.stars.built(); ++i) {
      ASSERT_EQ(after.ring[i], before.ring[i]) << i;
      ASSERT_EQ(after.open[i], before.open[i]) << i;
    }
    for (std::size_t i = moving.stars.built(); i < after.ring.size(); ++i) ASSERT_TRUE(after.ring[i].empty());
  }
}

TEST(MovingStars, ASplitDividesItsTrianglesInPlace) {
  Moving moving(random_torus(2000, 0.0, 37), 100);
  const auto area = [&] {
    double sum = 0.0;
    for (std::uint32_t i = 0; i < moving.mesh.size(); ++i)
      moving.mesh.for_triangles_of(i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
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

std::vector<std::uint32_t> blocks_in(const StarTree& tree, const geometry::Aabb& box) {
  std::vector<std::uint32_t> blocks;
  EXPECT_TRUE(
      tree.for_blocks(box, kMaxNodes, [&](std::uint32_t block, const BoxNode&, std::uint32_t) noexcept {
        blocks.push_back(block);
        return true;
      }));
  return blocks;
}

/// Every triangle in a box is in one of the blocks, and in its block's layer.
void expect_found(const Moving& moving, const geometry::Aabb& box) {
  const std::vector<std::uint32_t> blocks = blocks_in(moving.tree, box);
  for (std::uint32_t place = 0; place < moving.mesh.size(); ++place)
    moving.mesh.for_triangles_of(place, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      if (moving.mesh.triangle_misses(a, b, c, FloatBox::around(box))) return;
      const std::uint32_t block = a / kBlockPlaces;
      EXPECT_TRUE(std::find(blocks.begin(), blocks.end(), block) != blocks.end()) << a;
      for (const std::uint32_t corner : {a, b, c})
        EXPECT_FALSE(moving.tree.layer(block).misses(moving.mesh.at(corner), moving.mesh.at(corner))) << a;
    });
}

void expect_as_new(const Moving& moving, const geometry::Aabb& box) {
  const StarTree fresh = StarTree::build(moving.mesh, 2);
  const std::vector<std::uint32_t> blocks = blocks_in(moving.tree, box);
  EXPECT_EQ(blocks, blocks_in(fresh, box));
  for (const std::uint32_t block : blocks) {
    EXPECT_EQ(moving.tree.layer(block).normal, fresh.layer(block).normal);
    EXPECT_EQ(moving.tree.layer(block).low, fresh.layer(block).low);
    EXPECT_EQ(moving.tree.layer(block).high, fresh.layer(block).high);
  }
}

// With few changes a round, and with many more than a refit makes anew.
TEST(MovingStars, TheTreeFindsWhatANewOneFinds) {
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
          for (int i = 0; i < 40 && moving.stars.used() > moving.stars.built(); ++i) moving.stars.join_last();
        moving.stars.refit();
        for (int i = 0; i < 5; ++i) expect_found(moving, somewhere());
        if (round % 3 != 2) continue;  // what waits for its turn waits on
        moving.stars.refit_all();
        for (int i = 0; i < 5; ++i) expect_as_new(moving, somewhere());
      }
    }
}

/// Solid angle of the whole mesh: 4 pi inside of a closed one.
double around(const StarMesh& mesh, const Vec3& h) {
  double sum = 0.0;
  for (std::uint32_t i = 0; i < mesh.size(); ++i)
    mesh.for_triangles_of(i, [&](std::uint32_t p, std::uint32_t q, std::uint32_t r) {
      const Vec3 a = mesh.at(p) - h, b = mesh.at(q) - h, c = mesh.at(r) - h;
      const double la = a.norm(), lb = b.norm(), lc = c.norm();
      sum +=
          2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
    });
  return sum;
}

// Every point goes its own way, in any order, edges are split in between: a HIP that rests is in contact
// where it is inside in the end.
TEST(MovingStars, MeetARestingHip) {
  Random random(40);
  int met = 0, stayed = 0;
  for (int run = 0; run < 150; ++run) {
    Moving moving(random_spheres({10.0}, 1.0, 41 + static_cast<std::uint64_t>(run % 4)), 50);
    ASSERT_EQ(moving.mesh.counts().closed_pieces, 1u);
    StarContact contact;
    contact.attach(moving.mesh, moving.tree);
    const Vec3 d = Vec3{random.normal(), random.normal(), random.normal()}.normalized();
    const Vec3 h = (10.0 + random.uniform(0.1, 1.5)) * d - moving.mesh.origin_mm();
    contact.reset(h);
    StarCounters counters;
    ASSERT_FALSE(contact.update(h, counters));
    std::vector<std::uint32_t> order(moving.stars.built());
    for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
    for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random.below(i)]);
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
}  // namespace palpate::stars
