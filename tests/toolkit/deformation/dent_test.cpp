// Surfaces that give way under the hand, are put back, or move by themselves, as `cloud` feels them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/deformation/deformed_local_delaunay.h"
#include "toolkit/deformation/deformer.h"

namespace palpate::deformation {

using namespace render;

namespace {

constexpr double kDt = 1e-3;

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
  renderer->restart(Vec3(0, 0, 2));
  const auto press = [&](double depth) {
    (void)renderer->step(Vec3(0, 0, 2), kDt);
    double most = 0.0;
    bool lost = false, touched = false;
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
  renderer->restart(Vec3(0, 0, 2));
  EXPECT_GT(press(0.45), 0.2) << "and after a reset";
  editable.restore(0);
  EXPECT_EQ(editable.edited(0)->size(), scene.input.models[0].cloud->size());
  EXPECT_FALSE(editable.undo(1));
  EXPECT_FALSE(editable.edited(1));
}

/// A plane of points 0.5 mm apart that gives way beyond 0.5 mm, 3 mm around, held down at `depth_mm`.
test::Stepped dented(const Scene& scene, double depth_mm) {
  auto renderer = prepared(scene.input, "cloud");
  renderer->restart(Vec3(0.1, 0.1, 1));
  (void)glide(renderer, Vec3(0.1, 0.1, 1), Vec3(0.1, 0.1, -depth_mm),
              static_cast<int>((1.0 + depth_mm) / 0.01));
  return renderer;
}

// The surface comes back to where the HIP is now below it. Nothing of the dent's shape may be left: not the
// place that the god object was at, which may be gone, nor its plane, nor what friction held.
TEST(Undo, UnderTheHandTheSurfaceIsWhereItWas) {
  Scene scene = soft_plane();
  for (const double friction : {0.0, 0.8})
    for (const bool all : {false, true})
      for (const double up_to : {-4.0, -2.0}) {  // in contact with the dent's bottom, and free above it
        SCOPED_TRACE(testing::Message()
                     << "friction " << friction << ", at " << up_to << " mm, " << (all ? "restore" : "undo"));
        scene.input.models[0].surface.friction = {friction, friction};
        const auto renderer = dented(scene, 4.0);
        auto& editable = dynamic_cast<Editable&>(*renderer);
        EXPECT_GT(editable.deform_counters(0).inferred, 0u) << "some places are gone after undo";
        Frame frame = glide(renderer, Vec3(0.1, 0.1, -4), Vec3(0.5, 0.1, up_to), 200);
        const Vec3 hip(0.5, 0.1, up_to);
        EXPECT_EQ(frame.contact, up_to < -3.0);
        if (all)
          editable.restore(0);
        else
          ASSERT_TRUE(editable.undo(0));
        frame = renderer->step(hip, 0.0);  // no time to give way again
        ASSERT_TRUE(frame.contact);
        EXPECT_LT((frame.force_n - Vec3(0, 0, -0.5 * up_to)).norm(), 1e-5) << frame.force_n.transpose();
        EXPECT_LT((frame.god_object_mm - Vec3(0.5, 0.1, 0)).norm(), 1e-5) << frame.god_object_mm.transpose();
        EXPECT_EQ(editable.edited(0)->size(), scene.input.models[0].cloud->size());
        // Out, and in again as on a surface that was never dented.
        for (int i = 0; i <= 100; ++i)
          frame = renderer->step(hip + Vec3(0, 0, (1.0 - up_to) * i / 100.0), 0.0);
        EXPECT_FALSE(frame.contact);
        const auto fresh = prepared(scene.input, "cloud");
        fresh->restart(Vec3(0.5, 0.1, 1));
        for (int i = 0; i <= 300; ++i) {
          const Vec3 h(0.5 + 0.01 * i, 0.1, 1.0 - 0.0045 * i);
          const Frame a = renderer->step(h, kDt), b = fresh->step(h, kDt);
          ASSERT_EQ(a.contact, b.contact) << i;
          ASSERT_LT((a.force_n - b.force_n).norm(), 1e-9) << i;
        }
      }
}

TEST(Undo, OfAModelThatIsFarOrWholeIsHarmless) {
  const Scene scene = soft_plane();
  const auto renderer = dented(scene, 2.0);
  auto& editable = dynamic_cast<Editable&>(*renderer);
  for (int i = 0; i <= 1000; ++i) (void)renderer->step(Vec3(0.1, 0.1, -2.0 + 0.1 * i), kDt);
  ASSERT_TRUE(editable.undo(0));
  EXPECT_FALSE(editable.undo(0));
  editable.restore(0);
  Frame frame;
  for (int i = 0; i <= 1000; ++i) {
    const double z = 98.0 - 0.0984 * i;
    frame = renderer->step(Vec3(0.1, 0.1, z), kDt);
    if (std::abs(z) > 0.01) {
      ASSERT_EQ(frame.contact, z < 0.0) << z;
    }
  }
  EXPECT_NEAR(frame.force_n.z(), 0.5 * 0.4, 1e-3);
}

// The broad phase knows the box of the prepared points; a dent leaves it.
TEST(Dent, IsMetFromBelowOutsideOfTheModelsFirstBox) {
  Scene scene = generated("plane:extent_mm=40:spacing_mm=0.5");
  scene.input.models[0].surface.dent = {0.5, 4.0, 40.0};
  const auto renderer = prepared(scene.input, "cloud");
  Vec3 at(0.1, 0.1, 1);
  renderer->restart(at);
  Frame frame;
  for (const Vec3& to : {Vec3(0.1, 0.1, -4), Vec3(0.1, 0.1, 5), Vec3(60, 0.1, 5), Vec3(60, 0.1, -30),
                         Vec3(0.1, 0.1, -30), Vec3(0.1, 0.1, -3.6)}) {
    frame = glide(renderer, at, to, 1500);
    at = to;
  }
  EXPECT_FALSE(frame.contact);
  frame = glide(renderer, at, Vec3(0.1, 0.1, -2.8), 1500);  // the bottom is at about -3.1
  ASSERT_TRUE(frame.contact);
  EXPECT_LT(frame.force_n.z(), 0.0) << "down";
}

// At every ratio of radius, depth and spacing: what is in contact pushes, as hard as it is deep, and out of
// the dent; and the way back is free.
TEST(Dent, ContactPushesHoweverNarrowAndDeep) {
  Random random(53);
  for (const double spacing : {0.25, 0.5, 1.0})
    for (const double radius : {0.5, 1.0, 2.0, 4.0})
      for (const double depth : {1.0, 3.0, 6.0}) {
        SCOPED_TRACE(testing::Message()
                     << "seed 53, spacing " << spacing << ", radius " << radius << ", depth " << depth);
        const double kYield = 0.5 * spacing;
        constexpr double kSpeed = 10.0;
        Scene scene = generated("plane:extent_mm=20:spacing_mm=" + std::to_string(spacing));
        scene.input.models[0].surface.dent = {kYield, radius, 20.0};
        const auto renderer = prepared(scene.input, "cloud");
        auto& editable = dynamic_cast<Editable&>(*renderer);
        const Vec3 top{random.uniform(), random.uniform(), 0.5}, bottom = top - Vec3(0, 0, 0.5 + depth);
        renderer->restart(top);
        const int frames = static_cast<int>((0.5 + depth) / kSpeed / kDt);
        int wrong = 0, down = 0, lost = 0;
        bool touched = false;
        for (int i = 0; i <= frames; ++i) {
          const Vec3 hip = top + (bottom - top) * (static_cast<double>(i) / frames);
          const Frame frame = renderer->step(hip, kDt);
          touched |= frame.contact;
          lost += touched && !frame.contact;
          down += frame.contact && !(frame.force_n.z() > 0.0);
          if (i % 20 != 0 || !frame.contact) continue;
          const cloud::Cloud now = editable.edited(0).value();
          double nearest = 1e9;
          for (std::size_t k = 0; k < now.size(); ++k)
            nearest = std::min(nearest, (now.point_mm(k) - hip).norm());
          const double deep = frame.force_n.norm() / 0.5;
          wrong += std::abs(deep - nearest) > spacing;
          wrong += hip.z() < -2.0 * kYield && deep < 0.5 * kYield;
        }
        EXPECT_TRUE(touched);
        EXPECT_EQ(lost, 0);
        EXPECT_EQ(down, 0);
        EXPECT_EQ(wrong, 0);
        EXPECT_FALSE(glide(renderer, bottom, top, frames).contact);
      }
}

TEST(Dent, TakesWorkAndGivesNoneBack) {
  const Scene scene = soft_plane();
  const auto renderer = prepared(scene.input, "cloud");
  renderer->restart(Vec3(0, 0, 1));
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

/// The points of a plane rise by themselves by `step_mm` at a time, a batch a frame, up to `most_mm`, past a
/// probe that never moves.
void expect_met(const std::string& spec, const Vec3& hip, double step_mm, double most_mm, int frames) {
  Scene scene = generated(spec);
  scene.input.models[0].moves = std::make_shared<MoveQueue>();
  MoveQueue& queue = *scene.input.models[0].moves;
  const cloud::Cloud& cloud = *scene.input.models[0].cloud;
  const auto renderer = prepared(scene.input, "cloud");
  renderer->restart(hip);
  double height = 0.0;
  std::uint32_t next = 0;
  int lost = 0;
  Frame frame;
  for (int i = 0; i < frames; ++i) {
    if (MoveBatch* batch = queue.begin(); batch != nullptr && height < most_mm) {
      if (next == 0) height += step_mm;
      for (; batch->count < kMaxBatch && next < cloud.size(); ++next) {
        batch->point[batch->count] = next;
        batch->to_mm[batch->count++] =
            Vec3f(cloud.x_mm[next], cloud.y_mm[next], cloud.z_mm[next] + static_cast<float>(height));
      }
      if (next >= cloud.size()) next = 0;
      queue.publish();
    }
    const bool before = frame.contact;
    frame = renderer->step(hip, kDt);
    lost += before && !frame.contact;
  }
  EXPECT_EQ(lost, 0);
  ASSERT_TRUE(frame.contact);
  EXPECT_NEAR(frame.force_n.z(), 0.5 * (height - hip.z()), 0.01);
}

TEST(SelfDeforming, ASurfaceThatRisesByItselfMeetsARestingProbe) {
  // Section 3.3.2.1's case. 41 x 41 points, so that four batches lift all.
  expect_met("plane:extent_mm=20:spacing_mm=0.5", Vec3(0.13, 0.21, 0.6), 0.02, 1.6, 1200);
  // However far it moves from its first box.
  expect_met("plane:extent_mm=10:spacing_mm=0.5", Vec3(0.13, 0.21, 20.0), 0.1, 21.0, 300);
}

// The deformer alone: profiles, what it remembers, calls that make no sense.

struct Sheet {
  Sheet(const std::string& spec, std::size_t spare, std::size_t journal)
      : mesh(local_delaunay::LocalDelaunayMesh::build(*generated(spec).input.models[0].cloud, 1)),
        moving(mesh, tree, surface, spare, 1),
        deformer(moving, journal) {
    for (std::uint32_t i = 0; i < moving.built(); ++i)
      if (mesh.at(i).norm() < mesh.at(middle).norm()) middle = i;
  }
  [[nodiscard]] std::vector<Vec3> places() const {
    std::vector<Vec3> all;
    for (std::uint32_t i = 0; i < moving.built(); ++i) all.push_back(mesh.at(i));
    return all;
  }
  local_delaunay::LocalDelaunayMesh mesh;
  local_delaunay::BlockBvh tree;
  SurfaceField surface;  // the same everywhere: no value for each point
  DeformedLocalDelaunay moving;
  Deformer deformer;
  std::uint32_t middle = 0;  ///< the place nearest to the middle of the model
};

TEST(Deformer, ADentHasItsProfile) {
  Sheet sheet("plane:extent_mm=20:spacing_mm=0.5", 1000, 10000);
  const std::vector<Vec3> before = sheet.places();
  const std::size_t moved = sheet.deformer.press(sheet.middle, Vec3::UnitZ(), 0.3, 2.0);
  EXPECT_GT(moved, 40u);
  EXPECT_LE(moved, kMaxMovedPoints);
  for (std::uint32_t i = 0; i < before.size(); ++i) {
    const double r_sq = (before[i] - before[sheet.middle]).squaredNorm() / 4.0;
    const double expected = r_sq < 1.0 ? -0.3 * (1.0 - r_sq) * (1.0 - r_sq) : 0.0;
    EXPECT_NEAR(sheet.mesh.at(i).z() - before[i].z(), expected, 1e-5) << i;
  }
}

TEST(Deformer, OldStrokesAreForgottenNotDamaged) {
  Sheet sheet("plane:extent_mm=20:spacing_mm=0.5", 0, 150);  // room for about two dents
  for (int stroke = 0; stroke < 6; ++stroke) {
    sheet.deformer.begin_stroke();
    (void)sheet.deformer.press(sheet.middle, Vec3::UnitZ(), 0.01, 2.0);
  }
  EXPECT_GT(sheet.deformer.counters().forgotten, 0u);
  const double before = sheet.mesh.at(sheet.middle).z();
  ASSERT_TRUE(sheet.deformer.undo());
  EXPECT_NEAR(sheet.mesh.at(sheet.middle).z() - before, 0.01, 1e-6);
}

TEST(Deformer, HostileCallsChangeNothing) {
  Sheet sheet("plane:extent_mm=10:spacing_mm=1", 10, 10);
  const std::vector<Vec3> before = sheet.places();
  EXPECT_EQ(sheet.deformer.press(1u << 30, Vec3::UnitZ(), 1.0, 1.0), 0u);
  EXPECT_EQ(sheet.deformer.press(0, Vec3::UnitZ(), std::nan(""), 1.0), 0u);
  EXPECT_EQ(sheet.deformer.press(0, Vec3(std::nan(""), 0, 0), 1.0, 1.0), 0u);
  EXPECT_EQ(sheet.deformer.press(0, Vec3::UnitZ(), -1.0, 1.0), 0u);
  (void)sheet.deformer.press(0, Vec3::UnitZ(), 1e300, 1.0);
  MoveBatch batch;
  batch.count = 0xFFFFFFFFu;
  batch.point.fill(0xFFFFFFFFu);
  EXPECT_EQ(sheet.deformer.apply(batch), 0u);
  EXPECT_EQ(sheet.places(), before);
}

}  // namespace
}  // namespace palpate::deformation
