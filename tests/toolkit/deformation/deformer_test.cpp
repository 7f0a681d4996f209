// The deformer alone: profiles, undo, inferred points.
#include "toolkit/deformation/deformer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/deformation/moving_vertices.h"
#include "toolkit/points/point_walk.h"

namespace palpate::render {
namespace {

constexpr double kDeformerDt = 1e-3;

PointModel moving_model(const Scene& scene, std::size_t spare, PartitionKind kind = PartitionKind::kGrid) {
  PointModelOptions o;
  o.partition = kind;
  o.moving = true;
  o.spare_points = spare;
  PrepareReport report;
  return build_point_model(*scene.input.models[0].cloud, o, {1, nullptr}, report).value();
}

/// Every place below `used` is found exactly once where it is, and no other place anywhere.
void expect_partition_right(const PointModel& model, std::size_t used) {
  std::size_t wrong = 0;
  const auto check = [&](const auto& partition) {
    for (std::uint32_t place = 0; place < used; ++place) {
      int times = 0;
      (void)visit_at(partition, model.points[place].at(), [&](partition::PlaceRange range) {
        times += range.begin <= place && place < range.end;
        wrong += range.end > used;
        return true;
      });
      wrong += times != 1;
    }
  };
  if (const auto* octree = std::get_if<partition::DynamicOctree>(&model.tree))
    check(*octree);
  else if (const auto* quadtree = std::get_if<partition::DynamicQuadtree3d>(&model.tree))
    check(*quadtree);
  else
    check(std::get<partition::DynamicGrid>(model.tree));
  EXPECT_EQ(wrong, 0u);
}

/// The place nearest to the middle of the model.
std::uint32_t middle_place(const PointModel& model) {
  std::uint32_t best = 0;
  for (std::uint32_t i = 0; i < model.points.size(); ++i)
    if (distance_sq(model.points[i], Vec3::Zero()) < distance_sq(model.points[best], Vec3::Zero())) best = i;
  return best;
}

TEST(Deformer, ADentHasItsProfileAndEverythingFollows) {
  const Scene scene = generated("plane:extent_mm=20:spacing_mm=0.5");
  PointModel model = moving_model(scene, 1000);
  SurfaceField surface;  // the same everywhere: no value for each point
  MovingVertices moving(model, surface, 1000);
  Deformer deformer(moving, 10000);
  const std::uint32_t middle = middle_place(model);
  const std::size_t moved = deformer.press(middle, Vec3::UnitZ(), 0.3, 2.0);
  EXPECT_GT(moved, 40u);
  EXPECT_LE(moved, kMaxMovedPoints);
  const double z0 = scene.input.models[0].cloud->local_mm(0).z();
  for (std::uint32_t i = 0; i < model.points.size(); ++i) {
    const StoredPoint& p = model.points[i];
    const double r_sq = (p.at() - model.points[middle].at()).head<2>().squaredNorm() / 4.0;
    const double expected = r_sq < 1.0 ? -0.3 * (1.0 - r_sq) * (1.0 - r_sq) : 0.0;
    EXPECT_NEAR(p.at().z() - z0, expected, 1e-5) << i;
  }
  expect_partition_right(model, deformer.points());
  // Planes follow: on the slope the normal leans towards the dent's middle.
  double steepest = 1.0;
  for (const MovedPoint& m : deformer.last_moved())
    steepest = std::min(steepest, std::abs(surface::decode_normal(model.points[m.place].normal).z()));
  // The profile's steepest slope is 0.3 x 0.77 / 1 mm, a cosine of 0.974; a plane over eight neighbours is
  // flatter.
  EXPECT_LT(steepest, 0.985);
  EXPECT_GT(steepest, 0.97);
}

void expect_undone(PartitionKind kind) {
  SCOPED_TRACE(static_cast<int>(kind));
  const Scene scene = generated("plane:extent_mm=20:spacing_mm=0.5:jitter=0.2");
  PointModel model = moving_model(scene, 2000, kind);
  SurfaceField surface;  // the same everywhere: no value for each point
  const auto points = model.points;
  const auto links = model.neighbours;
  MovingVertices moving(model, surface, 2000);
  Deformer deformer(moving, 100000);
  Random random(5);
  const auto stroke = [&] {
    deformer.begin_stroke();
    for (int dent = 0; dent < 4; ++dent) {
      const auto place = static_cast<std::uint32_t>(random.below(points.size()));
      for (int i = 0; i < 20; ++i) (void)deformer.press(place, Vec3::UnitZ(), 0.3, 2.5);
    }
  };
  stroke();
  const auto after_first = model.points;
  const std::size_t used_first = deformer.points();
  stroke();
  EXPECT_GT(deformer.points(), points.size()) << "stretched links were mended";
  ASSERT_TRUE(deformer.undo());
  EXPECT_EQ(deformer.points(), used_first);
  for (std::size_t i = 0; i < used_first; ++i)
    ASSERT_EQ(std::memcmp(&model.points[i], &after_first[i], sizeof(StoredPoint)), 0) << i;
  ASSERT_TRUE(deformer.undo());
  EXPECT_FALSE(deformer.undo());
  EXPECT_EQ(deformer.points(), points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_EQ(std::memcmp(&model.points[i], &points[i], sizeof(StoredPoint)), 0) << i;
    ASSERT_EQ(model.neighbours[i], links[i]) << i;
  }
  expect_partition_right(model, deformer.points());
  stroke();
  deformer.reset();
  for (std::size_t i = 0; i < points.size(); ++i)
    ASSERT_EQ(std::memcmp(&model.points[i], &points[i], sizeof(StoredPoint)), 0) << i;
  expect_partition_right(model, deformer.points());
}

TEST(Deformer, UndoGivesBackEveryBit) {
  for (const auto kind : {PartitionKind::kGrid, PartitionKind::kOctree, PartitionKind::kQuadtree})
    expect_undone(kind);
}

TEST(Deformer, OldStrokesAreForgottenNotDamaged) {
  const Scene scene = generated("plane:extent_mm=20:spacing_mm=0.5");
  PointModel model = moving_model(scene, 0);
  SurfaceField surface;  // the same everywhere: no value for each point
  MovingVertices moving(model, surface, 0);
  Deformer deformer(moving, 150);  // room for about two dents
  for (int stroke = 0; stroke < 6; ++stroke) {
    deformer.begin_stroke();
    (void)deformer.press(middle_place(model), Vec3::UnitZ(), 0.01, 2.0);
  }
  EXPECT_GT(deformer.counters().forgotten, 0u);
  const double before = model.points[middle_place(model)].at().z();
  ASSERT_TRUE(deformer.undo());
  EXPECT_NEAR(model.points[middle_place(model)].at().z() - before, 0.01, 1e-6);
  while (deformer.undo()) {
  }
  expect_partition_right(model, deformer.points());
}

TEST(Deformer, StretchedSurfacesKeepTheirBoxesTouching) {
  const Scene scene = generated("plane:extent_mm=20:spacing_mm=0.5");
  PointModel model = moving_model(scene, 20000);
  SurfaceField surface;  // the same everywhere: no value for each point
  MovingVertices moving(model, surface, 20000);
  Deformer deformer(moving, 0);
  const std::uint32_t middle = middle_place(model);
  for (int i = 0; i < 400; ++i) (void)deformer.press(middle, Vec3::UnitZ(), 0.02, 3.0);  // 8 mm deep
  EXPECT_GT(deformer.counters().inferred, 50u);
  // Of every place, the nearest linked one touches.
  std::size_t apart = 0;
  for (std::uint32_t i = 0; i < deformer.points(); ++i) {
    const std::uint32_t near = model.neighbours[i][0];
    const Vec3 off = (model.points[i].at() - model.points[near].at()).cwiseAbs();
    apart += (off.array() > 2.0 * model.global_half_box_mm.array()).any();
  }
  EXPECT_EQ(apart, 0u);
  expect_partition_right(model, deformer.points());
  const cloud::Cloud edited = deformer.edited().value();
  EXPECT_EQ(edited.size(), deformer.points());
}

TEST(Deformer, PointsLeaveTheGridsFirstBox) {
  const Scene scene = generated("plane:extent_mm=10:spacing_mm=0.5");
  PointModel model = moving_model(scene, 4000);
  SurfaceField surface;  // the same everywhere: no value for each point
  MovingVertices moving(model, surface, 4000);
  Deformer deformer(moving, 0);
  const std::uint32_t middle = middle_place(model);
  for (int i = 0; i < 300; ++i) (void)deformer.press(middle, Vec3::UnitZ(), 0.1, 2.0);
  double lowest = 0.0;
  for (const StoredPoint& p : model.points) lowest = std::min(lowest, p.at().z());
  EXPECT_LT(lowest, -5.0);
  expect_partition_right(model, deformer.points());
}

TEST(Deformer, HostileCallsChangeNothing) {
  const Scene scene = generated("plane:extent_mm=10:spacing_mm=1");
  PointModel model = moving_model(scene, 10);
  SurfaceField surface;  // the same everywhere: no value for each point
  const auto points = model.points;
  MovingVertices moving(model, surface, 10);
  Deformer deformer(moving, 10);
  EXPECT_EQ(deformer.press(1u << 30, Vec3::UnitZ(), 1.0, 1.0), 0u);
  EXPECT_EQ(deformer.press(0, Vec3::UnitZ(), std::nan(""), 1.0), 0u);
  EXPECT_EQ(deformer.press(0, Vec3(std::nan(""), 0, 0), 1.0, 1.0), 0u);
  EXPECT_EQ(deformer.press(0, Vec3::UnitZ(), -1.0, 1.0), 0u);
  (void)deformer.press(0, Vec3::UnitZ(), 1e300, 1.0);
  MoveBatch batch;
  batch.count = 0xFFFFFFFFu;
  batch.point.fill(0xFFFFFFFFu);
  EXPECT_EQ(deformer.apply(batch), 0u);
  for (std::size_t i = 0; i < points.size(); ++i)
    EXPECT_EQ(std::memcmp(&model.points[i], &points[i], sizeof(StoredPoint)), 0) << i;
}

}  // namespace
}  // namespace palpate::render
