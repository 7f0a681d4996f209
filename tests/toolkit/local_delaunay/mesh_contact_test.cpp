// The contact of a HIP with a star mesh against the obvious slow way: all triangles looked at.
#include "toolkit/local_delaunay/mesh_contact.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/toolkit/local_delaunay/clouds.h"

namespace palpate::local_delaunay {
namespace {

struct Felt {
  explicit Felt(const std::vector<Vec3>& points)
      : mesh(LocalDelaunayMesh::build(cloud_of(points), 2)), tree(BlockBvh::build(mesh, 2)) {
    contact.attach(mesh, tree);
  }
  [[nodiscard]] Vec3 local(const Vec3& p) const { return p - mesh.origin_mm(); }
  LocalDelaunayMesh mesh;
  BlockBvh tree;
  MeshContact contact;
};

/// Every triangle that the open segment goes through, by a test of its own.
int pierced(const LocalDelaunayMesh& mesh, const Vec3& from, const Vec3& to) {
  int count = 0;
  each_triangle(mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    Eigen::Matrix3d m;
    m.col(0) = mesh.at(b) - mesh.at(a);
    m.col(1) = mesh.at(c) - mesh.at(a);
    m.col(2) = from - to;
    if (std::abs(m.determinant()) < 1e-18) return;
    const Vec3 s = m.inverse() * (from - mesh.at(a));
    count += s.x() > 0.0 && s.y() > 0.0 && s.x() + s.y() < 1.0 && s.z() > 0.0 && s.z() < 1.0;
  });
  return count;
}

double nearest_anywhere_sq(const LocalDelaunayMesh& mesh, const Vec3& h) {
  double least = HUGE_VAL;
  each_triangle(mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    least = std::min(least, closest_point_on(Facet(mesh, a, b, c), h).distance_sq);
  });
  return least;
}

TEST(MeshContact, ComesWhereTheWayGoesThroughATriangle) {
  Felt felt(random_torus(3000, 0.0, 21));
  Random random(22);
  int contacts = 0;
  for (int i = 0; i < 3000; ++i) {
    // From outside: short ways near the tube, long ones through everything.
    const double u = random.uniform(0.0, 6.3), v = random.uniform(0.0, 6.3), out = random.uniform(10.5, 13.0);
    const Vec3 from = on_torus(u, v, out);
    const Vec3 way = Vec3{random.normal(), random.normal(), random.normal()} * (i % 3 == 0 ? 20.0 : 1.5);
    felt.contact.reset(felt.local(from));
    ContactCounters counters;
    const bool held = felt.contact.update(felt.local(from + way), counters);
    const int through = pierced(felt.mesh, felt.local(from), felt.local(from + way));
    if (through == 0) {
      EXPECT_FALSE(held) << i;
    } else if (through % 2 == 1) {
      EXPECT_TRUE(held) << i;
    }
    contacts += held;
  }
  EXPECT_GT(contacts, 300);
}

TEST(MeshContact, OnlyDescendsAndStaysTheNearestNearby) {
  struct Case {
    std::vector<Vec3> points;
    Vec3 start, middle;
  };
  const Vec3 above(30, 0, 13), tube(30, 0, 9);
  for (const Case& c :
       {Case{random_torus(20000, 0.0, 23), above, tube},
        Case{random_roof(5000, 24), Vec3(5, 0, 2), Vec3(3, 0, -4)},
        Case{random_torus(20000, 0.1, 25), above, tube}, Case{random_torus(20000, 0.5, 25), above, tube}}) {
    Felt felt(c.points);
    Random random(26);
    Vec3 h = felt.local(c.start);
    felt.contact.reset(h);
    Vec3 velocity = Vec3::Zero(), g = Vec3::Zero();
    int held = 0, nearest = 0;
    bool was = false;
    for (int i = 0; i < 20000; ++i) {
      velocity = 0.95 * velocity + 0.01 * Vec3{random.normal(), random.normal(), random.normal()} -
                 0.0005 * (h - felt.local(c.middle));
      h += velocity;
      ContactCounters counters;
      const bool is = felt.contact.update(h, counters);
      EXPECT_FALSE(felt.contact.bound_hit());
      if (is) {
        const Vec3 now = h + felt.contact.pull();
        if (was) {
          EXPECT_LE((h - now).squaredNorm(), (h - g).squaredNorm() * (1.0 + 1e-12)) << i;
        }
        g = now;
        ++held;
        if (i % 50 == 0)
          nearest += (h - g).squaredNorm() <= nearest_anywhere_sq(felt.mesh, h) * (1.0 + 1e-9) + 1e-18;
      }
      was = is;
    }
    EXPECT_GT(held, 2000);
    EXPECT_GT(nearest, 0);
  }
}

// Around a jump across the model lies more than a frame may look at: the next frames look at parts of it,
// until the HIP is caught up with.
TEST(MeshContact, CatchesUpWithAJump) {
  Felt felt(random_torus(400000, 0.0, 31));
  ContactCounters counters;
  felt.contact.reset(felt.local(Vec3(-50, -50, -20)));
  EXPECT_FALSE(felt.contact.update(felt.local(Vec3(50, 50, 20)), counters));
  EXPECT_TRUE(felt.contact.bound_hit());
  const auto rest = [&](const Vec3& at) {
    for (int i = 0; i < 200; ++i) {
      const bool held = felt.contact.update(felt.local(at), counters);
      if (!felt.contact.bound_hit()) return held;
    }
    ADD_FAILURE() << "not caught up with in 200 frames";
    return false;
  };
  EXPECT_FALSE(rest(Vec3(50, 50, 20)));
  // Into the tube and out of it again, across everything.
  EXPECT_TRUE(rest(Vec3(-30, 0, 0)));
  EXPECT_FALSE(rest(Vec3(-30, 0, 12)));
}

TEST(MeshContact, LetsGoBesideASheet) {
  std::vector<Vec3> sheet;
  Random random(27);
  for (int i = 0; i < 10000; ++i)
    sheet.push_back(Vec3{random.uniform(-10.0, 10.0), random.uniform(-10.0, 10.0), 0.0});
  Felt felt(sheet);
  ContactCounters counters;
  // 0.6 mm beside the border, 0.2 mm below it: three spacings, past any edge there.
  felt.contact.reset(felt.local(Vec3(10.6, 0, 1)));
  EXPECT_FALSE(felt.contact.update(felt.local(Vec3(10.6, 0, -0.2)), counters));
  for (double y = 0.0; y < 5.0; y += 0.05)
    EXPECT_FALSE(felt.contact.update(felt.local(Vec3(10.6, y, -0.2)), counters)) << y;
  // Pressed, then over the border.
  felt.contact.reset(felt.local(Vec3(9, 0, 1)));
  EXPECT_TRUE(felt.contact.update(felt.local(Vec3(9, 0, -0.2)), counters));
  bool held = true;
  for (double x = 9.0; x < 10.8; x += 0.05)
    held = felt.contact.update(felt.local(Vec3(x, 0, -0.2)), counters);
  EXPECT_FALSE(held);
}

// Below the normal numbers a product of a distance vanishes: whoever rests there keeps a side all the same.
TEST(MeshContact, DenormalHeightsHaveASide) {
  std::vector<Vec3> points;
  for (int j = -5; j <= 5; ++j)
    for (int i = -5; i <= 5; ++i) points.emplace_back(0.5 * i, 0.5 * j, 0.0);
  Felt felt(points);
  const double tiny = std::numeric_limits<double>::denorm_min();
  for (const Vec3& at : {Vec3(0, 0, 0), Vec3(0.1, 0.2, 0), Vec3(0.25, 0, 0)})
    for (const double height : {1.0, 3.0, 1e6}) {
      ContactCounters counters;
      const Vec3 hair(0, 0, height * tiny);
      felt.contact.reset(at + Vec3(0, 0, 3));
      // From above to a hair above it, below it, and so again: from there it is free above and held below.
      for (int k = 0; k < 4; ++k) {
        const bool above = k % 2 == 0;
        const Vec3 h = above ? Vec3(at + hair) : Vec3(at - hair);
        EXPECT_FALSE(felt.contact.update(h, counters) && above) << k;
      }
      EXPECT_FALSE(felt.contact.update(at + Vec3(0, 0, 1), counters)) << at.transpose() << " " << height;
      EXPECT_TRUE(felt.contact.update(at - Vec3(0, 0, 0.5), counters));
      EXPECT_GT(felt.contact.pull().z(), 0.0);
    }
}

// A crowd of points in a plane a hundred times as coarse: no triangle joins them, and what is pressed goes
// from the one to the other; an opening as wide in an even plane lets it through.
TEST(MeshContact, CrossesAStepOfDensity) {
  const auto plane = [](double crowd_step) {
    std::vector<Vec3> points;
    for (int j = -20; j <= 20; ++j)
      for (int i = -20; i <= 20; ++i) points.emplace_back(0.5 * i, 0.5 * j, 0.0);
    if (crowd_step > 0.0)
      for (int j = 0; j < 100; ++j)
        for (int i = 0; i < 100; ++i)
          points.emplace_back(-0.248 + crowd_step * i, -0.248 + crowd_step * j, 0.0);
    return points;
  };
  Felt felt(plane(0.005));
  for (const Vec3& way : {Vec3(1, 0.03, 0), Vec3(-0.7, 0.8, 0)}) {
    ContactCounters counters;
    const Vec3 from = -3.0 * way;
    felt.contact.reset(from + Vec3(0, 0, 2));
    ASSERT_TRUE(felt.contact.update(from - Vec3(0, 0, 0.7), counters));
    for (int k = 0; k <= 600; ++k) {
      const Vec3 h = from + 0.01 * k * way - Vec3(0, 0, 0.7);
      ASSERT_TRUE(felt.contact.update(h, counters)) << h.transpose();
      EXPECT_NEAR((h + felt.contact.pull()).z(), 0.0, 1e-12);
    }
  }
}

TEST(MeshContact, SheetsThatCrossHoldTogether) {
  std::vector<Vec3> points;
  for (int i = -30; i <= 30; ++i)
    for (int k = -30; k <= 30; ++k) {
      points.emplace_back(0.2 * (i + 0.5), 0.2 * k, 0.0);
      points.emplace_back(0.0, 0.2 * (k + 0.3), 0.2 * (i + 0.5));
    }
  Felt felt(points);
  EXPECT_EQ(felt.mesh.counts().pieces, 2u);
  Random random(31);
  for (int stroke = 0; stroke < 50; ++stroke) {
    const double y = random.uniform(-4.0, 4.0), side = stroke % 2 == 0 ? 1.0 : -1.0;
    ContactCounters counters;
    Vec3 h(-2.0 * side, y, 1.0);
    felt.contact.reset(felt.local(h));
    const auto go = [&](const Vec3& to) {
      const Vec3 from = h;
      bool held = false;
      for (int i = 1; i <= 100; ++i) {
        h = from + (to - from) * (0.01 * i);
        held = felt.contact.update(felt.local(h), counters);
      }
      return held;
    };
    ASSERT_TRUE(go(Vec3(-2.0 * side, y, -1.0)));
    ASSERT_TRUE(go(Vec3(1.0 * side, y + 0.5, -1.0)));
    EXPECT_EQ(felt.contact.others().size(), 1u);
    EXPECT_LT((h + felt.contact.pull() - Vec3(0.0, y + 0.5, 0.0)).norm(), 1e-6);
    // Up along the wall, which alone holds then, and away from it.
    ASSERT_TRUE(go(Vec3(1.0 * side, y, 1.0)));
    EXPECT_EQ(felt.contact.others().size(), 0u);
    EXPECT_LT((h + felt.contact.pull() - Vec3(0.0, y, 1.0)).norm(), 1e-6);
    EXPECT_FALSE(go(Vec3(-1.0 * side, y, 1.0)));
  }
}

/// A floor of random points ends at a wall of random points, each border as ragged as they are: pressed into
/// the corner from inside, the god object comes to rest there.
TEST(MeshContact, CornersOfRandomPointsHold) {
  constexpr double kSpacing = 0.2, kHalf = 8.0;
  constexpr auto kFloor = static_cast<int>(2.0 * kHalf * kHalf / (kSpacing * kSpacing));
  Random random(36);
  std::vector<Vec3> points;
  for (int i = 0; i < kFloor; ++i) {
    points.push_back(Vec3{random.uniform(-kHalf, 0.0), random.uniform(-kHalf, kHalf), 0.0});
    points.push_back(Vec3{0.0, random.uniform(-kHalf, kHalf), random.uniform(0.0, kHalf)});
  }
  Felt felt(points);
  int resting = 0;
  constexpr int kStrokes = 100;
  for (int stroke = 0; stroke < kStrokes; ++stroke) {
    const double y = random.uniform(-5.0, 5.0), slant = random.uniform(-2.0, 2.0);
    ContactCounters counters;
    felt.contact.reset(felt.local(Vec3(-2.0, y, 1.0)));
    Vec3 h = Vec3::Zero();
    bool held = false;
    for (int i = 1; i <= 400; ++i) {
      const double down = std::min(1.0, i / 120.0), along = std::max(0.0, (i - 120) / 280.0);
      h = Vec3(-2.0 + 3.0 * along, y + slant * along, 1.0 - 2.0 * down);
      held = felt.contact.update(felt.local(h), counters);
    }
    const Vec3 g = h + felt.contact.pull();
    resting += held && std::hypot(g.x(), g.z()) < kSpacing;
  }
  EXPECT_GE(resting, kStrokes * 97 / 100);
}

/// On rough points a god object meets spikes and holes: it neither hangs on these nor falls through those.
TEST(MeshContact, GoesOnOverSpikesAndHoles) {
  for (const double noise : {0.05, 0.1, 0.15}) {
    Felt felt(random_torus(60000, noise, 32));
    Random random(33);
    std::size_t lost = 0, hung = 0, frames = 0;
    for (int stroke = 0; stroke < 60; ++stroke) {
      const double u0 = random.uniform(0.0, 6.28), v0 = random.uniform(0.0, 6.28);
      const double du = random.uniform(-0.3, 0.3), dv = random.uniform(-1.0, 1.0);
      const auto at = [&](double t, double r) {
        const double u = u0 + t * du, v = v0 + t * dv;
        return on_torus(u, v, r);
      };
      ContactCounters counters;
      felt.contact.reset(felt.local(at(0.0, 11.0)));
      for (int i = 0; i <= 50; ++i) (void)felt.contact.update(felt.local(at(0.0, 11.0 - 0.04 * i)), counters);
      for (int i = 0; i <= 400; ++i) {
        const bool held = felt.contact.update(felt.local(at(0.0025 * i, 9.0)), counters);
        ++frames;
        lost += static_cast<std::size_t>(!held);
        hung += static_cast<std::size_t>(held && felt.contact.pull().norm() > 2.0);
      }
    }
    EXPECT_LT(lost, frames / 100) << noise;
    EXPECT_LT(hung, frames / 100) << noise;
  }
}

TEST(MeshContact, MeetsWhatIsTouchedExactly) {
  std::vector<Vec3> lattice;
  for (int x = -8; x <= 8; ++x)
    for (int y = -8; y <= 8; ++y) lattice.emplace_back(x, y, 0);
  Felt felt(lattice);
  ContactCounters counters;
  // On points, on edges, along them and slantwise through them: never past.
  for (const Vec3& start :
       {Vec3(0, 0, 1), Vec3(0.5, 0, 1), Vec3(0.5, 0.5, 1), Vec3(0.25, 0, 1), Vec3(0, 1, 0.5)})
    for (const Vec3& end : {Vec3(0, 0, -1), Vec3(1, 0, -1), Vec3(0.5, 0.5, -1), Vec3(3, 3, -0.5)}) {
      felt.contact.reset(felt.local(start));
      bool held = false;
      for (int k = 1; k <= 8; ++k)
        held = felt.contact.update(felt.local(start + (end - start) * (k / 8.0)), counters);
      EXPECT_TRUE(held) << start.transpose() << " to " << end.transpose();
      EXPECT_NEAR(felt.contact.pull().z(), -felt.local(end).z() + felt.local(Vec3::Zero()).z(), 1e-12);
    }
}

TEST(MeshContact, WorkDoesNotGrowWithThePoints) {
  for (const std::size_t count : {std::size_t{3000}, std::size_t{300000}}) {
    Felt felt(random_torus(count, 0.0, 28));
    felt.contact.reset(felt.local(Vec3(30, 0, 12)));
    ContactCounters counters;
    for (int i = 0; i <= 400; ++i)
      (void)felt.contact.update(felt.local(Vec3(30, 0.02 * i, 12 - 0.01 * i)), counters);
    EXPECT_LT(counters.tested, 20000u) << count;
  }
}

TEST(MeshContact, AWalkInAnyStepsMeetsWhatItGoesThrough) {
  Felt felt(random_torus(3000, 0.0, 31));
  Random random(32);
  int contacts = 0, steps = 0;
  for (int walk = 0; walk < 40; ++walk) {
    // A tenth of the spacing to some spacings a step, to and fro outside: clearances are used up and found.
    const double step = 0.1 * std::pow(40.0, random.uniform());
    const double u = random.uniform(0.0, 6.3), v = random.uniform(0.0, 6.3), out = random.uniform(10.5, 30.0);
    Vec3 at = on_torus(u, v, out);
    felt.contact.reset(felt.local(at));
    ContactCounters counters;
    ASSERT_FALSE(felt.contact.update(felt.local(at), counters));
    Vec3 way(random.normal(), random.normal(), random.normal());
    for (int i = 0; i < 150; ++i, ++steps) {
      way += 0.3 * Vec3{random.normal(), random.normal(), random.normal()};
      // Back to the torus from far away.
      if (at.norm() > 60.0) way = -at;
      const Vec3 to = at + way.normalized() * step;
      const bool through = pierced(felt.mesh, felt.local(at), felt.local(to)) > 0;
      const bool held = felt.contact.update(felt.local(to), counters);
      // One that goes in and out again in a step may come to rest free.
      if (held || !through) {
        ASSERT_EQ(held, through) << "walk " << walk << " step " << i;
      }
      if (through) {
        ++contacts;
        break;
      }
      at = to;
    }
  }
  EXPECT_GT(contacts, 10);
  EXPECT_GT(steps, 1000);
}

TEST(MeshContact, FreeAirIsLookedAtSeldom) {
  Felt felt(random_torus(3000, 0.0, 33));
  // 12 mm above the torus, in steps of 0.05 mm: more than a hundred to the next look.
  const Vec3 from(20.0, 0.0, 22.0), step(0.05, 0.0, 0.0);
  felt.contact.reset(felt.local(from));
  ContactCounters counters;
  for (int i = 1; i <= 1000; ++i) ASSERT_FALSE(felt.contact.update(felt.local(from + i * step), counters));
  EXPECT_GT(counters.blocks, 0u);
  EXPECT_LT(counters.blocks, 20u);
}

}  // namespace
}  // namespace palpate::local_delaunay
