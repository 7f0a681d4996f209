// Dents in surfaces of stars, of points that no lattice orders.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "tests/toolkit/local_delaunay/clouds.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/deformation/deformed_local_delaunay.h"
#include "toolkit/deformation/deformer.h"

namespace palpate::deformation {

using namespace render;

namespace {

constexpr double kDentDt = 1e-3;

SceneInput yielding(const std::vector<Vec3>& points, const surface::Dent& dent) {
  SceneInput scene = cloud_of(points);
  scene.models[0].surface.dent = dent;
  return scene;
}

/// At random over a square, flat.
std::vector<Vec3> random_sheet(double half, double spacing, double z, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points;
  const auto count = static_cast<std::size_t>(4.0 * half * half / (spacing * spacing));
  for (std::size_t i = 0; i < count; ++i)
    points.push_back(Vec3{random.uniform(-half, half), random.uniform(-half, half), z});
  return points;
}

struct Moving {
  Moving(const std::vector<Vec3>& points, DeformerCapacity room)
      : mesh(local_delaunay::LocalDelaunayMesh::build(local_delaunay::cloud_of(points), 2)),
        moving(mesh, tree, surface, room.spare_points, 2),
        deformer(moving, room.journal_points) {}
  local_delaunay::LocalDelaunayMesh mesh;
  local_delaunay::BlockBvh tree;
  SurfaceField surface;  // the same everywhere: no value for each point
  DeformedLocalDelaunay moving;
  Deformer deformer;
};

/// The place of a triangle that is nearest to the origin.
std::uint32_t middle_of(const local_delaunay::LocalDelaunayMesh& mesh, std::size_t places) {
  std::uint32_t middle = 0;
  for (std::uint32_t i = 0; i < places; ++i)
    if (mesh.at(i).norm() < mesh.at(middle).norm() && mesh.ring(i).size > 0) middle = i;
  return middle;
}

TEST(StarDent, ThousandsOfChangesAreUndoneToTheBit) {
  for (const std::vector<Vec3>& points :
       {local_delaunay::random_torus(5000, 0.0, 51), local_delaunay::random_torus(5000, 0.15, 52),
        local_delaunay::random_roof(4000, 53), local_delaunay::density_step(5000, 54)}) {
    Moving moving(points, {1500, 200000});
    const auto all = [&] {
      std::vector<Vec3> at;
      for (std::uint32_t i = 0; i < moving.deformer.points(); ++i) at.push_back(moving.mesh.at(i));
      return at;
    };
    const std::vector<Vec3> first = all();
    const std::uint64_t triangles = local_delaunay::expect_rings_sound(moving.mesh);
    Random random(55);
    for (int round = 0; round < 30; ++round) {
      moving.deformer.begin_stroke();
      const std::vector<Vec3> before = all();
      for (int i = 0; i < 100; ++i) {
        const auto place = static_cast<std::uint32_t>(random.below(moving.deformer.points()));
        const Vec3 d = Vec3{random.normal(), random.normal(), random.normal()}.normalized();
        for (int k = 0; k < 4; ++k)
          (void)moving.deformer.press(place, d, random.uniform(0.0, 0.8), random.uniform(1.0, 5.0));
        if (i % 10 != 0) continue;
        MoveBatch batch;
        for (; batch.count < 200; ++batch.count) {
          batch.point[batch.count] = static_cast<std::uint32_t>(random.below(points.size()));
          batch.to_mm[batch.count] = (moving.mesh.at(moving.moving.place_of(batch.point[batch.count])) +
                                      0.3 * Vec3{random.normal(), random.normal(), random.normal()})
                                         .cast<float>();
        }
        EXPECT_EQ(moving.deformer.apply(batch), 200u);
      }
      const std::uint64_t added = moving.deformer.points() - first.size();
      const std::uint64_t now = local_delaunay::expect_rings_sound(moving.mesh);
      EXPECT_LE(now, triangles + 2 * added);
      EXPECT_GE(now, triangles + added);
      if (round % 3 == 0) continue;
      ASSERT_TRUE(moving.deformer.undo());
      const std::vector<Vec3> after = all();
      ASSERT_EQ(after.size(), before.size());
      for (std::size_t i = 0; i < after.size(); ++i) ASSERT_EQ(after[i], before[i]) << i;
    }
    EXPECT_GT(moving.deformer.points(), first.size());
    while (moving.deformer.undo()) {
    }
    moving.deformer.reset();
    EXPECT_EQ(local_delaunay::expect_rings_sound(moving.mesh), triangles);
    EXPECT_EQ(all(), first);
  }
}

// No edge stays longer than what is split, where there was time and room to split it.
TEST(StarDent, StretchedEdgesGetPoints) {
  Moving moving(random_sheet(10.0, 0.4, 0.0, 56), {20000, 0});
  const std::uint32_t middle = middle_of(moving.mesh, moving.deformer.points());
  for (int i = 0; i < 600; ++i) (void)moving.deformer.press(middle, Vec3::UnitZ(), 0.01, 2.5);  // 6 mm deep
  EXPECT_GT(moving.deformer.counters().inferred, 50u);
  double longest = 0.0, deepest = 0.0;
  local_delaunay::each_triangle(moving.mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t) {
    const Vec3 p = moving.mesh.at(a), q = moving.mesh.at(b);
    if (std::max(p.head<2>().norm(), q.head<2>().norm()) > 2.5) return;
    longest = std::max(longest, (p - q).norm());
    deepest = std::min({deepest, p.z(), q.z()});
  });
  EXPECT_LT(deepest, -5.9);
  EXPECT_LT(longest, 5.0 * 0.4) << "the walls are stretched more than fivefold";
  local_delaunay::expect_rings_sound(moving.mesh);
}

/// Held at a depth until nothing changes: the surface bears what its yield says, however the points lie.
TEST(StarDent, GivesWayDownToItsYield) {
  Random random(57);
  for (int run = 0; run < 6; ++run) {
    const auto renderer = prepared(
        yielding(random_sheet(10.0, 0.4, 0.0, 58 + static_cast<std::uint64_t>(run % 3)), {0.4, 3.0, 50.0}),
        "cloud");
    const Vec3 top{random.uniform(-4, 4), random.uniform(-4, 4), 0.5};
    renderer->restart(top);
    const double depth = random.uniform(0.6, 2.5);
    Frame frame;
    for (int i = 0; i < 2500; ++i)
      frame = renderer->step(top - Vec3(0, 0, (0.5 + depth) * std::min(1.0, i / 500.0)), kDentDt);
    ASSERT_TRUE(frame.contact);
    EXPECT_NEAR(frame.force_n.norm(), 0.5 * 0.4, 0.5 * 0.4 * 0.02) << run;
    EXPECT_GT(frame.force_n.z(), 0.9 * frame.force_n.norm()) << run;
  }
}

// Pressed and dragged over a body of random points: what pushes is the surface as it is now, outwards, and
// never for longer than the probe is in it.
TEST(StarDent, IsFeltWhereThePointsAre) {
  const std::vector<Vec3> points = local_delaunay::random_torus(20000, 0.0, 59);
  const double spacing = std::sqrt(4.0 * std::numbers::pi * std::numbers::pi * 300.0 / 20000.0);
  const SceneInput scene = yielding(points, {0.4, 3.0, 30.0});
  const auto renderer = prepared(scene, "cloud");
  auto& editable = dynamic_cast<Editable&>(*renderer);
  Random random(60);
  int wrong = 0, lost = 0, inward = 0, held = 0;
  for (int run = 0; run < 12; ++run) {
    const double u = random.uniform(0.0, 6.28), v = random.uniform(0.0, 6.28),
                 along = random.uniform(0.2, 0.6);
    const auto at = [&](double out, double way) {
      const double w = v + along * way;
      return local_delaunay::on_torus(u, w, out);
    };
    if (run == 0) renderer->restart(at(11.0, 0.0));
    renderer->release_contact(at(11.0, 0.0));
    constexpr int kFrames = 1500;
    for (int i = 0; i <= kFrames; ++i) {
      const double t = static_cast<double>(i) / kFrames;
      const Vec3 h = at(11.0 - 4.0 * std::sin(std::numbers::pi * t), t);
      const Frame frame = renderer->step(h, kDentDt);
      if (!frame.contact) continue;
      ++held;
      const Vec3 axis = at(0.0, t);
      inward += frame.force_n.dot(h - axis) < -1e-9;
      if (i % 50 != 0) continue;
      const cloud::Cloud now = editable.edited(0).value();
      double nearest = HUGE_VAL;
      for (std::size_t k = 0; k < now.size(); ++k) nearest = std::min(nearest, (now.point_mm(k) - h).norm());
      wrong += std::abs(frame.force_n.norm() / 0.5 - nearest) > spacing;
    }
    lost += renderer->step(at(11.0, 1.0), kDentDt).contact;
  }
  EXPECT_GT(held, 3000);
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(inward, 0);
  EXPECT_EQ(lost, 0);
  EXPECT_GT(editable.deform_counters(0).moved, 10000u);
}

TEST(StarDent, AtABorderTheProbeComesFree) {
  Random random(61);
  for (std::uint64_t run = 0; run < 15; ++run) {
    const auto renderer =
        prepared(yielding(random_sheet(8.0, 0.3, 0.0, 62 + run), {0.3, 2.0, 40.0}), "cloud");
    auto& editable = dynamic_cast<Editable&>(*renderer);
    const double y = random.uniform(-5, 5), x = random.uniform(7.2, 7.8);
    renderer->restart(Vec3(x, y, 1));
    int wrong = 0, touched = 0;
    Frame frame;
    for (int i = 0; i <= 600; ++i) {
      frame = renderer->step(Vec3(x, y, 1.0 - 2.5 * i / 600.0), kDentDt);
      touched += frame.contact;
      wrong += frame.contact && !(frame.force_n.z() >= 0.0);
    }
    EXPECT_GT(touched, 50) << run;
    EXPECT_EQ(wrong, 0) << run;
    // Out over the border: what stands there of the dent's wall holds it like one, and is not dragged along.
    constexpr double kWay = 5.0;
    for (int i = 0; i <= 1000; ++i) frame = renderer->step(Vec3(x + kWay * i / 1000.0, y, -1.5), kDentDt);
    EXPECT_FALSE(frame.contact) << run;
    const cloud::Cloud now = editable.edited(0).value();
    for (std::size_t i = 0; i < now.size(); ++i) ASSERT_LT(now.point_mm(i).x(), 8.1) << run;
    EXPECT_TRUE(editable.undo(0));
    frame = renderer->step(Vec3(x + kWay, y, -1.5), kDentDt);
    EXPECT_FALSE(frame.contact) << run << ": nothing moved over it there";
  }
}

// A plate 0.8 mm thick, pressed 3 mm deep: its upper sheet goes through the lower one, the probe with it.
TEST(StarDent, StaysWithItsSheetOfAThinPlate) {
  Scene scene = generated("slab:points=20000:thickness_mm=0.8:extent_mm=20");
  scene.input.models[0].surface.dent = {0.3, 3.0, 40.0};
  Random random(63);
  for (int run = 0; run < 10; ++run) {
    const auto renderer = prepared(scene.input, "cloud");
    const geometry::Aabb box = scene.surface->box_mm();
    const double side = run % 2 == 0 ? 1.0 : -1.0;
    const double face = side > 0.0 ? box.high_mm.z() : box.low_mm.z();
    const Vec3 top{random.uniform(-5, 5), random.uniform(-5, 5), face + side};
    renderer->restart(top);
    int wrong = 0, held = 0;
    bool before = false, lost = false;
    for (int i = 0; i <= 1000; ++i) {
      const Frame frame = renderer->step(
          top + Vec3(0.5 * std::sin(0.02 * i), 0.5 * std::cos(0.02 * i), -side * 4.0 * i / 1000.0), kDentDt);
      wrong += frame.contact && !(frame.force_n.z() * side > 0.0);
      lost |= before && !frame.contact;
      before = frame.contact;
      held += frame.contact;
    }
    EXPECT_GT(held, 500);
    EXPECT_EQ(wrong, 0) << run;
    EXPECT_FALSE(lost) << run;
    dynamic_cast<Editable&>(*renderer).restore(0);
    const Frame frame = renderer->step(top - Vec3(0, 0, side * 3.0), 0.0);
    EXPECT_TRUE(frame.contact);
    EXPECT_GT(frame.force_n.z() * side, 0.0);
  }
}

struct Felt {
  std::vector<Vec3> force;
  std::vector<bool> contact;
};
/// In and across and out again, with `scale` mm for each.
Felt felt(const std::vector<Vec3>& points, double scale, int threads) {
  std::vector<Vec3> scaled = points;
  for (Vec3& p : scaled) p *= scale;
  SceneInput scene = yielding(scaled, {0.4 * scale, 3.0 * scale, 30.0 * scale});
  const auto renderer = prepared(scene, "cloud", threads);
  Felt out;
  renderer->restart(scale * Vec3(30, 0, 12));
  for (int i = 0; i <= 1500; ++i) {
    const double t = i / 1500.0;
    const Frame frame = renderer->step(
        scale * Vec3(30.0 + 3.0 * std::sin(7.0 * t), 5.0 * t, 12.0 - 5.0 * std::sin(std::numbers::pi * t)),
        kDentDt);
    out.force.push_back(frame.force_n / scale);
    out.contact.push_back(frame.contact);
  }
  return out;
}

TEST(StarDent, IsTheSameForAnyThreadsAndScale) {
  const std::vector<Vec3> points = local_delaunay::random_torus(20000, 0.0, 64);
  const Felt once = felt(points, 1.0, 1);
  EXPECT_GT(std::count(once.contact.begin(), once.contact.end(), true), 500);
  for (const auto& [scale, threads] : {std::pair{1.0, 3}, std::pair{0x1p-10, 2}, std::pair{0x1p20, 2}}) {
    const Felt again = felt(points, scale, threads);
    EXPECT_EQ(again.contact, once.contact) << scale;
    EXPECT_TRUE(again.force == once.force) << scale << ", " << threads;
  }
}

/// Stiffness that varies is as it was along a split edge.
TEST(StarDent, NewPointsHaveTheStiffnessBetween) {
  const std::vector<Vec3> points = random_sheet(10.0, 0.4, 0.0, 65);
  Moving moving(points, {1000, 0});
  SurfaceField field;
  local_delaunay::LocalDelaunayMesh mesh =
      local_delaunay::LocalDelaunayMesh::build(local_delaunay::cloud_of(points), 1);
  local_delaunay::BlockBvh tree;
  for (std::uint32_t i = 0; i < mesh.size(); ++i)
    field.by_point.push_back({static_cast<float>(1.0 + 0.01 * mesh.at(i).x()), 0.5f, 0.4f});
  DeformedLocalDelaunay stars(mesh, tree, field, 1000, 1);
  Deformer deformer(stars, 0);
  const std::uint32_t middle = middle_of(mesh, stars.built());
  for (int i = 0; i < 200; ++i) (void)deformer.press(middle, Vec3::UnitZ(), 0.02, 2.5);
  ASSERT_GT(stars.used(), stars.built() + 20);
  for (std::uint32_t i = stars.built(); i < stars.used(); ++i)
    EXPECT_NEAR(static_cast<double>(field.by_point[i].stiffness_n_per_mm),
                1.0 + 0.01 * stars.initial_position(i).x(), 1e-5);
}

}  // namespace
}  // namespace palpate::deformation
