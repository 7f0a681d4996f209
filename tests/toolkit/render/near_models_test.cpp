// Which of many models a frame looks at, against looking at every box.
#include "toolkit/render/near_models.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/geometry/segment_box.h"

namespace palpate::render {
namespace {

constexpr double kTick = 1e-3;
const auto kNothingTouched = [](std::uint32_t) { return false; };

/// Cubes in a square lattice, free space between them.
std::vector<ModelBox> lattice(std::size_t side, double size_mm, double apart_mm) {
  std::vector<ModelBox> boxes;
  for (std::size_t i = 0; i < side * side; ++i) {
    const Vec3 at{apart_mm * static_cast<double>(i % side), apart_mm * static_cast<double>(i / side), 0.0};
    boxes.push_back({{at, at + Vec3::Constant(size_mm)}, {}, nullptr});
  }
  return boxes;
}

bool touches(const ModelBox& box, const Vec3& from, const Vec3& to) {
  return geometry::segment_touches_box({from, to}, box.local_mm.centre_mm(),
                                       0.5 * Vec3(box.local_mm.extent_mm()));
}

TEST(NearModels, NothingOnTheWayIsMissedAndEveryModelIsEnteredFromWhereTheHipWasClear) {
  Random random(11);
  for (const double scale : {1e-3, 1.0, 1e6}) {
    const std::vector<ModelBox> boxes = lattice(16, 10.0 * scale, 14.0 * scale);
    NearModels near;
    near.build(boxes);
    Vec3 at = Vec3::Constant(-5.0 * scale);
    near.restart(at, 0.0, [](std::uint32_t, const Vec3&, double) {});
    std::set<std::uint32_t> listed(near.models().begin(), near.models().end());
    for (int i = 1; i < 4000; ++i) {
      // Steps of all lengths: rest, strokes, and jumps through the whole lattice.
      const double step = scale * std::pow(10.0, random.uniform(-3.0, 2.5));
      Vec3 to{at.x() + step * random.uniform(-1.0, 1.0), at.y() + step * random.uniform(-1.0, 1.0),
              at.z() + 0.1 * step * random.uniform(-1.0, 1.0)};
      if (!(std::abs(to.x()) < 300.0 * scale) || !(std::abs(to.y()) < 300.0 * scale) ||
          !(std::abs(to.z()) < 20.0 * scale)) {
        to = scale * Vec3(random.uniform(0.0, 220.0), random.uniform(0.0, 220.0), random.uniform(-5.0, 15.0));
      }
      std::set<std::uint32_t> entered;
      near.choose(
          to, kTick * i,
          [&](std::uint32_t model, const Vec3& from, double) {
            EXPECT_EQ(from, at);
            entered.insert(model);
          },
          kNothingTouched);
      const std::span<const std::uint32_t> found = near.models();
      EXPECT_TRUE(std::is_sorted(found.begin(), found.end()));
      const std::set<std::uint32_t> now(found.begin(), found.end());
      EXPECT_EQ(now.size(), found.size()) << "a model is listed twice";
      for (std::uint32_t model = 0; model < boxes.size(); ++model) {
        if (touches(boxes[model], at, to)) {
          EXPECT_TRUE(now.contains(model)) << "frame " << i << ", model " << model;
        }
        if (now.contains(model) && !listed.contains(model)) {
          EXPECT_TRUE(entered.contains(model)) << "frame " << i << ", model " << model;
        }
      }
      listed = now;
      near.done(to, kTick * i);
      at = to;
    }
  }
}

TEST(NearModels, AfterAJumpThroughManyOnlyNeighboursAreLookedAt) {
  const std::vector<ModelBox> boxes = lattice(32, 10.0, 14.0);
  NearModels near;
  near.build(boxes);
  const auto nothing = [](std::uint32_t, const Vec3&, double) {};
  Vec3 at{5.0, 5.0, 11.0};
  near.restart(at, 0.0, nothing);
  EXPECT_LE(near.models().size(), 1U);
  // From corner to corner: the box around the way holds all 1,024.
  Vec3 to{5.0 + 31 * 14.0, 5.0 + 31 * 14.0, 9.9};
  near.choose(to, kTick, nothing, kNothingTouched);
  const std::size_t on_the_way = near.models().size();
  EXPECT_GE(on_the_way, 32U);
  EXPECT_LE(on_the_way, 3 * 32U) << "the diagonal and what lies beside it";
  near.done(to, kTick);
  for (int i = 2; i < 10; ++i) {
    to.z() -= 0.1;
    near.choose(to, kTick * i, nothing, kNothingTouched);
    EXPECT_EQ(near.models().size(), 1U);
    near.done(to, kTick * i);
  }
}

TEST(NearModels, OfTooManyForAnAnswerThoseNearAreLookedAt) {
  // A hundred models in one place, and a thousand far away.
  std::vector<ModelBox> boxes = lattice(32, 10.0, 14.0);
  for (ModelBox& box : boxes) {
    box.local_mm.low_mm.x() += 1e4;
    box.local_mm.high_mm.x() += 1e4;
  }
  for (int i = 0; i < 100; ++i) boxes.push_back({{Vec3::Zero(), Vec3::Constant(10.0)}, {}, nullptr});
  NearModels near;
  near.build(boxes);
  const auto nothing = [](std::uint32_t, const Vec3&, double) {};
  near.restart(Vec3(5.0, 5.0, 10.5), 0.0, nothing);
  EXPECT_EQ(near.models().size(), 100U);
  near.choose(Vec3(5.0, 5.0, 9.9), kTick, nothing, kNothingTouched);
  EXPECT_EQ(near.models().size(), 100U);
  EXPECT_EQ(near.models().front(), 1024U);
}

TEST(NearModels, WhatIsTouchedStaysHoweverFarTheHipHasGone) {
  const std::vector<ModelBox> boxes = lattice(4, 10.0, 14.0);
  NearModels near;
  near.build(boxes);
  const auto nothing = [](std::uint32_t, const Vec3&, double) {};
  const auto first_touched = [](std::uint32_t model) { return model == 0; };
  near.restart(Vec3(5.0, 5.0, 10.1), 0.0, nothing);
  Vec3 at{5.0, 5.0, 9.0};
  for (int i = 1; i < 50; ++i) {
    near.choose(at, kTick * i, nothing, first_touched);
    const std::span<const std::uint32_t> found = near.models();
    EXPECT_EQ(std::count(found.begin(), found.end(), 0U), 1) << "frame " << i;
    near.done(at, kTick * i);
    at.z() -= i % 7 == 0 ? 30.0 : 0.2;
  }
}

}  // namespace
}  // namespace palpate::render
