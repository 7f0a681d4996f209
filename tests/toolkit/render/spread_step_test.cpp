// A correction of the place held comes over frames, without a step and without energy.
#include "toolkit/render/spread_step.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <optional>

#include "toolkit/core/random.h"

namespace palpate::render {
namespace {

constexpr double kRounding = 1e-12;

/// A contact whose place is told from outside, in the place of a model.
struct Corrected {
  SpreadStep spread;
  Vec3 h = Vec3::Zero(), pull = Vec3::Zero();
  bool felt = false;

  /// The HIP goes to `hip`, where `place` holds it or nothing does; `before` held it until this frame.
  void to(const Vec3& hip, const std::optional<Vec3>& place, const std::optional<Vec3>& before = {}) {
    h = hip;
    pull = place ? Vec3(*place - h) : Vec3(Vec3::Zero());
    felt = place.has_value();
    const Vec3 uncorrected = before ? Vec3(*before - h) : Vec3(Vec3::Zero());
    if (before || spread.active())
      felt = spread.apply(h, before ? &uncorrected : nullptr, place.has_value(), pull);
  }
  [[nodiscard]] Vec3 shown() const { return h + pull; }
};

TEST(SpreadStep, ChangesTheForceByABoundedRateAndEndsAtThePlace) {
  const Vec3 nearer(0.3, 0, 0.4), sideways(1, 0, 0), farther(0, 0, 2.5), nothing(0, 0, 0);
  for (const Vec3& before : {Vec3(1, 0, 1.2), nothing})
    for (const Vec3& place : {nearer, sideways, farther}) {
      SCOPED_TRACE(testing::Message() << before.transpose() << " to " << place.transpose());
      Corrected at;
      Vec3 last = before;
      for (int i = 0; i < SpreadStep::kFrames; ++i) {
        at.to(Vec3::Zero(), place, i == 0 ? std::optional(before) : std::nullopt);
        EXPECT_TRUE(at.felt);
        EXPECT_LE((at.pull - last).norm(), (place - before).norm() / SpreadStep::kFrames + kRounding);
        EXPECT_EQ(at.spread.active(), i + 1 < SpreadStep::kFrames);
        last = at.pull;
      }
      EXPECT_EQ(last, place);
    }
}

TEST(SpreadStep, AHipThatIsSetFreeIsLetGoBitByBit) {
  Corrected at;
  double last = 0.8;
  for (int i = 0; i < SpreadStep::kFrames; ++i) {
    at.to(Vec3::Zero(), {}, i == 0 ? std::optional(Vec3(0, 0, last)) : std::nullopt);
    EXPECT_EQ(at.felt, i + 1 < SpreadStep::kFrames) << i;
    EXPECT_NEAR(last - at.pull.norm(), 0.8 / SpreadStep::kFrames, kRounding) << i;
    last = at.pull.norm();
  }
  EXPECT_FALSE(at.spread.active());
}

// It comes out while a correction is still shown: what is left of that goes as the rest did, and no pull
// grows.
TEST(SpreadStep, AHipThatCameOutMeanwhileIsLetGoBitByBit) {
  for (const bool was_let_go : {false, true}) {
    Corrected at;
    const std::optional<Vec3> place = Vec3(0, 0, 0.5);
    at.to(Vec3::Zero(), was_let_go ? std::nullopt : place, Vec3(0, 0, 1));
    at.to(Vec3::Zero(), place);
    double last = at.pull.norm();
    const Vec3 out(0, 0, 0.6);
    for (int i = 2; i < SpreadStep::kFrames; ++i) {
      at.to(out, {});
      EXPECT_EQ(at.felt, i + 1 < SpreadStep::kFrames) << i;
      const double now = at.felt ? at.pull.norm() : 0.0;
      if (i == 2) {
        EXPECT_LT(now, last - 0.5) << "the hand went towards it";
      } else {
        EXPECT_NEAR(last - now, last / (SpreadStep::kFrames - i), kRounding) << i;
      }
      last = now;
    }
    EXPECT_FALSE(at.spread.active());
  }
}

// Held again while it fades: the spring is as short as it is until the hand has gone where it is as long.
TEST(SpreadStep, AForceThatFadedGrowsAgainByTheHandAlone) {
  const Vec3 place(0, 0, 1);
  Corrected at;
  at.to(Vec3::Zero(), {}, place);
  for (int i = 1; i < SpreadStep::kFrames / 2; ++i) at.to(Vec3::Zero(), {});
  const double faded = at.pull.norm();
  ASSERT_NEAR(faded, 0.5, kRounding);
  for (int i = 0; i < 3 * SpreadStep::kFrames; ++i) at.to(Vec3::Zero(), place);
  EXPECT_NEAR(at.pull.norm(), faded, kRounding);
  at.to({0, 0, -0.2}, place);
  EXPECT_NEAR(at.pull.norm(), faded + 0.2, kRounding);
  at.to({0, 0, 1.1}, {});
  EXPECT_FALSE(at.felt);
  at.to({0, 0, 0.6}, place);
  EXPECT_EQ(at.pull, place - at.h);
}

TEST(SpreadStep, OnlyDescendsWhileTheHipMoves) {
  Random random(5);
  const auto within = [&](double most) {
    return Vec3(random.uniform(-most, most), random.uniform(-most, most), random.uniform(-most, most));
  };
  for (int correction = 0; correction < 200; ++correction) {
    Corrected at;
    const Vec3 before = within(2.0), place = 0.9 * before.norm() * within(1.0).normalized();
    Vec3 h = Vec3::Zero(), shown = before;
    for (int i = 0; i < 3 * SpreadStep::kFrames; ++i) {
      at.to(h, place, i == 0 ? std::optional(before) : std::nullopt);
      if (!at.spread.active() && shown == place) break;
      EXPECT_LE(at.pull.norm(), (shown - h).norm() + kRounding) << correction << ", frame " << i;
      shown = at.shown();
      h += within(0.1);
    }
  }
}

// To and fro between two places, each corrected to the nearer one as the HIP comes back from there: a god
// object that went all the way would pull the hand along in each half.
TEST(SpreadStep, MakesNoEnergyOnAClosedPath) {
  constexpr int kPeriod = 40, kRounds = 5;
  constexpr double kStiffness = 0.5, kReach = 1.0, kChange = 0.2;
  const Vec3 left(-1, 0, 0.2), right(1, 0, 0.2);
  Corrected at;
  at.to({kReach, 0, 0}, right);
  const double stored_mj = 0.5 * kStiffness * at.pull.squaredNorm();
  bool on_right = true;
  double given_mj = 0.0;
  for (int i = 1; i <= kRounds * kPeriod; ++i) {
    const Vec3 h(kReach * std::cos(2.0 * std::numbers::pi * i / kPeriod), 0, 0);
    const Vec3 shown = at.shown(), before = on_right ? right : left;
    // The spring's work on the hand, which moves while the god object stands.
    given_mj += 0.5 * kStiffness * ((shown - at.h).squaredNorm() - (shown - h).squaredNorm());
    const bool changes =
        on_right ? h.x() < -kChange && h.x() > at.h.x() : h.x() > kChange && h.x() < at.h.x();
    on_right = on_right != changes;
    at.to(h, on_right ? right : left, changes ? std::optional(before) : std::nullopt);
  }
  EXPECT_LE(given_mj + 0.5 * kStiffness * at.pull.squaredNorm(), stored_mj + kRounding);
}

TEST(SpreadStep, AHipThatJumpsTakesNoSpringAlong) {
  for (const bool held : {true, false}) {
    Corrected at;
    const auto place = [&](const Vec3& h) {
      return held ? std::optional(Vec3(h + Vec3(0, 0, 0.3))) : std::nullopt;
    };
    at.to(Vec3::Zero(), place(Vec3::Zero()), Vec3(0, 0, 1));
    const double before = at.pull.norm();
    const Vec3 far(40, 0, 0);
    at.to(far, place(far));
    for (int i = 0; i < SpreadStep::kFrames; ++i) {
      EXPECT_LE(at.pull.norm(), before + kRounding) << held << ", frame " << i;
      at.to(far, place(far));
    }
    EXPECT_EQ(at.felt, held);
  }
}

TEST(SpreadStep, ANewContactKnowsNothingOfTheLast) {
  Corrected at;
  at.to(Vec3::Zero(), Vec3(0, 0, 0.5), Vec3(0, 0, 1));
  at.spread.end();
  at.to(Vec3::Zero(), Vec3(0, 0, 0.4));
  EXPECT_EQ(at.pull, Vec3(0, 0, 0.4));
}

}  // namespace
}  // namespace palpate::render
