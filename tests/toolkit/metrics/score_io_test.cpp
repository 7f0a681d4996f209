// Scores kept frame by frame, and scores made again from them.
#include "toolkit/metrics/score_io.h"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "tests/in_folder.h"
#include "tests/toolkit/metrics/tiny.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::metrics {
namespace {

class ScoreIo : public InFolder {
 protected:
  static std::string text(const std::string& file) {
    std::ifstream stream(file, std::ios::binary);
    std::ostringstream all;
    all << stream.rdbuf();
    return all.str();
  }
  static void write(const std::string& file, const std::string& text) {
    std::ofstream(file, std::ios::binary) << text;
  }
};

/// A god object that passes through, one frame missed, one false.
Tiny wrong_trace() {
  Tiny t;
  for (const double z : {1.0, 0.5, -0.3, -0.4, -0.5, -0.4, -0.3}) t.add(z);
  t.trace.frames[1].force_n = {0.1, 0, 0.2};
  t.trace.frames[1].contact = true;
  t.trace.frames[3].god_object_mm = {0, 0, -0.25};
  t.trace.frames[4] = {};
  t.trace.frames[4].god_object_mm = t.path.hip_mm[4];
  t.trace.frames[5].force_n = {1.0 / 3.0, 0.1, 0.7};
  return t;
}

std::string json(const Accuracy& accuracy) {
  ResultDocument document;
  document.renderers.emplace_back().accuracy = accuracy;
  return to_json(document);
}

TEST_F(ScoreIo, KeptAnswersOfTheSurfaceGiveTheSameScoresAgain) {
  const Tiny t = wrong_trace();
  AccuracyFrames frames;
  const Result<Accuracy> first = t.scored(&frames);
  ASSERT_TRUE(first);
  ASSERT_GT(*first->pop_throughs, 0u);
  ASSERT_GT(first->missed_contact_frames, 0u);
  ASSERT_GT(first->false_contact_frames, 0u);
  ASSERT_TRUE(write_scores_csv(t.path, frames, in("s.csv")));
  const Result<AccuracyFrames> kept = read_scores_csv(t.path, in("s.csv"));
  ASSERT_TRUE(kept) << kept.error().message();
  EXPECT_EQ(kept->force_error_n, frames.force_error_n);
  EXPECT_EQ(kept->excess_jump_n, frames.excess_jump_n);
  EXPECT_EQ(kept->god_object_error_mm, frames.god_object_error_mm);
  EXPECT_EQ(kept->missed_contact, frames.missed_contact);
  EXPECT_EQ(kept->false_contact, frames.false_contact);
  AccuracyFrames frames_again;
  const Result<Accuracy> again = score_again(t.path, t.trace, t.reference, kept->surface, {}, &frames_again);
  ASSERT_TRUE(again);
  EXPECT_EQ(json(*again), json(*first));
  ASSERT_TRUE(write_scores_csv(t.path, frames_again, in("t.csv")));
  EXPECT_EQ(text(in("t.csv")), text(in("s.csv")));
  // Without the answers the two scores that need them are nothing, and the others stay.
  const Result<Accuracy> without = score_again(t.path, t.trace, t.reference, std::nullopt, {});
  EXPECT_FALSE(without->pop_throughs || without->god_object_surface_rms_mm);
  EXPECT_EQ(without->force_rms_n, first->force_rms_n);
  SurfaceAnswers of_another = *kept->surface;
  of_another.god_object_distance_mm.pop_back();
  EXPECT_FALSE(score_again(t.path, t.trace, t.reference, of_another, {}));
}

TEST_F(ScoreIo, FrictionGoesOutAndComesBack) {
  Tiny t = wrong_trace();
  AccuracyOptions options;
  options.static_friction = options.dynamic_friction = 0.3;
  AccuracyFrames frames;
  const Result<Accuracy> first = score(t.path, t.trace, t.reference, &Tiny::half_space, options, &frames);
  ASSERT_TRUE(first);
  ASSERT_TRUE(first->friction_cone_percent);
  for (const bool forces : {true, false}) {
    if (!forces) {
      Accuracy kept_only = *first;
      keep_contact_scores(kept_only, frames);
    }
    ASSERT_TRUE(write_scores_csv(t.path, frames, in("f.csv")));
    EXPECT_NE(text(in("f.csv")).find(",friction_ratio,pop_throughs\n"), std::string::npos);
    const Result<AccuracyFrames> kept = read_scores_csv(t.path, in("f.csv"));
    ASSERT_TRUE(kept) << kept.error().message();
    EXPECT_EQ(kept->surface->friction_ratio, frames.surface->friction_ratio);
    EXPECT_EQ(kept->surface->pop_throughs, frames.surface->pop_throughs);
    EXPECT_EQ(kept->surface->god_object_distance_mm, frames.surface->god_object_distance_mm);
  }
}

TEST_F(ScoreIo, ContactScoresAloneAreKeptWhereForcesCannotBeCompared) {
  const Tiny t = wrong_trace();
  AccuracyFrames frames;
  Accuracy a = *t.scored(&frames);
  ASSERT_TRUE(a.excess_jumps && a.god_object_surface_rms_mm && a.god_object_surface_max_mm);
  const Accuracy before = a;
  keep_contact_scores(a, frames);
  for (const std::optional<double>& force :
       {a.force_rms_n, a.force_rms_percent, a.force_normal_rms_n, a.force_tangential_rms_n, a.force_max_n,
        a.within_7_percent, a.within_10_percent, a.direction_mean_deg, a.direction_p99_deg,
        a.direction_max_deg, a.excess_jump_max_n, a.excess_jumps_per_m, a.god_object_rms_mm,
        a.god_object_max_mm, a.god_object_surface_rms_mm, a.god_object_surface_max_mm, a.path_dependence_n})
    EXPECT_FALSE(force.has_value());
  EXPECT_FALSE(a.excess_jumps.has_value());
  EXPECT_EQ(a.missed_contact_frames, before.missed_contact_frames);
  EXPECT_EQ(a.pop_throughs, before.pop_throughs);
  EXPECT_EQ(a.onset_error_mm, before.onset_error_mm);
  ASSERT_TRUE(write_scores_csv(t.path, frames, in("s.csv")));
  EXPECT_TRUE(text(in("s.csv")).starts_with("t_s,missed,false,god_object_distance_mm,pop_throughs\n"));
  EXPECT_TRUE(read_scores_csv(t.path, in("s.csv"))->force_error_n.empty());
}

TEST_F(ScoreIo, WhatIsWrongIsNamedWithItsLine) {
  const Tiny t = wrong_trace();
  AccuracyFrames frames;
  ASSERT_TRUE(t.scored(&frames));
  ASSERT_TRUE(write_scores_csv(t.path, frames, in("s.csv")));
  const std::string good = text(in("s.csv")), header = good.substr(0, good.find('\n') + 1);
  const auto message = [&](const std::string& text) {
    write(in("s.csv"), text);
    const Result<AccuracyFrames> read = read_scores_csv(t.path, in("s.csv"));
    return read ? std::string("read") : read.error().message();
  };
  EXPECT_NE(message("t_s,missed\n0,0\n").find("s.csv:1: the header"), std::string::npos);
  EXPECT_NE(message(header + "0,2,0,0,0,0,0,0\n").find("s.csv:2: missed or false"), std::string::npos);
  EXPECT_NE(message(header + "0,0,0,0,0,0,0,3\n").find("s.csv:2: pop_throughs"), std::string::npos);
  EXPECT_NE(message(header + "0.5,0,0,0,0,0,0,0\n").find("s.csv:2: the row is of another time"),
            std::string::npos);
  EXPECT_NE(message(header + "0,0,0,0,0,0,0,0\n").find("1 rows for 7 rows"), std::string::npos);
  EXPECT_NE(message("").find("s.csv"), std::string::npos);
  EXPECT_EQ(message(good), "read");
  EXPECT_FALSE(read_scores_csv(t.path, in("none.csv")));
  Tiny longer = wrong_trace();
  longer.add(1.0);
  EXPECT_FALSE(write_scores_csv(longer.path, frames, in("s.csv")));
}

}  // namespace
}  // namespace palpate::metrics
