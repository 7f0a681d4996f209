// Geometry that gives way: dents, undo, inferred points, models that deform by themselves.
#include "toolkit/render/deformer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <thread>
#include <vector>

#include "tests/toolkit/render/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/render/editable.h"
#include "toolkit/render/point_walk.h"

namespace palpate::render {
namespace {

constexpr double kDt = 1e-3;

PointModel moving_model(const Scene& scene, std::size_t spare) {
  PointModelOptions o;
  o.partition = PartitionKind::kMoving;
  o.spare_points = spare;
  PrepareReport report;
  return build_point_model(scene.input.models[0], o, {1, nullptr}, report).value();
}

/// Every place below `used` is found exactly once where it is.
void expect_partition_right(const PointModel& model, std::size_t used) {
  const auto& grid = std::get<partition::DynamicGrid>(model.tree);
  std::size_t wrong = 0;
  for (std::uint32_t place = 0; place < used; ++place) {
    int times = 0;
    (void)visit_at(grid, model.points[place].at(), [&](partition::PlaceRange range) {
      times += range.begin <= place && place < range.end;
      return true;
    });
    wrong += times != 1;
  }
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
  Deformer deformer(model, {1000, 10000});
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
  for (const Deformer::Moved& m : deformer.last_moved())
    steepest = std::min(steepest, std::abs(surface::decode_normal(model.points[m.place].normal).z()));
  // The profile's steepest slope is 0.3 x 0.77 / 1 mm, a cosine of 0.974; a plane over eight neighbours is
  // flatter.
  EXPECT_LT(steepest, 0.985);
  EXPECT_GT(steepest, 0.97);
}

TEST(Deformer, UndoGivesBackEveryBit) {
  const Scene scene = generated("plane:extent_mm=20:spacing_mm=0.5:jitter=0.2");
  PointModel model = moving_model(scene, 2000);
  const auto points = model.points;
  const auto links = model.neighbours;
  Deformer deformer(model, {2000, 100000});
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

TEST(Deformer, OldStrokesAreForgottenNotDamaged) {
  const Scene scene = generated("plane:extent_mm=20:spacing_mm=0.5");
  PointModel model = moving_model(scene, 0);
  Deformer deformer(model, {0, 150});  // room for about two dents
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
  Deformer deformer(model, {20000, 0});
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
  Deformer deformer(model, {4000, 0});
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
  const auto points = model.points;
  Deformer deformer(model, {10, 10});
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

/// A plane that gives way beyond 0.5 mm.
Scene soft_plane() {
  Scene scene = generated("plane:extent_mm=30:spacing_mm=0.5");
  scene.input.models[0].surface.dent = {0.5, 3.0, 20.0};
  return scene;
}

TEST(Dent, StaysAfterTheProbeAndIsFeltAgain) {
  const Scene scene = soft_plane();
  const auto renderer = prepared(scene.input, "cloud");
  auto& editable = dynamic_cast<Editable&>(*renderer);
  renderer->reset(Vec3(0, 0, 2));
  const auto press = [&](double depth) {
    (void)renderer->step(Vec3(0, 0, 2), kDt);
    double most = 0.0;
    bool lost = false;
    bool touched = false;
    for (int i = 0; i <= 4000; ++i) {
      const double z =
          i < 2000 ? 1.0 - (1.0 + depth) * i / 2000.0 : -depth + (1.0 + depth) * (i - 2000) / 2000.0;
      const Frame frame = renderer->step(Vec3(0.1, 0.1, z), kDt);
      touched |= frame.contact;
      // While it goes in, contact once made stays.
      lost |= touched && !frame.contact && i < 2000;
      most = std::max(most, frame.force_n.norm());
    }
    EXPECT_FALSE(lost);
    return most;
  };
  const double first = press(2.0);
  EXPECT_LT(first, 0.5 * 0.75) << "it gave way beyond 0.5 mm: far less than the 1 N of a rigid one";
  EXPECT_GT(first, 0.5 * 0.45);
  // The dent is there: at 1 mm the second touch feels nothing.
  EXPECT_LT(press(1.0), 0.05);
  ASSERT_TRUE(editable.undo(0));
  EXPECT_GT(press(0.45), 0.2) << "after undo the surface is where it was";
  EXPECT_LT(press(2.0), 0.5 * 0.75);
  renderer->reset(Vec3(0, 0, 2));
  EXPECT_GT(press(0.45), 0.2) << "and after a reset";
  editable.restore(0);
  EXPECT_EQ(editable.edited(0)->size(), scene.input.models[0].cloud->size());
  EXPECT_FALSE(editable.undo(1));
  EXPECT_FALSE(editable.edited(1));
}

TEST(Dent, TakesWorkAndGivesNoneBack) {
  const Scene scene = soft_plane();
  const auto renderer = prepared(scene.input, "cloud");
  renderer->reset(Vec3(0, 0, 1));
  double work = 0.0, least = 0.0;
  Vec3 before(0, 0, 1), force = Vec3::Zero();
  for (int i = 0; i <= 6000; ++i) {
    const double t = i / 6000.0;
    const Vec3 h(6.0 * std::sin(6.0 * t), 4.0 * std::sin(11.0 * t), 1.0 - 3.0 * std::sin(3.14159265 * t));
    const Frame frame = renderer->step(h, kDt);
    work -= 0.5 * (force + frame.force_n).dot(h - before);  // into the surface
    least = std::min(least, work);
    force = frame.force_n;
    before = h;
  }
  EXPECT_GT(work, 0.1) << "a dent takes work";
  EXPECT_GT(least, -0.01 * 0.5 * 0.5 * 0.25) << "and none comes out first";
}

TEST(SelfDeforming, ASurfaceThatRisesByItselfMeetsARestingProbe) {
  // The whole plane rises point by point, a batch a frame, past a probe that never moves: section 3.3.2.1's
  // case. 41 x 41 points, so that four batches lift all.
  Scene scene = generated("plane:extent_mm=20:spacing_mm=0.5");
  scene.input.models[0].moves = std::make_shared<MoveQueue>();
  MoveQueue& queue = *scene.input.models[0].moves;
  const cloud::Cloud& cloud = *scene.input.models[0].cloud;
  const auto renderer = prepared(scene.input, "cloud");
  const Vec3 hip(0.13, 0.21, 0.6);
  renderer->reset(hip);
  double height = 0.0;
  std::uint32_t next = 0;
  int lost = 0;
  bool before = false;
  Frame frame;
  for (int i = 0; i < 1200; ++i) {
    if (MoveBatch* batch = queue.begin(); batch != nullptr && height < 1.6) {
      if (next == 0) height += 0.02;
      for (; batch->count < kMaxBatch && next < cloud.size(); ++next) {
        batch->point[batch->count] = next;
        batch->to_mm[batch->count++] =
            Vec3f(cloud.x_mm[next], cloud.y_mm[next], cloud.z_mm[next] + static_cast<float>(height));
      }
      if (next >= cloud.size()) next = 0;
      queue.publish();
    }
    frame = renderer->step(hip, kDt);
    lost += before && !frame.contact;
    before = frame.contact;
  }
  EXPECT_EQ(lost, 0);
  ASSERT_TRUE(frame.contact);
  EXPECT_NEAR(frame.force_n.z(), 0.5 * (height - 0.6), 0.01);
}

TEST(MoveQueue, LosesNothingBetweenTwoThreads) {
  MoveQueue queue;
  constexpr std::uint32_t kBatches = 2000;
  std::thread writer([&] {
    for (std::uint32_t sent = 0; sent < kBatches;) {
      MoveBatch* batch = queue.begin();
      if (batch == nullptr) continue;
      batch->count = 1;
      batch->point[0] = sent++;
      queue.publish();
    }
  });
  std::uint32_t expected = 0;
  bool in_order = true;
  while (expected < kBatches) {
    const MoveBatch* batch = queue.take();
    if (batch == nullptr) continue;
    in_order = in_order && batch->count == 1 && batch->point[0] == expected;
    ++expected;
  }
  writer.join();
  EXPECT_TRUE(in_order);
}

}  // namespace
}  // namespace palpate::render
