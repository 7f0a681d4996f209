// What is said of renderers that answer otherwise than each other, on traces made by hand.
#include "experiments/run/disagreement.h"
#include "tests/experiments/program.h"

#include <gtest/gtest.h>

#include <palpate/accuracy.h>

namespace palpate::experiments {
namespace {

constexpr double kTick = 1e-3;
constexpr std::size_t kFrames = 400;
/// Frames whose first and last are just kMinArtefactS apart.
constexpr std::size_t kMomentFrames = static_cast<std::size_t>(metrics::kMinArtefactS / kTick + 0.5) + 1;

struct Away {
  std::size_t run = 0, begin = 0, frames = 0;
  Vec3 by = Vec3::Zero();
  bool contact = true;
};

/// Renderers that are held 2 mm above a HIP at 0.1 mm a frame along x, but for what is away.
StagedStudy study_of(const std::vector<std::string>& labels, const std::vector<Away>& away) {
  StagedStudy study;
  for (std::size_t i = 0; i < kFrames; ++i) {
    study.stage.path.t_s.push_back(static_cast<double>(i) * kTick);
    study.stage.path.hip_mm.emplace_back(0.1 * static_cast<double>(i), 5.0, -2.0);
  }
  for (const std::string& label : labels) {
    Run& run = study.runs.emplace_back();
    run.result.label = label;
    for (const Vec3& hip : study.stage.path.hip_mm) {
      render::Frame frame;
      frame.contact = true;
      frame.god_object_mm = hip + Vec3(0, 0, 2);
      frame.force_n = {0, 0, 1};
      run.trace.frames.push_back(frame);
    }
  }
  for (const Away& a : away)
    for (std::size_t i = a.begin; i < a.begin + a.frames; ++i) {
      render::Frame& frame = study.runs[a.run].trace.frames[i];
      frame.god_object_mm += a.by;
      frame.contact = a.contact;
      frame.force_n = a.contact ? Vec3(0, 0, 2.5) : Vec3(Vec3::Zero());
    }
  return study;
}

const Vec3 kFar(0, 0, 3);

TEST(Disagreement, NothingIsSaidOfRenderersThatAgree) {
  EXPECT_TRUE(disagreements(study_of({"a", "b", "c"}, {})).empty());
  EXPECT_TRUE(disagreements(study_of({"a", "b", "c"}, {{1, 100, 60, Vec3(0, 0, 0.9)}})).empty());
}

TEST(Disagreement, SaysWhereHowLongAndWhoStandsAlone) {
  const auto said = disagreements(study_of({"a", "b", "c"}, {{1, 100, 61, kFar}}));
  ASSERT_EQ(said.size(), 2u);
  EXPECT_EQ(
      said[0],
      "The renderers disagree by more than 1.00 mm in 1 stretch, 0.0600 s of 0.399 s: there is no truth that "
      "says who is right.");
  EXPECT_EQ(said[1],
            "b stands alone for 0.0600 s from 0.100 s on, the HIP at 10.0, 5.00, -2.00 mm: 2.50 N where it "
            "begins.");
}

TEST(Disagreement, SaysThatTheLoneOneFeelsNothing) {
  const auto said = disagreements(study_of({"a", "b", "c"}, {{2, 50, 41, Vec3(0, 0, -2), false}}));
  ASSERT_EQ(said.size(), 2u);
  EXPECT_EQ(said[1],
            "c stands alone for 0.0400 s from 0.0500 s on, the HIP at 5.00, 5.00, -2.00 mm: it feels "
            "nothing, the others do.");
}

TEST(Disagreement, WhatIsShorterThanAMomentIsNotTold) {
  EXPECT_TRUE(disagreements(study_of({"a", "b", "c"}, {{0, 9, kMomentFrames - 1, kFar}})).empty());
  // Half a frame of room, as times are rounded.
  EXPECT_EQ(disagreements(study_of({"a", "b", "c"}, {{0, 9, kMomentFrames + 1, kFar}})).size(), 2u);
}

TEST(Disagreement, OfTwoAndOfThreeThatAreAllApartNobodyStandsAlone) {
  const auto two = disagreements(study_of({"a", "b"}, {{1, 0, 100, Vec3(0, 0, -2), false}}));
  ASSERT_EQ(two.size(), 2u);
  EXPECT_EQ(
      two[1],
      "There is no majority for 0.0990 s from 0 s on, the HIP at 0, 5.00, -2.00 mm: a, b (feels nothing).");
  const auto three = disagreements(study_of({"a", "b", "c"}, {{1, 20, 100, kFar}, {2, 20, 100, -kFar}}));
  ASSERT_EQ(three.size(), 2u);
  EXPECT_THAT(three[1], HasSubstr("no majority"));
}

TEST(Disagreement, ListsTheLongestFew) {
  const auto said = disagreements(study_of(
      {"a", "b", "c"}, {{0, 0, 31, kFar}, {1, 50, 61, kFar}, {2, 150, 41, kFar}, {0, 220, 51, kFar}}));
  ASSERT_EQ(said.size(), 4u);
  EXPECT_THAT(said[0], HasSubstr("in 4 stretches, 0.180 s of"));
  for (std::size_t i = 1; i < said.size(); ++i)
    EXPECT_TRUE(said[i].starts_with(i == 1 ? "b" : i == 2 ? "a" : "c")) << said[i];
}

TEST(Disagreement, CoarsePointsMayDifferByTwoSpacings) {
  StagedStudy study = study_of({"a", "b", "c"}, {{1, 100, 61, kFar}});
  study.stage.spacing.nearest_mm.p50 = 1.4;
  EXPECT_EQ(disagreements(study).size(), 2u);
  study.stage.spacing.nearest_mm.p50 = 1.6;
  EXPECT_TRUE(disagreements(study).empty());
}

TEST(Disagreement, WhereThereIsATruthItSaysWhoIsRight) {
  StagedStudy study = study_of({"a", "b", "c"}, {{1, 100, 61, kFar}});
  study.stage.reference.emplace();
  EXPECT_TRUE(disagreements(study).empty());
}

TEST(Disagreement, ARunWithoutItsWholeTraceDoesNotCount) {
  StagedStudy study = study_of({"a", "b"}, {{1, 100, 61, kFar}});
  study.runs[1].trace.frames.clear();
  EXPECT_TRUE(disagreements(study).empty());
}

}  // namespace
}  // namespace palpate::experiments
