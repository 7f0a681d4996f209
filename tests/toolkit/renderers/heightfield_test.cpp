// The height-field renderers against formulas, brute force and each other; holes, borders, hostile data.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include <palpate/accuracy.h>
#include <palpate/replay.h>
#include "tests/toolkit/cloud/posts.h"
#include "tests/toolkit/messages.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/cloud/height_field.h"
#include "toolkit/core/random.h"
#include "toolkit/render/correction_ramp.h"

namespace palpate::render {
namespace {

using cloud::flat;
using cloud::Heights;
using cloud::kNone;
using cloud::posts;
using cloud::rough;

SceneInput scene_of(const std::vector<Vec3>& points) {
  SceneInput scene = cloud_of(points);
  scene.models[0].surface.stiffness_n_per_mm = 1.0;
  return scene;
}

/// Bilinear height over unit posts, by the definition; not a number beside the field.
double bilinear(const Heights& height, std::size_t columns, std::size_t rows, double x, double y) {
  const double last_x = static_cast<double>(columns - 1), last_y = static_cast<double>(rows - 1);
  if (!(x >= 0.0 && y >= 0.0 && x <= last_x && y <= last_y)) return kNone;
  const double i = std::min(std::floor(x), last_x - 1.0), j = std::min(std::floor(y), last_y - 1.0);
  const double s = x - i, t = y - j;
  const auto at = [&](double c, double r) {
    return height(static_cast<std::size_t>(c), static_cast<std::size_t>(r));
  };
  return (1 - s) * (1 - t) * at(i, j) + s * (1 - t) * at(i + 1, j) + (1 - s) * t * at(i, j + 1) +
         s * t * at(i + 1, j + 1);
}

TEST(HeightFieldRenderer, RefusesScenesItCannotTake) {
  SceneInput no_stiffness = scene_of(posts(4, 4, 1.0, rough(1, 1))), wrong_count = no_stiffness;
  no_stiffness.models[0].surface.stiffness_n_per_mm = kNone;
  auto properties = std::make_shared<surface::PointProperties>();
  properties->stiffness_n_per_mm.assign(7, 1.0f);
  wrong_count.models[0].surface.per_point = properties;
  for (const SceneInput& scene : {no_stiffness, wrong_count, SceneInput{}, scene_of({{0, 0, 0}, {1, 0, 0}})})
    for (const char* name : {"heightfield", "heightfield-literal"})
      EXPECT_FALSE(prepare_report(scene, name)) << name;
}

// To the letter.

TEST(HeightFieldLiteral, LooksUpTheBoxTop) {
  const Heights ground = rough(2.0, 9);
  const auto renderer = prepared(scene_of(posts(12, 9, 1.0, ground)), "heightfield-literal:response=lookup");
  Random random(4);
  for (int i = 0; i < 5000; ++i) {
    const Vec3 h(random.uniform(-1, 12), random.uniform(-1, 9), random.uniform(-3, 3));
    const Frame frame = renderer->step(h, 1e-3);
    const double column = std::round(h.x()), row = std::round(h.y());
    const bool over = column >= 0 && row >= 0 && column < 12 && row < 9;
    const double top = over ? ground(static_cast<std::size_t>(column), static_cast<std::size_t>(row)) : -100;
    ASSERT_EQ(frame.contact, h.z() < top) << h.transpose();
    if (frame.contact) {
      EXPECT_NEAR(frame.force_n.z(), top - h.z(), 1e-9);
    }
  }
}

// 4.3.2: the walk starts at the entry cell in every frame: a ridge between there and the HIP holds it back.
TEST(HeightFieldLiteral, WalksFromTheEntryCellEveryFrame) {
  const Heights ridge = [](std::size_t c, std::size_t) { return c == 10 ? 5.0 : 0.0; };
  const SceneInput scene = scene_of(posts(21, 5, 1.0, ridge));
  const auto renderer = prepared(scene, "heightfield-literal");
  Vec3 at(5, 2, -0.5);
  EXPECT_TRUE(renderer->step(at, 1e-3).contact);
  Frame frame = move(renderer, at, {15, 2, -0.5}, 0.05);
  EXPECT_TRUE(frame.contact);
  EXPECT_NEAR(frame.god_object_mm.x(), 9.0, 1e-9) << "held before the ridge";
  // A walk that starts beyond it finds the post above.
  renderer->restart(at);
  frame = renderer->step(at, 1e-3);
  EXPECT_NEAR(frame.god_object_mm.x(), 15.0, 1e-9);
}

// Made right.

TEST(HeightFieldRenderer, APlaneIsExact) {
  for (const double tilt : {0.0, 0.5, -2.0}) {
    const auto renderer =
        prepared(scene_of(posts(50, 50, 0.5,
                                [=](std::size_t c, std::size_t r) {
                                  return tilt * 0.5 * static_cast<double>(c) + 0.25 * static_cast<double>(r);
                                })),
                 "heightfield");
    const Vec3 normal = Vec3(-tilt, -0.5, 1.0).normalized();
    Random random(8);
    for (int i = 0; i < 200; ++i) {
      const double x = random.uniform(9, 15), y = random.uniform(9, 15), depth = random.uniform(0.01, 2.0);
      const Vec3 on(x, y, tilt * x + 0.5 * y);
      renderer->restart(on + 3.0 * normal);
      Vec3 at = on + 3.0 * normal;
      const Frame frame = move(renderer, at, on - depth * normal, 0.1);
      ASSERT_TRUE(frame.contact);
      EXPECT_NEAR((frame.god_object_mm - on).norm(), 0.0, 1e-5);  // single-precision posts
      EXPECT_NEAR((frame.force_n - depth * normal).norm(), 0.0, 1e-5);
    }
  }
}

/// Nothing of the sheet within `reach` of the god object is nearer to the HIP.
void expect_nearest(const Frame& frame, const Vec3& h, const Heights& ground, std::size_t columns,
                    std::size_t rows, Random& random, double reach) {
  const Vec3 god = frame.god_object_mm;
  const double on =
      bilinear(ground, columns, rows, std::clamp(god.x(), 0.0, static_cast<double>(columns - 1)),
               std::clamp(god.y(), 0.0, static_cast<double>(rows - 1)));
  ASSERT_NEAR(god.z(), on, 1e-6);
  const double distance = (god - h).norm();
  for (int i = 0; i < 40; ++i) {
    const double x = god.x() + random.uniform(-reach, reach), y = god.y() + random.uniform(-reach, reach);
    const double z = bilinear(ground, columns, rows, x, y);
    if (std::isnan(z)) continue;
    ASSERT_GE((Vec3(x, y, z) - h).norm(), distance - 1e-12 * (1.0 + distance))
        << "god object " << god.transpose() << ", HIP " << h.transpose();
  }
}

/// The last of the frames in which a jump of the god object is spread.
Frame rested(const test::Stepped& renderer, const Vec3& at) {
  for (int i = 0; i < CorrectionRamp::kFrames; ++i) (void)renderer->step(at, 1e-3);
  return renderer->step(at, 1e-3);
}

TEST(HeightFieldRenderer, RestsAtALocalMinimumOnRoughGround) {
  for (const double rise : {0.3, 1.0, 5.0}) {
    const Heights ground = rough(rise, 21);
    constexpr std::size_t kPosts = 30;
    const auto renderer = prepared(scene_of(posts(kPosts, kPosts, 1.0, ground)), "heightfield");
    Random random(17);
    Vec3 at(15, 15, rise + 1.0);
    renderer->restart(at);
    int contacts = 0, waiting = 0;
    for (int i = 0; i < 2000; ++i) {
      const Vec3 to(random.uniform(3, 26), random.uniform(3, 26), random.uniform(-1.0, rise + 0.3));
      const Vec3 next = at + std::min(1.0, 0.4 / (to - at).norm()) * (to - at);
      const Frame frame = rested(renderer, at = next);
      ASSERT_EQ(frame.status, FrameStatus::kOk);
      if (!frame.contact) continue;
      ++contacts;
      // A god object that jumped to a farther place waits for the hand.
      const Vec3& god = frame.god_object_mm;
      if (std::abs(god.z() - bilinear(ground, kPosts, kPosts, god.x(), god.y())) > 1e-6) {
        ++waiting;
        continue;
      }
      for (const double reach : {1e-6, 1e-4})
        expect_nearest(frame, at, ground, kPosts, kPosts, random, reach);
    }
    EXPECT_GT(contacts, 300);
    EXPECT_LT(waiting, contacts / 10);
  }
}

// On gentle ground the HIP is in contact exactly when it is below the sheet; small and large steps alike.
TEST(HeightFieldRenderer, ContactIsBeingBelow) {
  const Heights ground = rough(0.2, 33);
  constexpr std::size_t kPosts = 60;
  const auto renderer = prepared(scene_of(posts(kPosts, kPosts, 1.0, ground)), "heightfield");
  for (const double step : {0.003, 0.1, 2.0}) {
    Random random(23);
    Vec3 at(30, 30, 1), to = at;
    renderer->restart(at);
    int contacts = 0, changes = 0;
    bool before = false;
    for (int i = 0; i < 20000; ++i) {
      if ((to - at).norm() < 1e-9)
        to = {random.uniform(5, 55), random.uniform(5, 55), random.uniform(-0.2, 0.4)};
      at += std::min(1.0, step / (to - at).norm()) * (to - at);
      const Frame frame = renderer->step(at, 1e-3);
      const double over = at.z() - bilinear(ground, kPosts, kPosts, at.x(), at.y());
      if (std::abs(over) < 1e-6) continue;
      ASSERT_EQ(frame.contact, over < 0.0) << step << " " << i << " " << at.transpose() << " " << over;
      contacts += frame.contact;
      changes += frame.contact != before;
      before = frame.contact;
    }
    EXPECT_GT(contacts, 1000);
    EXPECT_GT(changes, step > 0.05 ? 10 : 0);
  }
}

// Section 4.2.2's one case of temporal aliasing, at 5 m/s: through a peak between two frames.
TEST(HeightFieldRenderer, FeelsAPeakAtAnySpeed) {
  // A wall of one post, 6 mm high, posts 0.1 mm apart.
  const Heights wall = [](std::size_t c, std::size_t) { return c == 100 ? 6.0 : 0.0; };
  const SceneInput scene = scene_of(posts(201, 21, 0.1, wall));
  int literal = 0, ours = 0;
  for (int i = 0; i < 50; ++i) {
    // 5 mm a frame: before and behind, 1 mm over the ground.
    const Vec3 from(7.45 + 0.01 * i, 1.0, 1.0), to(12.45 + 0.01 * i, 1.0, 1.0);
    for (const char* name : {"heightfield-literal", "heightfield"}) {
      const auto renderer = prepared(scene, name);
      renderer->restart(from);
      EXPECT_FALSE(renderer->step(from, 1e-3).contact);
      const Frame frame = renderer->step(to, 1e-3);
      (std::string(name) == "heightfield" ? ours : literal) += frame.contact;
      if (frame.contact) {
        EXPECT_LT(frame.force_n.x(), 0.0) << "pushed back";
        EXPECT_LT(frame.god_object_mm.x(), 10.01);
      }
    }
  }
  EXPECT_EQ(literal, 0);
  EXPECT_EQ(ours, 50);
}

TEST(HeightFieldRenderer, ALongSegmentGoesOnInTheNextFrame) {
  // Rows of needles keep every block's top above the segment.
  const Heights ground = [](std::size_t c, std::size_t) { return c % 16 == 8 ? 3.0 : 0.0; };
  const auto renderer =
      prepared(scene_of(posts(4001, 3, 1.0,
                              [&](std::size_t c, std::size_t r) {
                                return r == 2 ? ground(c, r) : (c == 3990 && r < 2 ? 200.0 : 0.0);
                              })),
               "heightfield");
  const Vec3 from(0.5, 0.5, 1.0), to(3999.5, 0.5, 1.0);
  renderer->restart(from);
  Frame frame = renderer->step(to, 1e-3);
  EXPECT_FALSE(frame.contact);
  EXPECT_EQ(frame.status, FrameStatus::kBoundHit);
  int frames = 1;
  while (!frame.contact && frames < 100) {
    frame = renderer->step(to, 1e-3);
    ++frames;
  }
  EXPECT_TRUE(frame.contact) << "the wall at 3990 is met in the end";
  EXPECT_LT(frame.force_n.x(), 0.0) << "and pushes back";
  EXPECT_LT(frames, 12);
}

TEST(HeightFieldRenderer, AHoleIsFreeSpaceWithACountedEdge) {
  const Heights ground = [](std::size_t c, std::size_t r) {
    return c >= 8 && c <= 12 && r >= 8 && r <= 12 ? kNone : 0.0;
  };
  const auto renderer = prepared(scene_of(posts(21, 21, 1.0, ground)), "heightfield:holes=open");
  Vec3 at(10, 10, 2);
  renderer->restart(at);
  EXPECT_FALSE(move(renderer, at, {10, 10, -3}, 0.1).contact) << "through the hole";
  EXPECT_EQ(renderer->counters().edges, 0u);
  EXPECT_FALSE(move(renderer, at, {3, 10, -3}, 0.1).contact) << "under the sheet";
  EXPECT_EQ(renderer->counters().edges, 1u);
  EXPECT_FALSE(move(renderer, at, {3, 10, 1}, 0.1).contact) << "up through it";
  EXPECT_TRUE(move(renderer, at, {3, 10, -0.5}, 0.1).contact) << "and down on it";
  // Pulled to the hole: the god object stays on the sheet, the HIP falls free past the rim.
  Frame frame = move(renderer, at, {6.9, 10, -0.5}, 0.1);
  EXPECT_TRUE(frame.contact);
  move(renderer, at, {7.2, 10, -0.5}, 0.1);
  EXPECT_FALSE(rested(renderer, at).contact);
  EXPECT_EQ(renderer->counters().edges, 2u);
}

TEST(HeightFieldRenderer, TheBorderEndsTheSheet) {
  const auto renderer = prepared(scene_of(posts(11, 11, 1.0, flat)), "heightfield");
  for (const Vec3& out : {Vec3(-2, 5, 0), Vec3(12, 5, 0), Vec3(5, -2, 0), Vec3(5, 12, 0), Vec3(-2, -2, 0)}) {
    Vec3 at(5, 5, 1);
    renderer->restart(at);
    Vec3 in(5, 5, -0.5), beyond = out;
    beyond.z() = -0.5;
    EXPECT_TRUE(move(renderer, at, in, 0.07).contact);
    EXPECT_FALSE(move(renderer, at, beyond, 0.07).contact);
    EXPECT_EQ(renderer->counters().edges, 1u);
    EXPECT_FALSE(move(renderer, at, in, 0.07).contact) << "back under it: still free";
    EXPECT_EQ(renderer->counters().edges, 2u);
    EXPECT_FALSE(renderer->step({1e300, -1e300, 1e300}, 1e-3).contact);
    EXPECT_FALSE(renderer->step({5, 5, 3}, 1e-3).contact);
  }
}

// Whole paths.

Scene sinusoid() {
  return generated("sinusoid:points=251001:mesh=false");
}
trace::ProbePath weave(const Scene& scene, int depth_mm) {
  return path_over(scene, "weave:frames=6000:speed_mm_s=50:depth_mm=" + std::to_string(depth_mm));
}

TEST(HeightFieldRenderer, FollowsTheFormulaOfTheSinusoid) {
  const Scene s = sinusoid();
  const trace::ProbePath path = weave(s, 2);
  const auto truth = test::value_of(metrics::analytic_reference(*s.surface, path, 0.5, 0.0, {}));
  const auto renderer = prepared(s.input, "heightfield");
  const trace::ForceTrace trace = trace::replay(*renderer, path).value();
  int contacts = 0, wrong = 0;
  double worst = 0.0;
  for (std::size_t i = 0; i < trace.frames.size(); ++i) {
    const Frame& frame = trace.frames[i];
    const Frame& exact = truth.frames[i].frame;
    wrong += frame.contact != exact.contact;
    if (!frame.contact || !exact.contact) continue;
    ++contacts;
    worst = std::max(worst, (frame.god_object_mm - exact.god_object_mm).norm());
  }
  EXPECT_GT(contacts, 2000);
  EXPECT_LE(wrong, 2);
  // Posts 0.2 mm apart, curvature 0.32 per mm: the sheet lies within 0.0016 mm of the formula, its facets
  // within 0.032 of its direction, so that 2 mm below the foot moves by up to 0.13 mm.
  EXPECT_LT(worst, 0.15);
}

TEST(HeightFieldRenderer, TheGodObjectIsContinuous) {
  const Scene s = sinusoid();
  const trace::ProbePath path = weave(s, 1);
  const auto renderer = prepared(s.input, "heightfield");
  const auto nearest = prepared(s.input, "heightfield:shading=nearest");
  const auto worst_jump = [&](HapticRenderer& r) {
    const auto frames = trace::replay(r, path).value().frames;
    double worst = 0.0;
    for (std::size_t i = 1; i < frames.size(); ++i)
      if (frames[i].contact && frames[i - 1].contact)
        worst = std::max(worst, (frames[i].god_object_mm - frames[i - 1].god_object_mm).norm());
    return worst;
  };
  // The HIP moves 0.05 mm a frame; posts are 0.2 mm apart in plan view, up to 0.7 along the slope.
  EXPECT_LT(worst_jump(*renderer), 0.15);
  EXPECT_GT(worst_jump(*nearest), 0.2);
}

TEST(HeightFieldRenderer, TheForceLimitKeepsTheDirection) {
  SceneInput scene = scene_of(posts(9, 9, 1.0, flat));
  scene.force_limit_n = 0.25;
  for (const char* name : {"heightfield", "heightfield-literal:response=lookup"}) {
    const auto renderer = prepared(scene, name);
    Vec3 at(4, 4, 1);
    renderer->restart(at);
    const Frame frame = move(renderer, at, {4.1, 4.2, -2}, 0.1);
    EXPECT_NEAR((frame.force_n - Vec3(0, 0, 0.25)).norm(), 0.0, 1e-9);
  }
}

}  // namespace
}  // namespace palpate::render
