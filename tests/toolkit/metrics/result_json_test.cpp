// The result document: against docs/schemas/result.schema.json, there and back, and all that can be wrong.
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <fstream>
#include <limits>
#include <regex>
#include <sstream>
#include <tuple>
#include <utility>

#include "tests/files.h"
#include "tests/json_schema.h"
#include "tests/toolkit/messages.h"
#include "tests/toolkit/metrics/small_traces.h"
#include "toolkit/metrics/result_json.h"
#include "toolkit/metrics/scores.h"

namespace palpate::metrics {
namespace {

using Json = nlohmann::json;

ResultDocument full_document() {
  ResultDocument d;
  d.version = "0.1.0";
  d.commit = "abc";
  d.build = "Release, gcc";
  d.machine = {"a cpu", 2, 8'000'000'000, "Linux 6", "gcc 12"};
  d.scene = "scene.toml";
  d.path = "weave:frames=3";
  d.started_utc = "2026-01-31T12:00:00Z";
  d.command = "palpate compare \"scene.toml\"";
  d.warnings = {"the path never touches"};
  d.notes = {"no ground truth"};
  d.complete = false;
  d.title = "a scene, along a weave";
  d.about = "What it is about.";
  d.models = {{"dragon", "dragon.ply", "0123456789abcdef", 1'002'001, "model-1.csv"},
              {"plane", "plane:points=9", "fedcba9876543210", 9, ""}};
  d.truth = StudyTruth{"analytic", "exact", "reference.csv", "00112233445566ff"};
  d.path_hash = "ff00112233445566";
  d.conditions = MeasurementConditions{"performance", "madvise", "avx2", "x86-64", "-O3", {{"CGAL", "5.5.1"}},
                                       0.5,           1.5,       2.5,    30,       15.0,  12};
  d.scoring = ScoreBasis{0.5, 0.055, 1e-6, {0.5, 0.25}, false, 0.7, 0.5};
  RendererResult r;
  r.label = "smooth";
  r.name = "cloud";
  r.options = {{"shading", "auto"}, {"box", "worst"}};
  r.model = RendererResult::Model{1'002'001, 0.288};
  r.prepare = render::PrepareReport{
      12.5, {{"grid", 4.5}, {"neighbours", 8.0}}, 48'096'048, 0, {"shading off"}, {"rough"}};
  r.threads = 2;
  trace::FrameStatistics s;
  s.frames = 50'000;
  s.contact_frames = s.timed_frames = 40'000;
  s.min_us = 0.05;
  s.mean_us = 0.1;
  s.mean_clocked_us = 0.12;
  s.p50_us = 0.09;
  s.p99_us = 0.3;
  s.p999_us = 0.7;
  s.max_us = 1234.5;
  s.deadline_misses_1khz = 1;
  s.bound_hits = 3;
  s.clock_overhead_ns = 21.0;
  s.mean_interval_us = Interval{0.09, 0.11};
  s.p999_interval_us = Interval{0.6, 0.9};
  s.cpu_mean_us = 0.1;
  s.worst_us = 4000.0;
  s.passes = s.clocked_passes = 30;
  s.episodes = 50;
  r.frame = r.frame_free = r.frame_all = s;
  r.prepare_clock = PrepareTimes{12.5, 20.5, true};
  r.timing = TimingConditions{"truth", true, 4, 1, 12, 0};
  r.paced = trace::PacedStatistics{s, 1.0, 17, 0, 2};
  r.paced_evicted = trace::PacedStatistics{s, 1.0, 17, 64u << 20u, 900};
  Accuracy a;
  a.reference = "analytic";
  a.exactness = "exact";
  a.floor_n = 0.0275;
  a.rounding_n = 1e-6;
  a.rounding_mm = 2e-6;
  a.force_rms_n = 0.1;
  a.within_7_percent = 99.5;
  a.excess_jumps = 4;
  a.pop_throughs = 0;
  a.onset_error_mm = 0.05;
  a.episodes = 50;
  a.force_rms_percent_interval = Interval{0.5, 0.75};
  a.missed_device_frames = 7;
  a.indistinguishable_percent = 99.25;
  r.accuracy = a;
  r.energy = Energy{0.5, 0.01, 2.0, 0.1, 1e-9, 0.75, 0.25};
  r.trace_hash = "0123456789abcdef";
  r.role = render::Role::kLiteral;
  r.works_on = render::Geometry::kHeights;
  r.missing = {"dents"};
  r.trace_file = "trace-smooth.csv";
  r.scores_file = "scores-smooth.csv";
  d.renderers.push_back(r);
  RendererResult failed;
  failed.label = failed.name = "mesh-godobject";
  failed.status = RunStatus::kFailed;
  failed.reason = "no mesh";
  d.renderers.push_back(failed);
  return d;
}

TEST(ResultJson, FollowsTheSchema) {
  EXPECT_EQ(schema_violations(PALPATE_RESULT_SCHEMA, to_json(full_document())), "");
  EXPECT_EQ(schema_violations(PALPATE_RESULT_SCHEMA, to_json({})), "");
}

TEST(ResultJson, TheSchemaHoldsEveryPartOfTheDocument) {
  const Json whole = Json::parse(to_json(full_document()));
  const std::pair<const char*, Json> broken[] = {{"/renderers/0/frame/bound_hits", -1},
                                                 {"/renderers/0/frame/mean_us", "fast"},
                                                 {"/renderers/0/status", "perhaps"},
                                                 {"/renderers/0/trace_hash", "no hash"},
                                                 {"/renderers/0/accuracy/unheard_of", 1},
                                                 {"/renderers/0/role", "friend"},
                                                 {"/renderers/0/works_on", "voxels"},
                                                 {"/scoring/forces_comparable", 1},
                                                 {"/models/0/hash", "abc"},
                                                 {"/machine/cores", 1.5},
                                                 {"/schema", "palpate-result/0"},
                                                 {"/renderers/0/frame/mean_interval_us", 1},
                                                 {"/renderers/0/timing/contact_of", "mine"},
                                                 {"/renderers/0/prepare/from_cache", 1},
                                                 {"/conditions/libraries/CGAL", 5},
                                                 {"/warnings/0", Json::object()}};
  for (const auto& [where, value] : broken) {
    Json j = whole;
    j[Json::json_pointer(where)] = value;
    EXPECT_NE(schema_violations(PALPATE_RESULT_SCHEMA, j.dump()), "") << where << " may be " << value;
  }
  Json missing = whole;
  missing["renderers"][0]["frame"].erase("bound_hits");
  EXPECT_TRUE(test::contains(schema_violations(PALPATE_RESULT_SCHEMA, missing.dump()), "bound_hits"));
}

TEST(ResultJson, HasTheKeysOtherToolsRelyOn) {
  const Json j = Json::parse(to_json(full_document()));
  for (const char* key :
       {"schema", "commit", "build", "machine", "scene", "path", "started_utc", "renderers"}) {
    EXPECT_TRUE(j.contains(key)) << key;
  }
  const std::pair<const char*, const char*> parts[] = {
      {"", "name options label status threads frame_paced trace_hash"},
      {"/model", "points resolution_mm"},
      {"/prepare", "total_ms"},
      {"/prepare/phases/0", "name ms"},
      {"/memory", "bytes bytes_per_point"},
      {"/frame",
       "frames contact_frames min_us mean_us p50_us p99_us p999_us max_us deadline_misses_1khz "
       "clock_overhead_ns bound_hits"},
      {"/frame_all", "mean_us"},
      {"/accuracy",
       "reference force_rms_n force_rms_percent force_max_n within_7_percent direction_p99_deg "
       "excess_jump_max_n excess_jumps missed_contact_frames false_contact_frames longest_stick_frames "
       "pop_throughs god_object_rms_mm god_object_max_mm onset_error_mm release_error_mm"},
      {"/energy", "generated_percent"}};
  for (const auto& [part, keys] : parts) {
    std::istringstream all(keys);
    for (std::string key; all >> key;)
      EXPECT_TRUE(j["renderers"][0].contains(Json::json_pointer(part + ("/" + key)))) << part << " " << key;
  }
  EXPECT_DOUBLE_EQ(j["renderers"][0]["memory"]["bytes_per_point"].get<double>(), 48.0);
  EXPECT_TRUE(j["renderers"][0]["accuracy"]["force_rms_percent"].is_null());
  for (const char* key : {"model", "prepare", "memory", "frame", "frame_all", "frame_paced", "accuracy",
                          "energy", "trace_hash"}) {
    EXPECT_TRUE(j["renderers"][1][key].is_null()) << key;
  }
  EXPECT_EQ(j["renderers"][1]["status"], "failed");
  EXPECT_EQ(j["renderers"][1]["reason"], "no mesh");
}

TEST(ResultJson, ThereAndBackIsTheSameText) {
  const std::string text = to_json(full_document());
  EXPECT_EQ(to_json(test::value_of(parse_result(text))), text);
}

TEST(ResultJson, NumbersThatAreNotFiniteBecomeNull) {
  ResultDocument d = full_document();
  d.renderers[0].frame->mean_us = std::numeric_limits<double>::quiet_NaN();
  d.renderers[0].accuracy->force_rms_n = std::numeric_limits<double>::infinity();
  const std::string text = to_json(d);
  EXPECT_FALSE(test::contains(text, "nan"));
  const auto back = test::value_of(parse_result(text));
  EXPECT_FALSE(back.renderers[0].frame->mean_us || back.renderers[0].accuracy->force_rms_n);
}

TEST(ResultJson, BytesThatAreNoUtf8DoNotThrow) {
  ResultDocument d;
  d.scene = "scan\xff.ply";
  EXPECT_TRUE(parse_result(to_json(d)));
}

TEST(ResultJson, RefusesWhatItDidNotWrite) {
  for (const char* text : {"", "{", "[]", "3", "null", "{\"schema\": 7}", "{}"}) {
    EXPECT_FALSE(parse_result(text)) << text;
  }
  EXPECT_TRUE(test::refused(parse_result("{\"schema\": \"palpate-result/99\"}", "old.json"),
                            "old.json: the schema is 'palpate-result/99'"));

  const Json good = Json::parse(to_json(full_document()));
  const std::tuple<const char*, Json, const char*> refused[] = {
      {"/renderers", 3, "renderers"},
      {"/renderers/0", "x", "renderers[0]"},
      {"/renderers/0/status", "fine", "renderers[0].status"},
      {"/renderers/0/frame", 3, "renderers[0].frame"},
      {"/renderers/0/frame/frames", -1, "renderers[0].frame.frames"},
      {"/renderers/0/frame/mean_us", "fast", "renderers[0].frame.mean_us"},
      {"/renderers/0/prepare/phases", 1, "phases"},
      {"/renderers/0/prepare/phases/0", 1, "phases"},
      {"/renderers/0/options/box", 1, "options"},
      {"/renderers/0/threads", 4e9, "threads"},
      {"/machine", "mine", "machine"},
      {"/warnings", "mine", "warnings"},
      {"/renderers/0/prepare/warnings/0", 1, "renderers[0].prepare.warnings"},
      {"/renderers/0/frame/mean_interval_us", Json::array({1, "x"}), "mean_interval_us"},
      {"/renderers/0/prepare/from_cache", 3, "from_cache"},
      {"/conditions/libraries/CGAL", 3, "libraries"}};
  for (const auto& [where, value, named] : refused) {
    Json bad = good;
    bad[Json::json_pointer(where)] = value;
    EXPECT_TRUE(test::refused(parse_result(bad.dump()), named)) << where;
  }
  Json missing = good;
  missing["renderers"][1].erase("label");
  EXPECT_TRUE(test::contains(parse_result(missing.dump()).error().what, "renderers[1].label is missing"));
}

TEST(ResultJson, ReadsDocumentsFromBeforeAKeyWasAdded) {
  ResultDocument whole = full_document();
  whole.renderers[0].stream.emplace().failed = 3;
  Json j = Json::parse(to_json(whole));
  j["schema"] = "palpate-result/1";
  for (const char* key : {"path_hash", "conditions"}) j.erase(key);
  for (const char* key : {"timing", "frame_free"}) j["renderers"][0].erase(key);
  for (const char* key : {"wall_ms", "cpu_ms", "from_cache"}) j["renderers"][0]["prepare"].erase(key);
  for (const char* key : {"mean_interval_us", "p50_interval_us", "passes", "episodes", "worst_us"})
    j["renderers"][0]["frame"].erase(key);
  for (const char* key : {"felt_percent", "missed_device_frames", "indistinguishable_interval", "episodes"})
    j["renderers"][0]["accuracy"].erase(key);
  j["renderers"][0]["energy"].erase("drawdown_percent");
  j["truth"].erase("hash");
  j.erase("warnings");
  j.erase("notes");
  j["renderers"][0]["prepare"].erase("warnings");
  j["renderers"][0]["frame"].erase("mean_clocked_us");
  j["renderers"][0]["accuracy"].erase("rounding_n");
  j["renderers"][0]["energy"].erase("rounding_mj");
  ASSERT_EQ(j["renderers"][0]["stream"].erase("failed"), 1u);
  const auto back = test::value_of(parse_result(j.dump()));
  EXPECT_TRUE(back.warnings.empty());
  EXPECT_EQ(back.schema, "palpate-result/1");
  EXPECT_FALSE(back.conditions || back.renderers[0].timing || back.renderers[0].frame_free);
  EXPECT_FALSE(back.renderers[0].prepare_clock.has_value());
  EXPECT_FALSE(back.renderers[0].accuracy->missed_device_frames.has_value());
  EXPECT_FALSE(back.renderers[0].frame->mean_clocked_us.has_value());
  EXPECT_EQ(back.renderers[0].accuracy->rounding_n, 0.0);
  EXPECT_EQ(back.renderers[0].stream->failed, 0u);
}

TEST(ResultJson, ToleratesKeysItDoesNotKnow) {
  Json j = Json::parse(to_json(full_document()));
  j["renderers"][0]["frame"]["p42_us"] = 3;
  j["later"] = {1, 2};
  EXPECT_TRUE(parse_result(j.dump()));
}

TEST(ResultJson, DeepNestingIsNoStackOverflow) {
  EXPECT_FALSE(parse_result(std::string(1'000'000, '[')));
}

TEST(MachineInfo, SaysSomething) {
  const MachineInfo m = machine_info();
  EXPECT_FALSE(m.cpu.empty() || m.kernel.empty() || m.compiler.empty());
  EXPECT_GE(m.cores, 1);
  EXPECT_TRUE(std::regex_match(utc_now(), std::regex("\\d{4}-\\d\\d-\\d\\dT\\d\\d:\\d\\d:\\d\\dZ")))
      << utc_now();
}

// Scores kept frame by frame, and scores made again from them.

class ScoreIo : public InFolder {
 protected:
  static std::string text(const std::string& file) {
    std::ifstream stream(file, std::ios::binary);
    std::ostringstream all;
    all << stream.rdbuf();
    return all.str();
  }
};

/// A god object that passes through, one frame missed, one false.
Tiny wrong_trace() {
  Tiny t({1.0, 0.5, -0.3, -0.4, -0.5, -0.4, -0.3});
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
  const Accuracy first = t.scores(&frames);
  ASSERT_GT(*first.pop_throughs, 0u);
  ASSERT_GT(first.missed_contact_frames, 0u);
  ASSERT_GT(first.false_contact_frames, 0u);
  ASSERT_TRUE(write_scores_csv(t.path, frames, in("s.csv")));
  const auto kept = test::value_of(read_scores_csv(t.path, in("s.csv")));
  EXPECT_EQ(kept.force_error_n, frames.force_error_n);
  EXPECT_EQ(kept.excess_jump_n, frames.excess_jump_n);
  EXPECT_EQ(kept.god_object_error_mm, frames.god_object_error_mm);
  EXPECT_EQ(kept.missed_contact, frames.missed_contact);
  EXPECT_EQ(kept.false_contact, frames.false_contact);
  AccuracyFrames frames_again;
  const auto again = test::value_of(rescore(t.path, t.trace, t.reference, kept.surface, {}, &frames_again));
  EXPECT_EQ(json(again), json(first));
  ASSERT_TRUE(write_scores_csv(t.path, frames_again, in("t.csv")));
  EXPECT_EQ(text(in("t.csv")), text(in("s.csv")));
  // Without the answers the two scores that need them are nothing, and the others stay.
  const Result<Accuracy> without = rescore(t.path, t.trace, t.reference, std::nullopt, {});
  EXPECT_FALSE(without->pop_throughs || without->god_object_surface_rms_mm);
  EXPECT_EQ(without->force_rms_n, first.force_rms_n);
  TruthSamples of_another = *kept.surface;
  of_another.god_object_distance_mm.pop_back();
  EXPECT_FALSE(rescore(t.path, t.trace, t.reference, of_another, {}));
}

TEST_F(ScoreIo, FrictionGoesOutAndComesBack) {
  Tiny t = wrong_trace();
  AccuracyOptions options;
  options.static_friction = options.dynamic_friction = 0.3;
  AccuracyFrames frames;
  const auto first = test::value_of(t.scored(&frames, options));
  ASSERT_TRUE(first.friction_cone_percent);
  for (const bool forces : {true, false}) {
    if (!forces) {
      Accuracy kept_only = first;
      keep_contact_scores(kept_only, frames);
    }
    ASSERT_TRUE(write_scores_csv(t.path, frames, in("f.csv")));
    EXPECT_TRUE(test::contains(text(in("f.csv")), ",friction_ratio,pop_throughs\n"));
    const auto kept = test::value_of(read_scores_csv(t.path, in("f.csv")));
    EXPECT_EQ(kept.surface->friction_ratio, frames.surface->friction_ratio);
    EXPECT_EQ(kept.surface->pop_throughs, frames.surface->pop_throughs);
    EXPECT_EQ(kept.surface->god_object_distance_mm, frames.surface->god_object_distance_mm);
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
    std::ofstream(in("s.csv"), std::ios::binary) << text;
    const Result<AccuracyFrames> read = read_scores_csv(t.path, in("s.csv"));
    return read ? std::string("read") : read.error().message();
  };
  EXPECT_TRUE(test::contains(message("t_s,missed\n0,0\n"), "s.csv:1: the header"));
  EXPECT_TRUE(test::contains(message(header + "0,2,0,0,0,0,0,0\n"), "s.csv:2: missed or false"));
  EXPECT_TRUE(test::contains(message(header + "0,0,0,0,0,0,0,3\n"), "s.csv:2: pop_throughs"));
  EXPECT_TRUE(test::contains(message(header + "0.5,0,0,0,0,0,0,0\n"), "s.csv:2: the row is of another time"));
  EXPECT_TRUE(test::contains(message(header + "0,0,0,0,0,0,0,0\n"), "1 rows for 7 rows"));
  EXPECT_TRUE(test::contains(message(""), "s.csv"));
  EXPECT_EQ(message(good), "read");
  EXPECT_FALSE(read_scores_csv(t.path, in("none.csv")));
  Tiny longer = wrong_trace();
  longer.add(1.0);
  EXPECT_FALSE(write_scores_csv(longer.path, frames, in("s.csv")));
}

}  // namespace
}  // namespace palpate::metrics
