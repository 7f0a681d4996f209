// What a hand feels as plainly wrong: caught, lost, kicked.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "tests/toolkit/messages.h"
#include "tests/toolkit/metrics/small_traces.h"
#include "toolkit/metrics/scores.h"

namespace palpate::metrics {
namespace {

constexpr double kDeep = -1.0;

/// So many frames at one depth.
void stay(Tiny& t, int frames, double z_mm = kDeep) {
  for (int i = 0; i < frames; ++i) t.add(z_mm);
}

TEST(Moments, LostIsTrueContactWithoutAForceForTwentyMilliseconds) {
  for (const int frames : {20, 21}) {
    Tiny t({0.5});
    stay(t, 5);
    for (int i = 0; i < frames; ++i) {
      render::Frame& frame = t.add(kDeep);
      frame.contact = false;
      frame.force_n = Vec3::Zero();
      frame.god_object_mm = t.path.hip_mm.back();
    }
    stay(t, 5);
    const Accuracy a = t.scored().value();
    EXPECT_EQ(a.lost, frames == 21 ? 1u : 0u) << frames;
    EXPECT_EQ(a.lost_frames, frames == 21 ? 21u : 0u);
    EXPECT_EQ(a.caught, 0u) << "a free god object is not caught";
  }
  Tiny shallow({0.5});
  for (int i = 0; i < 50; ++i) shallow.add(-0.05).force_n = Vec3::Zero();
  EXPECT_EQ(shallow.scored()->lost, 0u) << "a tenth of a millimetre is no depth";
}

TEST(Moments, CaughtIsAGodObjectFarFromTheTrueOne) {
  // Two spacings are 2 / 1.5 of the local resolution: of coarse points more than a millimetre.
  for (const auto& [off_mm, resolution_mm, caught] :
       {std::tuple{0.9, 0.1, 0u}, {1.1, 0.1, 1u}, {1.1, 3.0, 0u}, {4.1, 3.0, 1u}}) {
    Tiny t({0.5});
    for (int i = 0; i < 30; ++i) {
      render::Frame& frame = t.add(kDeep, resolution_mm);
      frame.god_object_mm.x() += off_mm;
      frame.force_n = kStiffness * (frame.god_object_mm - t.path.hip_mm.back());
    }
    const Accuracy a = t.scored().value();
    EXPECT_EQ(a.caught, caught) << off_mm << " of " << resolution_mm;
    EXPECT_EQ(a.caught_frames, 30u * caught);
  }
}

TEST(Moments, AHandThatIsHeldWhereTheTruthIsFreeIsCaughtAsWell) {
  Tiny t;
  for (int i = 0; i < 30; ++i) {
    render::Frame& frame = t.add(2.0);
    frame.contact = true;
    frame.god_object_mm.z() = 4.0;
    frame.force_n = Vec3(0, 0, 1);
  }
  EXPECT_EQ(t.scored()->caught, 1u);
  // History does not excuse it.
  for (trace::TruthFrame& frame : t.reference.frames) frame.history_decides = true;
  EXPECT_EQ(t.scored()->caught, 1u);
}

TEST(Moments, AKickIsAStepThatTheTruthHasNotNearby) {
  const auto kicks_of = [](double step_n, int true_step_after) {
    Tiny t({0.5});
    stay(t, 50);
    // The truth steps as well, so many frames later, from 0.5 to 1.5 N.
    for (int i = 0; i < 60; ++i) {
      const bool late = true_step_after >= 0 && i >= true_step_after;
      t.add(late ? 3.0 * kDeep : kDeep).force_n = Vec3(0, 0, 0.5 + step_n);
    }
    return t.scored()->kicks.value();
  };
  EXPECT_EQ(kicks_of(0.4, -1), 0u);
  EXPECT_EQ(kicks_of(0.6, -1), 1u);
  EXPECT_EQ(kicks_of(1.0, 10), 0u) << "the truth's own, a little earlier";
  EXPECT_EQ(kicks_of(1.0, 40), 1u);
}

TEST(Moments, TheLongestStretchAndTheLargestStepAreNamed) {
  Tiny t({0.5});
  stay(t, 50);
  for (const int frames : {25, 30}) {
    for (int i = 0; i < frames; ++i) t.add(kDeep).force_n = Vec3::Zero();
    stay(t, 50);
  }
  t.add(kDeep).force_n = Vec3(0, 0, 0.9);
  const ContactArtefacts wrong = find_artefacts(t.path, t.trace.frames, t.reference.frames);
  EXPECT_EQ(wrong.lost.episodes, 2u);
  EXPECT_EQ(wrong.lost.frames, 55u);
  EXPECT_EQ(wrong.lost.longest_at, 126u);
  EXPECT_DOUBLE_EQ(wrong.kick_max_n, 0.5) << "to 0 and back, each time; 0.4 at the end";
  EXPECT_EQ(wrong.kicks, 0u);
}

TEST(Moments, ThePeakIsComparedWithTheTruths) {
  Tiny t({0.5});
  stay(t, 10);
  t.add(kDeep).force_n = Vec3(0, 0, 0.8);
  const Accuracy a = t.scored().value();
  EXPECT_DOUBLE_EQ(*a.force_peak_n, 0.8);
  EXPECT_NEAR(*a.force_peak_excess_percent, 60.0, 1e-9);
}

// Scores that must not be talked round: what a renderer of no force, a late one and a trembling one get.

/// Ten strokes into the half space, 1.5 mm deep, along x at 50 mm/s and 1 kHz.
Tiny strokes(double resolution_mm = 0.1) {
  Tiny t;
  for (int i = 0; i < 6000; ++i)
    t.add(0.5 - 1.0 * (1.0 - std::cos(2.0 * std::numbers::pi * i / 600.0)), resolution_mm, 0.05 * i);
  return t;
}

TEST(Felt, TheTruthCannotBeToldFromItself) {
  const Accuracy a = strokes().scores();
  EXPECT_EQ(a.indistinguishable_percent, 100.0);
  EXPECT_EQ(a.indistinguishable_interval->low, 100.0);
  EXPECT_EQ(a.felt_percent, 100.0);
  EXPECT_EQ(a.lag_ms, 0.0);
  EXPECT_EQ(a.ripple_ratio, 0.0);
  EXPECT_EQ(a.relief_ratio, 0.0);
  EXPECT_EQ(a.jump_errors, 0u);
  EXPECT_EQ(a.episodes, 10u);
  EXPECT_DOUBLE_EQ(*a.pop_through_rate_upper_95, 0.3);
  EXPECT_EQ(*a.caught + *a.lost + *a.kicks + *a.caught_frames + *a.lost_frames, 0u);
  EXPECT_NEAR(*a.force_peak_n, 0.75, 1e-9);
  EXPECT_EQ(a.force_peak_excess_percent, 0.0);
}

TEST(Felt, NoForceIsNothingMissedOnlyWhereTheToleranceHidesIt) {
  Tiny t = strokes(2.0);  // a resolution deeper than the path
  for (render::Frame& frame : t.trace.frames) frame = {};
  for (std::size_t i = 0; i < t.path.size(); ++i) t.trace.frames[i].god_object_mm = t.path.hip_mm[i];
  const Accuracy a = t.scores();
  EXPECT_EQ(a.missed_contact_frames, 0u) << "what hid it";
  EXPECT_GT(*a.missed_device_frames, 3000u);
  EXPECT_EQ(a.felt_percent, 0.0);
  EXPECT_EQ(a.indistinguishable_percent, 0.0);
  EXPECT_DOUBLE_EQ(*a.force_rms_percent, 100.0);
  EXPECT_EQ(a.direction_p99_deg, 180.0) << "a lost force has no good direction";
  EXPECT_FALSE(a.lag_ms.has_value());
}

TEST(Felt, ALittleForceEverywhereBettersNothing) {
  Tiny t = strokes();
  for (render::Frame& frame : t.trace.frames) frame.force_n *= 1.2;
  const Result<Accuracy> wrong = t.scored();
  for (render::Frame& frame : t.trace.frames)
    if (frame.force_n.isZero(0.0)) frame.force_n.z() = 1e-9;
  const Result<Accuracy> padded = t.scored();
  ASSERT_TRUE(wrong && padded);
  EXPECT_NEAR(*padded->force_rms_n, *wrong->force_rms_n, 1e-12);
  EXPECT_EQ(padded->within_7_percent, wrong->within_7_percent);
  EXPECT_EQ(padded->contact_frames, wrong->contact_frames);
  EXPECT_NEAR(*wrong->force_rms_percent, 20.0, 1e-9);
  // All episodes are alike: the interval is the number.
  EXPECT_NEAR(wrong->force_rms_percent_interval->low, 20.0, 1e-9);
}

TEST(Felt, ALateForceIsFoundOutAndByHowMuch) {
  for (const std::size_t late : {5u, 20u, 60u}) {
    const Tiny truth = strokes();
    Tiny t = truth;
    for (std::size_t i = 0; i < t.trace.frames.size(); ++i)
      t.trace.frames[i].force_n = truth.trace.frames[i < late ? 0 : i - late].force_n;
    const Accuracy a = t.scores();
    EXPECT_NEAR(*a.lag_ms, static_cast<double>(late), 1e-9);
    // Five samples are within the threshold of force everywhere on this path: only the lag sees them.
    if (late > 5) {
      EXPECT_LT(*a.indistinguishable_percent, kRequiredSharePercent) << late;
    }
  }
}

TEST(Felt, ATrembleIsNoLessForBeingRightOnTheMean) {
  Tiny t = strokes();
  for (std::size_t i = 0; i < t.trace.frames.size(); ++i)
    if (t.trace.frames[i].contact) t.trace.frames[i].force_n.z() += i % 2 == 0 ? 0.02 : -0.02;
  const Accuracy a = t.scores();
  EXPECT_GT(*a.jump_errors, a.contact_frames * 9 / 10);
  EXPECT_NEAR(*a.jump_error_max_n, 0.04, 1e-3);
  EXPECT_LT(*a.indistinguishable_percent, 10.0);
}

TEST(Felt, AJumpTheWrongWayIsAJump) {
  // The truth rises by 0.02 N and the renderer falls by as much: neither moves more than the other.
  Tiny t({-1.0, -1.04});
  t.add(-1.0);
  t.trace.frames[1].force_n.z() = 0.5 - 0.02;
  const Accuracy a = t.scores();
  EXPECT_EQ(a.excess_jumps, 0u);
  EXPECT_EQ(a.jump_errors, 2u);
  EXPECT_NEAR(*a.jump_error_max_n, 0.04, 1e-12);
}

TEST(Felt, RippleIsMeasuredWhereItIs) {
  // 0.05 N at 200 Hz on constant contact: by hand and device of 195 g some 0.16 um, where 0.2 um is noticed.
  Tiny t;
  for (int i = 0; i < 2048; ++i) {
    t.add(-1.0);
    t.trace.frames.back().force_n.z() += 0.05 * std::sin(2.0 * std::numbers::pi * 0.2 * i);
  }
  const Accuracy a = t.scores();
  EXPECT_NEAR(*a.ripple_hz, 200.0, 4.0);
  const double w = 2.0 * std::numbers::pi * 200.0;
  const double moved_um = 0.05e6 / std::hypot(400.0 - 0.195 * w * w, 4.5 * w);
  EXPECT_NEAR(*a.ripple_ratio, moved_um / 0.2, 0.05 * moved_um / 0.2);
}

TEST(Felt, ReliefIsMeasuredAgainstItsWidth) {
  // A ridge of 0.05 mm and 3 mm width on a way of 60 mm: it is noticed from 0.027 mm on at 3 mm, and within
  // any 1 mm of it stands nearly all of its slope.
  Tiny t;
  for (int i = 0; i < 1200; ++i) {
    const double x = 0.05 * i;
    t.add(-1.0, 0.1, x);
    const double bump =
        std::abs(x - 30.0) < 1.5 ? 0.025 * (1.0 + std::cos((x - 30.0) * std::numbers::pi / 1.5)) : 0.0;
    t.trace.frames.back().god_object_mm.z() += bump;
  }
  const Accuracy a = t.scores();
  EXPECT_GT(*a.relief_ratio, 1.0);
  for (render::Frame& frame : t.trace.frames) frame.god_object_mm.z() *= 0.1;
  EXPECT_LT(*t.scored()->relief_ratio, 1.0);
}

TEST(Felt, ContactThatFallsThroughIsCountedOncePerFall) {
  Tiny t = strokes();
  for (std::size_t i = 250; i < 260; ++i) t.trace.frames[i].force_n.setZero();
  for (std::size_t i = 330; i < 350; ++i) t.trace.frames[i].force_n.setZero();
  EXPECT_EQ(t.scored()->fall_throughs, 2u);
  EXPECT_FALSE(t.scored()->pop_through_rate_upper_95.has_value());
}

TEST(ContactFlags, MustSayWhatTheForceSays) {
  const Tiny good = strokes();
  const AccuracyOptions options;
  EXPECT_TRUE(check_contact_flags(good.path, good.trace, options));
  Tiny t = good;
  t.trace.frames[0].force_n.z() = 1e-9;  // free, and a force
  Status said = check_contact_flags(t.path, t.trace, options);
  ASSERT_TRUE(test::refused(said, "sample 0"));
  t = good;
  t.trace.frames[300].force_n.setZero();  // contact, and none
  said = check_contact_flags(t.path, t.trace, options);
  EXPECT_TRUE(test::refused(said, "sample 300"));
  t.trace.frames[300].god_object_mm = t.path.hip_mm[300];  // it touches and does not press
  EXPECT_TRUE(check_contact_flags(t.path, t.trace, options));
}

TEST(EnergyByEpisode, ASpringThatKeepsItsPromisesMakesNone) {
  const Tiny t = strokes();
  auto e = test::value_of(observe_energy(t.path, t.trace, kStiffness));
  ASSERT_TRUE(observe_episodes(t.path, t.trace, t.reference, std::vector<double>{kStiffness}, e));
  EXPECT_LT(*e.drawdown_percent, 1e-9);
}

TEST(EnergyByEpisode, WhatIsMadeAfterMuchWasTakenIsStillMade) {
  // Friction first takes 2 mJ; then the renderer pushes harder on the way out than on the way in. Over the
  // whole path nothing is made.
  Tiny t = strokes();
  for (std::size_t i = 150; i < 300; ++i) t.trace.frames[i].force_n.x() = -0.4;
  for (std::size_t i = 4500; i < 4650; ++i) t.trace.frames[i].force_n.x() = 0.1;
  auto e = test::value_of(observe_energy(t.path, t.trace, kStiffness));
  ASSERT_TRUE(observe_episodes(t.path, t.trace, t.reference, std::vector<double>{kStiffness}, e));
  EXPECT_EQ(e.generated_percent, 0.0);
  // 0.1 N over 7.5 mm is 0.75 mJ; the true contact stores 0.5 x 0.5 x 1.5^2 = 0.5625 mJ.
  EXPECT_NEAR(*e.drawdown_percent, 100.0 * 0.75 / 0.5625, 3.0);
  EXPECT_LT(*e.drawdown_p50_percent, 1e-9) << "the other episodes made none";
}

TEST(EnergyByEpisode, AWeakRendererIsMeasuredByTheTruesStore) {
  Tiny t = strokes();
  for (render::Frame& frame : t.trace.frames) frame.force_n.setZero();
  for (std::size_t i = 300; i < 310; ++i) t.trace.frames[i].force_n.x() = 1e-3;
  Result<Energy> e = observe_energy(t.path, t.trace, kStiffness);
  ASSERT_TRUE(observe_episodes(t.path, t.trace, t.reference, std::vector<double>{kStiffness}, *e));
  EXPECT_GT(*e->generated_percent, 100.0) << "of its own tiny store";
  EXPECT_LT(*e->drawdown_percent, 1.0);
}

// The passivity observer over replays.

TEST(Energy, IsThatWorkedOutByHand) {
  Tiny spring({0.0, -1.0, -2.0, -1.0, 0.0});
  // After resting at 2 mm the force is twice what it was. In: 0.25 + 0.75. Out: (2 + 1) / 2 + (1 + 0) / 2
  // = 2. E ends at -1; stored at most 2^2 / (2 x 0.5) = 4.
  Tiny kick({0.0, -1.0, -2.0, -2.0, -1.0, 0.0});
  for (const std::size_t i : {3u, 4u}) kick.trace.frames[i].force_n *= 2.0;
  Tiny friction;  // moving along +x against -0.1 N
  for (const double x : {0.0, 1.0}) friction.add(-1.0, 0.1, x).force_n.x() = -0.1;
  // In 2 mm at 0.25 N/mm (soft), aside to 0.5 N/mm (rigid), and out: the step of section 3.3.2.3. In 0.5 mJ;
  // aside nothing, the force stands across; out 1 mJ. So 0.5 mJ from nowhere, of 1 mJ stored at most.
  Tiny border({0.0, -2.0});
  border.trace.frames[1].force_n *= 0.5;
  border.add(-2.0, 0.1, 1.0);
  border.add(0.0, 0.1, 1.0);
  const struct {
    const char* name;
    const Tiny* of;
    double final_mj, generated_mj, max_stored_mj;
  } energies[] = {{"spring", &spring, 0.0, 0.0, 1.0},  // 0.5 x 0.5 N/mm x (2 mm)^2
                  {"kick", &kick, -1.0, 1.0, 4.0},
                  {"friction", &friction, 0.1, 0.0, 0.26},
                  {"border", &border, -0.5, 0.5, 1.0}};
  for (const auto& [name, of, final_mj, generated_mj, max_stored_mj] : energies) {
    SCOPED_TRACE(name);
    const Energy e = observe_energy(of->path, of->trace, kStiffness).value();
    EXPECT_DOUBLE_EQ(e.final_mj, final_mj);
    EXPECT_DOUBLE_EQ(e.generated_mj, generated_mj);
    EXPECT_DOUBLE_EQ(e.max_stored_mj, max_stored_mj);
    EXPECT_DOUBLE_EQ(*e.generated_percent, 100.0 * generated_mj / max_stored_mj);
  }
}

TEST(Energy, KnowsWhatIsNoMoreThanRounding) {
  // A spring on a closed path far from the origin: what it seems to generate is rounding.
  constexpr double kFarMm = 1e5;
  Tiny t;
  for (int turn = 0; turn < 300; ++turn)
    for (const double z : {0.1, -0.3, -1.7, -0.9, 0.1}) t.add(z, 0.1, kFarMm + 0.1 * turn);
  const Energy e = observe_energy(t.path, t.trace, kStiffness).value();
  EXPECT_LT(e.rounding_mj, 1e-4 * e.max_stored_mj) << "0.01 % of what was stored is no rounding";
  EXPECT_GT(e.rounding_mj, 0.0);
  for (std::size_t i = 0; i < t.path.size(); ++i) t.path.hip_mm[i] += Vec3(0.1, 0.7, 1e4 / 3.0);
  const Energy moved = observe_energy(t.path, t.trace, kStiffness).value();
  EXPECT_NE(moved.final_mj, e.final_mj) << "moving it changes the last digits";
  EXPECT_LE(std::abs(moved.final_mj - e.final_mj), moved.rounding_mj + e.rounding_mj);
}

TEST(Energy, EachModelStoresWithItsOwnStiffness) {
  Tiny t({0.0, -1.0, 0.0});
  t.trace.frames[1].model = 1;
  // 0.5 N in a spring of 0.25 N/mm: 0.5 mJ. Of the first model's 0.5 N/mm it would be half of that.
  const std::array<double, 2> stiffness = {0.5, 0.25};
  EXPECT_DOUBLE_EQ(observe_energy(t.path, t.trace, stiffness)->max_stored_mj, 0.5);
  t.trace.frames[1].model = 7;
  EXPECT_DOUBLE_EQ(observe_energy(t.path, t.trace, stiffness)->max_stored_mj, 0.25) << "unknown: the first";
  EXPECT_FALSE(observe_energy(t.path, t.trace, std::array<double, 2>{0.5, 0.0}));
  EXPECT_FALSE(observe_energy(t.path, t.trace, std::span<const double>{}));
}

TEST(Energy, NothingWithoutContactAndNoNonsense) {
  Tiny t({1.0});
  const Energy e = observe_energy(t.path, t.trace, kStiffness).value();
  EXPECT_FALSE(e.generated_percent.has_value());
  EXPECT_EQ(e.generated_mj, 0.0);
  EXPECT_FALSE(observe_energy(t.path, t.trace, 0.0));
  t.trace.frames[0].force_n.x() = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(observe_energy(t.path, t.trace, kStiffness));
  t.trace.frames.clear();
  EXPECT_FALSE(observe_energy(t.path, t.trace, kStiffness));
}

}  // namespace
}  // namespace palpate::metrics
