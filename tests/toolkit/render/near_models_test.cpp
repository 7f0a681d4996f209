// Which of many models a frame looks at, against looking at every box.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <set>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/render/correction_ramp.h"
#include "toolkit/render/near_models.h"
#include "toolkit/render/surface_response.h"

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

// A jump of the god object comes over frames, without a step and without energy.

constexpr double kRounding = 1e-12;

/// A contact whose place is told from outside, in the place of a model.
struct Contact {
  CorrectionRamp spread;
  Vec3 h = Vec3::Zero(), pull = Vec3::Zero();
  bool felt = false;

  /// The HIP goes to `hip`, where `place` holds it or nothing does.
  void to(const Vec3& hip, const std::optional<Vec3>& place) {
    h = hip;
    SurfaceContact contact;
    contact.pull = place ? Vec3(*place - h) : Vec3(Vec3::Zero());
    felt = spread.answer(h, place.has_value(), contact, [] {});
    pull = contact.pull;
  }
  [[nodiscard]] Vec3 shown() const { return h + pull; }
};

TEST(CorrectionRamp, ChangesTheForceByABoundedRateAndEndsAtThePlace) {
  const Vec3 nearer(0.3, 0, 0.4), sideways(1, 0, 0), farther(0, 0, 2.5), nothing(0, 0, 0);
  for (const Vec3& before : {Vec3(1, 0, 1.2), nothing})
    for (const Vec3& place : {nearer, sideways, farther}) {
      SCOPED_TRACE(testing::Message() << before.transpose() << " to " << place.transpose());
      const bool free = before == nothing;
      if (!free && place == farther) continue;  // waits for the hand
      Contact at;
      at.to(Vec3::Zero(), free ? std::nullopt : std::optional(before));
      Vec3 last = before;
      const double most = (free ? place.norm() : before.norm()) / CorrectionRamp::kFrames;
      for (int i = 0; i < 2 * CorrectionRamp::kFrames; ++i) {  // from one end of a pull to the other
        at.to(Vec3::Zero(), place);
        EXPECT_TRUE(at.felt);
        EXPECT_LE((at.pull - last).norm(), most + kRounding);
        EXPECT_TRUE(i > 0 || at.spread.active());
        last = at.pull;
      }
      at.to(Vec3::Zero(), place);
      EXPECT_EQ(at.pull, place);
      EXPECT_FALSE(at.spread.active());
    }
}

TEST(CorrectionRamp, LeavesAGodObjectAloneThatSlidesAsTheHipDoes) {
  Contact at;
  for (int i = 0; i < 100; ++i) {
    const Vec3 h(0.05 * i, 0, -1), place(0.12 * i, 0, 0);
    at.to(h, place);
    EXPECT_EQ(at.pull, place - h);
  }
  at.to({4.95, 0, 0.01}, {});
  EXPECT_TRUE(at.felt) << "a millimetre of pull may not end at once";
}

TEST(CorrectionRamp, AHipThatIsSetFreeIsLetGoBitByBit) {
  Contact at;
  double last = 0.8;
  at.to(Vec3::Zero(), Vec3(0, 0, last));
  for (int i = 0; i < CorrectionRamp::kFrames; ++i) {
    at.to(Vec3::Zero(), {});
    EXPECT_NEAR(last - at.pull.norm(), 0.8 / CorrectionRamp::kFrames, kRounding) << i;
    last = at.pull.norm();
  }
  at.to(Vec3::Zero(), {});
  EXPECT_FALSE(at.felt);
}

// The hand comes out while a jump is still shown: no pull grows, and none changes by more than the hand moved
// and the jump's share.
TEST(CorrectionRamp, AHipThatCameOutMeanwhileIsLetGoBitByBit) {
  Contact at;
  const Vec3 place(0, 0, 0.5);
  at.to(Vec3::Zero(), Vec3(0, 0, 1));
  at.to(Vec3::Zero(), place);
  const Vec3 out(0, 0, 0.6);
  double moved = out.z(), last = at.pull.norm();
  for (int i = 0; i < CorrectionRamp::kFrames; ++i) {
    at.to(out, {});
    const double now = at.felt ? at.pull.norm() : 0.0;
    EXPECT_LE(now, last);
    EXPECT_LE(last - now, moved + 1.0 / CorrectionRamp::kFrames) << i;
    last = now;
    moved = 0.0;
  }
  EXPECT_FALSE(at.felt);
}

// Held again while it fades: the spring is as short as it is until the hand has gone where it is as long.
TEST(CorrectionRamp, AForceThatFadedGrowsAgainByTheHandAlone) {
  const Vec3 place(0, 0, 1);
  Contact at;
  at.to(Vec3::Zero(), place);
  for (int i = 0; i < CorrectionRamp::kFrames / 2; ++i) at.to(Vec3::Zero(), {});
  const double faded = at.pull.norm();
  ASSERT_NEAR(faded, 0.5, kRounding);
  for (int i = 0; i < 3 * CorrectionRamp::kFrames; ++i) at.to(Vec3::Zero(), place);
  EXPECT_NEAR(at.pull.norm(), faded, kRounding);
  at.to({0, 0, -0.2}, place);
  EXPECT_NEAR(at.pull.norm(), faded + 0.2, kRounding);
  at.to({0, 0, 1.1}, {});
  EXPECT_FALSE(at.felt);
  at.to({0, 0, 0.6}, place);
  EXPECT_EQ(at.pull, place - at.h);
}

TEST(CorrectionRamp, OnlyDescendsWhileTheHipMoves) {
  Random random(5);
  const auto within = [&](double most) {
    return Vec3(random.uniform(-most, most), random.uniform(-most, most), random.uniform(-most, most));
  };
  for (int jump = 0; jump < 200; ++jump) {
    Contact at;
    const Vec3 before = within(2.0), place = 0.9 * before.norm() * within(1.0).normalized();
    Vec3 h = Vec3::Zero(), shown = before;
    at.to(h, before);
    for (int i = 0; i < 3 * CorrectionRamp::kFrames; ++i) {
      at.to(h, place);
      if (!at.spread.active() && shown == place) break;
      EXPECT_LE(at.pull.norm(), (shown - h).norm() + kRounding) << jump << ", frame " << i;
      shown = at.shown();
      h += within(0.1);
    }
  }
}

// To and fro between two places, each taken as the HIP comes back from there: a god object that went all the
// way would pull the hand along in each half.
TEST(CorrectionRamp, MakesNoEnergyOnAClosedPath) {
  constexpr int kPeriod = 40, kRounds = 5;
  constexpr double kStiffness = 0.5, kReach = 1.0, kChange = 0.2;
  const Vec3 left(-1, 0, 0.2), right(1, 0, 0.2);
  Contact at;
  at.to({kReach, 0, 0}, right);
  const double stored_mj = 0.5 * kStiffness * at.pull.squaredNorm();
  bool on_right = true;
  double given_mj = 0.0;
  for (int i = 1; i <= kRounds * kPeriod; ++i) {
    const Vec3 h(kReach * std::cos(2.0 * std::numbers::pi * i / kPeriod), 0, 0);
    const Vec3 shown = at.shown();
    // The spring's work on the hand, which moves while the god object stands.
    given_mj += 0.5 * kStiffness * ((shown - at.h).squaredNorm() - (shown - h).squaredNorm());
    const bool changes =
        on_right ? h.x() < -kChange && h.x() > at.h.x() : h.x() > kChange && h.x() < at.h.x();
    on_right = on_right != changes;
    at.to(h, on_right ? right : left);
  }
  EXPECT_LE(given_mj + 0.5 * kStiffness * at.pull.squaredNorm(), stored_mj + kRounding);
}

TEST(CorrectionRamp, AHipThatJumpsTakesNoSpringAlong) {
  for (const bool held : {true, false}) {
    Contact at;
    const auto place = [&](const Vec3& h) {
      return held ? std::optional(Vec3(h + Vec3(0, 0, 0.3))) : std::nullopt;
    };
    at.to(Vec3::Zero(), Vec3(0, 0, 1));
    at.to(Vec3::Zero(), place(Vec3::Zero()));
    const double before = at.pull.norm();
    const Vec3 far(40, 0, 0);
    for (int i = 0; i <= CorrectionRamp::kFrames; ++i) {
      at.to(far, place(far));
      EXPECT_LE(at.pull.norm(), before + kRounding) << held << ", frame " << i;
    }
    EXPECT_EQ(at.felt, held);
  }
}

TEST(CorrectionRamp, ANewContactKnowsNothingOfTheLast) {
  Contact at;
  at.to(Vec3::Zero(), Vec3(0, 0, 1));
  at.to(Vec3::Zero(), Vec3(0, 0, 0.5));
  at.spread.end();
  at.to(Vec3::Zero(), Vec3(0, 0, 0.4));
  EXPECT_EQ(at.pull, Vec3(0, 0, 0.4));
}

}  // namespace
}  // namespace palpate::render
