// The result document: against docs/result.schema.json, there and back, and with everything that can be wrong
// with it.
#include "toolkit/metrics/result_json.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

namespace palpate::metrics {
namespace {

using Json = nlohmann::json;

Json schema() {
  std::ifstream file(PALPATE_RESULT_SCHEMA);
  return Json::parse(file, nullptr, false);
}

bool has_type(const Json& value, const std::string& type) {
  if (type == "null") return value.is_null();
  if (type == "string") return value.is_string();
  if (type == "integer") return value.is_number_integer();
  if (type == "number") return value.is_number();
  if (type == "array") return value.is_array();
  return type == "object" && value.is_object();
}

// The part of JSON schema that the document uses. Returns what is wrong first, or nothing. Stricter than the
// schema in one thing: a key the schema does not name is wrong, so that both stay together.
std::string check(const Json& value, const Json& rule, const Json& root, const std::string& at) {
  if (rule.contains("$ref")) {
    return check(value, root.at(Json::json_pointer(rule["$ref"].get<std::string>().substr(1))), root, at);
  }
  if (rule.contains("const") && value != rule["const"]) return at + " is not " + rule["const"].dump();
  if (rule.contains("enum")) {
    bool found = false;
    for (const Json& one : rule["enum"]) found = found || one == value;
    if (!found) return at + " is not in the enum";
  }
  if (rule.contains("type")) {
    const Json types = rule["type"].is_array() ? rule["type"] : Json::array({rule["type"]});
    bool found = false;
    for (const Json& type : types) found = found || has_type(value, type.get<std::string>());
    if (!found) return at + " has the wrong type: " + value.dump();
  }
  if (rule.contains("minimum") && value.is_number() && value < rule["minimum"]) return at + " is too small";
  if (rule.contains("pattern") && value.is_string() &&
      !std::regex_match(value.get<std::string>(), std::regex(rule["pattern"].get<std::string>())))
    return at + " does not match";
  if (value.is_object()) {
    for (const Json& key : rule.value("required", Json::array())) {
      if (!value.contains(key.get<std::string>())) return at + "." + key.get<std::string>() + " is missing";
    }
    for (const auto& [key, inner] : value.items()) {
      const Json properties = rule.value("properties", Json::object());
      const Json* inner_rule = nullptr;
      if (properties.contains(key)) {
        inner_rule = &properties[key];
      } else if (rule.contains("additionalProperties")) {
        inner_rule = &rule["additionalProperties"];
      } else {
        return at + "." + key + " is not in the schema";
      }
      if (std::string wrong = check(inner, *inner_rule, root, at + "." + key); !wrong.empty()) return wrong;
    }
  }
  if (value.is_array() && rule.contains("items")) {
    for (const Json& item : value) {
      if (std::string wrong = check(item, rule["items"], root, at + "[]"); !wrong.empty()) return wrong;
    }
  }
  return "";
}

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
  RendererResult r;
  r.label = "smooth";
  r.name = "cloud";
  r.options = {{"shading", "auto"}, {"box", "worst"}};
  r.model = RendererResult::Model{1'002'001, 0.288};
  r.prepare = render::PrepareReport{12.5, {{"grid", 4.5}, {"neighbours", 8.0}}, 48'096'048, {"shading off"}};
  r.threads = 2;
  trace::FrameStatistics s;
  s.frames = 50'000;
  s.contact_frames = s.timed_frames = 40'000;
  s.min_us = 0.05;
  s.mean_us = 0.1;
  s.p50_us = 0.09;
  s.p99_us = 0.3;
  s.p999_us = 0.7;
  s.max_us = 1234.5;
  s.deadline_misses_1khz = 1;
  s.bound_hits = 3;
  s.clock_overhead_ns = 21.0;
  r.frame = r.frame_all = s;
  r.paced = trace::PacedStatistics{s, 1.0, 17, 0, 2};
  r.paced_evicted = trace::PacedStatistics{s, 1.0, 17, 64u << 20u, 900};
  Accuracy a;
  a.reference = "analytic";
  a.exactness = "exact";
  a.floor_n = 0.0275;
  a.force_rms_n = 0.1;
  a.within_7_percent = 99.5;
  a.excess_jumps = 4;
  a.pop_throughs = 0;
  a.onset_error_mm = 0.05;
  r.accuracy = a;
  r.energy = Energy{0.5, 0.01, 2.0, 0.1};
  r.trace_hash = "0123456789abcdef";
  d.renderers.push_back(r);
  RendererResult failed;
  failed.label = failed.name = "mesh-godobject";
  failed.status = RunStatus::kFailed;
  failed.reason = "no mesh";
  d.renderers.push_back(failed);
  return d;
}

TEST(ResultJson, FollowsTheSchema) {
  const Json rules = schema();
  ASSERT_TRUE(rules.is_object());
  EXPECT_EQ(check(Json::parse(to_json(full_document())), rules, rules, ""), "");
  EXPECT_EQ(check(Json::parse(to_json({})), rules, rules, ""), "");
}

TEST(ResultJson, TheCheckCanFail) {
  const Json rules = schema();
  Json j = Json::parse(to_json(full_document()));
  j["renderers"][0]["frame"]["bound_hits"] = -1;
  EXPECT_EQ(check(j, rules, rules, ""), ".renderers[].frame.bound_hits is too small");
  j["renderers"][0]["frame"].erase("bound_hits");
  EXPECT_EQ(check(j, rules, rules, ""), ".renderers[].frame.bound_hits is missing");
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
  EXPECT_EQ(back->renderers[0].paced_evicted->first_frame, 17u);
  EXPECT_EQ(back->renderers[0].accuracy->pop_throughs, 0u);
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
  Json missing = good;
  missing["renderers"][1].erase("label");
  EXPECT_NE(parse_result(missing.dump()).error().what.find("renderers[1].label is missing"),
            std::string::npos);
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
