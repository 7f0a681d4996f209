// The result document: against docs/result.schema.json, there and back, and with everything that can be wrong
// with it.
#include "toolkit/metrics/result_json.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <regex>

#include "tests/json_schema.h"

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
  d.conditions = Conditions{"performance", "madvise", "avx2", "x86-64", "-O3", {{"CGAL", "5.5.1"}},
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
  r.prepare_clock = PrepareClock{12.5, 20.5, true};
  r.timing = TimingOf{"truth", true, 4, 1};
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
  const auto breaks = [&](const char* where, const Json& value) {
    Json j = whole;
    j[Json::json_pointer(where)] = value;
    const std::string wrong = schema_violations(PALPATE_RESULT_SCHEMA, j.dump());
    return wrong.empty() ? std::string(where) + " may be " + value.dump() : std::string();
  };
  EXPECT_EQ(breaks("/renderers/0/frame/bound_hits", -1), "");
  EXPECT_EQ(breaks("/renderers/0/frame/mean_us", "fast"), "");
  EXPECT_EQ(breaks("/renderers/0/status", "perhaps"), "");
  EXPECT_EQ(breaks("/renderers/0/trace_hash", "no hash"), "");
  EXPECT_EQ(breaks("/renderers/0/accuracy/unheard_of", 1), "");
  EXPECT_EQ(breaks("/renderers/0/role", "friend"), "");
  EXPECT_EQ(breaks("/renderers/0/works_on", "voxels"), "");
  EXPECT_EQ(breaks("/scoring/forces_comparable", 1), "");
  EXPECT_EQ(breaks("/models/0/hash", "abc"), "");
  EXPECT_EQ(breaks("/machine/cores", 1.5), "");
  EXPECT_EQ(breaks("/schema", "palpate-result/0"), "");
  EXPECT_EQ(breaks("/renderers/0/frame/mean_interval_us", 1), "");
  EXPECT_EQ(breaks("/renderers/0/timing/contact_of", "mine"), "");
  EXPECT_EQ(breaks("/renderers/0/prepare/from_cache", 1), "");
  EXPECT_EQ(breaks("/conditions/libraries/CGAL", 5), "");
  EXPECT_EQ(breaks("/warnings/0", Json::object()), "");
  Json missing = whole;
  missing["renderers"][0]["frame"].erase("bound_hits");
  EXPECT_NE(schema_violations(PALPATE_RESULT_SCHEMA, missing.dump()).find("bound_hits"), std::string::npos);
}

TEST(ResultJson, HasTheKeysOtherToolsRelyOn) {
  const Json j = Json::parse(to_json(full_document()));
  for (const char* key :
       {"schema", "commit", "build", "machine", "scene", "path", "started_utc", "renderers"}) {
    EXPECT_TRUE(j.contains(key)) << key;
  }
  for (const char* where : {"/name",
                            "/options",
                            "/label",
                            "/status",
                            "/threads",
                            "/model/points",
                            "/model/resolution_mm",
                            "/prepare/total_ms",
                            "/prepare/phases/0/name",
                            "/prepare/phases/0/ms",
                            "/memory/bytes",
                            "/memory/bytes_per_point",
                            "/frame/frames",
                            "/frame/contact_frames",
                            "/frame/min_us",
                            "/frame/mean_us",
                            "/frame/p50_us",
                            "/frame/p99_us",
                            "/frame/p999_us",
                            "/frame/max_us",
                            "/frame/deadline_misses_1khz",
                            "/frame/clock_overhead_ns",
                            "/frame/bound_hits",
                            "/frame_all/mean_us",
                            "/frame_paced",
                            "/accuracy/reference",
                            "/accuracy/force_rms_n",
                            "/accuracy/force_rms_percent",
                            "/accuracy/force_max_n",
                            "/accuracy/within_7_percent",
                            "/accuracy/direction_p99_deg",
                            "/accuracy/excess_jump_max_n",
                            "/accuracy/excess_jumps",
                            "/accuracy/missed_contact_frames",
                            "/accuracy/false_contact_frames",
                            "/accuracy/longest_stick_frames",
                            "/accuracy/pop_throughs",
                            "/accuracy/god_object_rms_mm",
                            "/accuracy/god_object_max_mm",
                            "/accuracy/onset_error_mm",
                            "/accuracy/release_error_mm",
                            "/energy/generated_percent",
                            "/trace_hash"}) {
    EXPECT_TRUE(j["renderers"][0].contains(Json::json_pointer(where))) << where;
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
  const Result<ResultDocument> back = parse_result(text);
  ASSERT_TRUE(back) << back.error().message();
  EXPECT_EQ(to_json(*back), text);
  EXPECT_EQ(back->renderers[0].prepare->bytes, 48'096'048u);
  EXPECT_EQ(back->renderers[0].prepare->warnings, std::vector<std::string>{"rough"});
  EXPECT_EQ(back->warnings, std::vector<std::string>{"the path never touches"});
  EXPECT_EQ(back->renderers[0].frame->mean_clocked_us, 0.12);
  EXPECT_EQ(back->renderers[0].accuracy->rounding_mm, 2e-6);
  EXPECT_EQ(back->renderers[0].energy->rounding_mj, 1e-9);
  EXPECT_EQ(back->notes, std::vector<std::string>{"no ground truth"});
  EXPECT_EQ(back->renderers[0].paced_evicted->first_frame, 17u);
  EXPECT_EQ(back->renderers[0].accuracy->pop_throughs, 0u);
  EXPECT_EQ(back->renderers[0].role, render::Role::kLiteral);
  EXPECT_EQ(back->renderers[0].works_on, render::Geometry::kHeights);
  EXPECT_EQ(back->renderers[0].missing, std::vector<std::string>{"dents"});
  EXPECT_EQ(back->renderers[0].frame_free->mean_interval_us->high, 0.11);
  EXPECT_TRUE(back->renderers[0].prepare_clock->from_cache);
  EXPECT_EQ(back->renderers[0].timing->pinned_cpu, 1u);
  EXPECT_EQ(back->conditions->libraries.front().second, "5.5.1");
  EXPECT_EQ(back->models[1].source, "plane:points=9");
  EXPECT_EQ(back->scoring->felt_stiffness_n_per_mm, (std::vector<double>{0.5, 0.25}));
  EXPECT_FALSE(back->renderers[1].frame.has_value());
  EXPECT_EQ(back->renderers[1].status, RunStatus::kFailed);
}

TEST(ResultJson, NumbersThatAreNotFiniteBecomeNull) {
  ResultDocument d = full_document();
  d.renderers[0].frame->mean_us = std::numeric_limits<double>::quiet_NaN();
  d.renderers[0].accuracy->force_rms_n = std::numeric_limits<double>::infinity();
  const std::string text = to_json(d);
  EXPECT_EQ(text.find("nan"), std::string::npos);
  const Result<ResultDocument> back = parse_result(text);
  ASSERT_TRUE(back);
  EXPECT_FALSE(back->renderers[0].frame->mean_us || back->renderers[0].accuracy->force_rms_n);
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
  const Result<ResultDocument> other = parse_result("{\"schema\": \"palpate-result/99\"}", "old.json");
  ASSERT_FALSE(other);
  EXPECT_NE(other.error().message().find("old.json: the schema is 'palpate-result/99'"), std::string::npos);

  const Json good = Json::parse(to_json(full_document()));
  const auto refused = [&](const char* where, const Json& value, const char* named) {
    Json bad = good;
    bad[Json::json_pointer(where)] = value;
    const Result<ResultDocument> r = parse_result(bad.dump());
    ASSERT_FALSE(r) << where;
    EXPECT_NE(r.error().what.find(named), std::string::npos) << r.error().message();
  };
  refused("/renderers", 3, "renderers");
  refused("/renderers/0", "x", "renderers[0]");
  refused("/renderers/0/status", "fine", "renderers[0].status");
  refused("/renderers/0/frame", 3, "renderers[0].frame");
  refused("/renderers/0/frame/frames", -1, "renderers[0].frame.frames");
  refused("/renderers/0/frame/mean_us", "fast", "renderers[0].frame.mean_us");
  refused("/renderers/0/prepare/phases", 1, "phases");
  refused("/renderers/0/prepare/phases/0", 1, "phases");
  refused("/renderers/0/options/box", 1, "options");
  refused("/renderers/0/threads", 4e9, "threads");
  refused("/machine", "mine", "machine");
  refused("/warnings", "mine", "warnings");
  refused("/renderers/0/prepare/warnings/0", 1, "renderers[0].prepare.warnings");
  refused("/renderers/0/frame/mean_interval_us", Json::array({1, "x"}), "mean_interval_us");
  refused("/renderers/0/prepare/from_cache", 3, "from_cache");
  refused("/conditions/libraries/CGAL", 3, "libraries");
  Json missing = good;
  missing["renderers"][1].erase("label");
  EXPECT_NE(parse_result(missing.dump()).error().what.find("renderers[1].label is missing"),
            std::string::npos);
}

TEST(ResultJson, ReadsDocumentsFromBeforeAKeyWasAdded) {
  Json j = Json::parse(to_json(full_document()));
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
  const Result<ResultDocument> back = parse_result(j.dump());
  ASSERT_TRUE(back) << back.error().message();
  EXPECT_TRUE(back->warnings.empty());
  EXPECT_EQ(back->schema, "palpate-result/1");
  EXPECT_FALSE(back->conditions || back->renderers[0].timing || back->renderers[0].frame_free);
  EXPECT_FALSE(back->renderers[0].prepare_clock.has_value());
  EXPECT_FALSE(back->renderers[0].accuracy->missed_device_frames.has_value());
  EXPECT_FALSE(back->renderers[0].frame->mean_clocked_us.has_value());
  EXPECT_EQ(back->renderers[0].accuracy->rounding_n, 0.0);
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

}  // namespace
}  // namespace palpate::metrics
