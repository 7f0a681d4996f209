// Palpate Bench: its parts and seeds, and the command with a plug-in, recorded traces and hidden cases.
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include <palpate/trace.h>
#include "experiments/bench/cases.h"
#include "experiments/bench/ranking.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

// ---- parts

struct NominalPart {
  const char* name;
  std::size_t vertices;
  Vec3 box_mm;
};
// What the tables of docs/results/smooth.md were made with.
const NominalPart kNominal[] = {
    {"bent-comb", 6346, {150.0, 34.23, 71.64}}, {"ribs-and-bracket", 5364, {150.0, 109.83, 99.95}},
    {"vase", 32200, {123.63, 123.63, 150.0}},   {"knotted-cable", 54000, {142.8, 150.0, 47.74}},
    {"cog", 282, {123.56, 150.0, 55.19}},       {"leaning-fins", 18244, {150.0, 145.99, 66.12}}};

TEST(BenchParts, NominalOnesAreAsThePageSays) {
  constexpr double kTwoDigits = 0.005;
  ASSERT_EQ(bench_parts().size(), std::size(kNominal));
  for (std::size_t i = 0; i < std::size(kNominal); ++i) {
    const geometry::TriangleMesh mesh = make_part(bench_parts()[i], {});
    geometry::Aabb box;
    for (const Vec3& p : mesh.vertices_mm) box.add(p);
    EXPECT_STREQ(bench_parts()[i].name, kNominal[i].name);
    EXPECT_EQ(mesh.vertices_mm.size(), kNominal[i].vertices) << kNominal[i].name;
    EXPECT_LE((box.high_mm - box.low_mm - kNominal[i].box_mm).cwiseAbs().maxCoeff(), kTwoDigits)
        << kNominal[i].name;
    EXPECT_EQ(faults_of(mesh), "") << kNominal[i].name;
  }
}

TEST(BenchParts, DrawnOnesAreClosedToo) {
  for (const BenchPart& part : bench_parts()) {
    const geometry::TriangleMesh nominal = make_part(part, {});
    for (std::uint64_t seed = 1; seed <= 8; ++seed) {
      const geometry::TriangleMesh mesh = make_part(part, Dimensions(Random(seed)));
      EXPECT_EQ(faults_of(mesh), "") << part.name << " of seed " << seed;
      EXPECT_NE(mesh.vertices_mm, nominal.vertices_mm) << part.name << " of seed " << seed;
    }
  }
}

TEST(BenchParts, FaultsAreFoundAndToldApart) {
  const geometry::TriangleMesh sound = make_part(bench_parts()[4], {});
  geometry::TriangleMesh hole = sound, turned = sound, flat = sound, inside = sound;
  hole.triangles.erase(hole.triangles.begin());
  std::swap(turned.triangles[0][1], turned.triangles[0][2]);
  flat.vertices_mm[flat.triangles[0][0]] = flat.vertices_mm[flat.triangles[0][1]];
  for (auto& face : inside.triangles) std::swap(face[1], face[2]);
  EXPECT_THAT(faults_of(hole), HasSubstr("3 edges not passed"));
  EXPECT_THAT(faults_of(turned), HasSubstr("edges not passed"));
  EXPECT_THAT(faults_of(flat), HasSubstr("faces without area"));
  EXPECT_EQ(faults_of(inside), "1 volume that is not positive");
}

// ---- seeds

constexpr const char* kSecret = "0123456789abcdef-a-secret";

TEST(BenchSeeds, GiveTheSameCasesAgainAndOthersOtherOnes) {
  const BenchSeed known = read_seed("").value(), secret = read_seed(kSecret).value();
  EXPECT_EQ(known.name, "public");
  EXPECT_EQ(secret.name, "secret");
  EXPECT_EQ(known.sha256, read_seed("public").value().sha256);
  EXPECT_NE(known.sha256, secret.sha256);
  const auto cases = bench_cases(known, true), again = bench_cases(known, true),
             hidden = bench_cases(secret, true);
  ASSERT_EQ(cases.size(), hidden.size());
  std::set<std::string> names;
  for (std::size_t i = 0; i < cases.size(); ++i) {
    names.insert(cases[i].name);
    EXPECT_EQ(cases[i].points, again[i].points);
    EXPECT_EQ(cases[i].path, again[i].path);
    EXPECT_EQ(cases[i].name, hidden[i].name);
    EXPECT_NE(cases[i].points, hidden[i].points) << cases[i].name;
    EXPECT_NE(cases[i].path, hidden[i].path) << cases[i].name;
  }
  EXPECT_EQ(names.size(), cases.size());
}

TEST(BenchSeeds, ShortOrGuessableOnesAreRefused) {
  EXPECT_FALSE(read_seed("12345"));
  // The numbers cannot be read off the hash that results show.
  const BenchSeed secret = read_seed(kSecret).value();
  EXPECT_NE(std::stoull(secret.sha256.substr(0, 16), nullptr, 16), secret.number);
}

// ---- ranks

BenchRow row(const std::string& entry, const std::string& shape, double kicks) {
  BenchRow one;
  one.entry = entry;
  one.name = one.shape = shape;
  one.kicks = kicks;
  return one;
}

TEST(BenchRanks, FollowIntervalsAndNeedEveryCase) {
  BenchDocument document;
  document.entries = {{"good", "", ""}, {"same", "", ""}, {"bad", "", ""}, {"part", "", ""}};
  for (int i = 0; i < 8; ++i) {
    const std::string shape = "shape-" + std::to_string(i);
    document.cases.push_back({shape, shape, 1, 1, "", "", ""});
    document.rows.push_back(row("good", shape, i % 2));
    document.rows.push_back(row("same", shape, (i + 1) % 2));
    document.rows.push_back(row("bad", shape, 10.0 + i));
    document.rows.push_back(row("part", shape, 0.0));
  }
  document.rows.back().reason = "it fell over";
  document.rows.back().kicks.reset();
  const std::size_t kicks = 2;
  ASSERT_EQ(bench_measures()[kicks].key, "kicks");
  const auto standings = standings_of(document);
  EXPECT_EQ(standings[0][kicks].value, 4.0);
  EXPECT_EQ(standings[0][kicks].rank, 1);
  EXPECT_EQ(standings[1][kicks].rank, 1) << "none is surely better";
  EXPECT_EQ(standings[2][kicks].rank, 3) << "two are surely better";
  EXPECT_EQ(standings[3][kicks].rank, 0) << "it left out a case";
  EXPECT_EQ(finished_by(document, "part"), 7u);
  ASSERT_TRUE(standings[2][kicks].interval);
  EXPECT_LT(standings[2][kicks].interval->low, 108.0);
  EXPECT_GT(standings[2][kicks].interval->high, 108.0);
  EXPECT_FALSE(standings[0][0].interval) << "what is caught was not measured";
}

TEST(BenchRanks, WhoFeelsTheEasyCasesAloneDoesNotLead) {
  BenchDocument document;
  document.entries = {{"felt", "", ""}, {"numb", "", ""}};
  for (int i = 0; i < 8; ++i) {
    const std::string shape = "shape-" + std::to_string(i);
    document.cases.push_back({shape, shape, 1, 1, "", "", ""});
    document.rows.push_back(row("felt", shape, 0.0));
    document.rows.back().direction_mean_deg = 20.0;
    document.rows.push_back(row("numb", shape, 0.0));
    if (i < 4) document.rows.back().direction_mean_deg = 1.0;
  }
  const std::size_t direction = 4;
  ASSERT_EQ(bench_measures()[direction].key, "direction_mean_deg");
  const auto standings = standings_of(document);
  EXPECT_EQ(standings[0][direction].rank, 1);
  EXPECT_EQ(standings[1][direction].rank, 0) << "four cases have no direction";
  EXPECT_EQ(standings[1][direction].value, 1.0);
}

// ---- the command

class BenchCommand : public OnCommandLine {
 protected:
  /// Every file below a folder of the test holds no such text.
  void expect_nowhere(const std::string& text, const std::string& folder) const {
    for (const auto& file : std::filesystem::recursive_directory_iterator(in(folder))) {
      const std::string content = file.is_regular_file() ? file_text(file.path()) : std::string();
      EXPECT_EQ(content.find(text), std::string::npos) << file.path();
    }
  }
  static const json& row_of(const json& document, const std::string& entry, const std::string& name) {
    for (const json& one : document["rows"])
      if (one["entry"] == entry && one["name"] == name) return one;
    ADD_FAILURE() << entry << " has no row of " << name;
    return document;
  }
  Environment plugins_{"PALPATE_PLUGINS", PALPATE_RENDERER_PLUGINS};
};

TEST_F(BenchCommand, RunsAPluginBesideOursAndIsCheckedAgain) {
  succeeds("test bench --quick --entry cloud,ball --out @/run");
  const std::string text = text_in("run/bench.json");
  expect_valid("bench", text);
  json document = json::parse(text);
  ASSERT_EQ(document["cases"].size(), 18u);
  EXPECT_EQ(document["seed"]["name"], "public");
  EXPECT_EQ(document["standings"]["cloud"]["finished"], 18);
  EXPECT_EQ(document["standings"]["ball"]["finished"], 18);
  EXPECT_LT(document["standings"]["cloud"]["force_rms_percent"]["value"],
            document["standings"]["ball"]["force_rms_percent"]["value"]);
  EXPECT_THAT(text_in("run/report.html"), HasAll("Right", "Fast", "Ready", "Small", "ball"));
  draw_without_page("run");
  EXPECT_THAT(text_in("run/report.html"), HasAll("Right", "Fast", "Ready", "Small", "ball"));

  const ProcessOutcome same = succeeds("test bench --check @/run/bench.json --entry ball --out @/check");
  EXPECT_THAT(same.err, HasSubstr("is as it says"));

  // One answer changed, with standings that do not show it; then standings that do not follow from the rows.
  document["rows"][1]["trace_hash"] = "0123456789abcdef";
  write_text(in("changed.json"), document.dump());
  const ProcessOutcome differs = palpate("test bench --check @/changed.json --entry ball --out @/check");
  EXPECT_EQ(differs.exit_code, 1);
  EXPECT_THAT(differs.err, HasAll("bent-comb-even: ball answers otherwise", "differs"));
  document["standings"]["ball"]["kicks"]["value"] = 0.5;
  write_text(in("changed.json"), document.dump());
  refuses("standings that do not follow", "test bench --check @/changed.json --out @/check");
  document["rows"].push_back(document["rows"][0]);
  write_text(in("changed.json"), document.dump());
  refuses("has two rows of", "test bench --check @/changed.json --out @/check");
  refuses("of another seed", "test bench --check @/run/bench.json --out @/check --seed", kSecret);
}

TEST_F(BenchCommand, APluginThatCrashesLeavesTheOthersAlone) {
  const ProcessOutcome run = palpate(
      "test bench --quick --entry cloud,ball:options=crash:label=crash,ball:options=fail:label=fail --out "
      "@/run");
  EXPECT_EQ(run.exit_code, 1) << "two entries have finished no case";
  const json document = json_in("run/bench.json");
  EXPECT_EQ(document["standings"]["cloud"]["finished"], 18);
  EXPECT_EQ(document["standings"]["crash"]["finished"], 0);
  EXPECT_EQ(document["standings"]["crash"]["kicks"]["rank"], 0);
  EXPECT_THAT(row_of(document, "crash", "vase-hand-held")["reason"].get<std::string>(), HasSubstr("signal"));
  EXPECT_THAT(row_of(document, "fail", "cog-even")["reason"].get<std::string>(), HasSubstr("fails as asked"));
}

TEST_F(BenchCommand, TracesAnswerEmittedCasesAndASecretStaysOne) {
  const std::string secret = kSecret;
  succeeds("test bench --quick --save-cases @/cases --seed", secret);
  std::filesystem::create_directory(in("mine"));
  const json cases = json_in("cases/bench.json")["cases"];
  ASSERT_EQ(cases.size(), 18u);
  for (const json& one : cases) {
    const std::string name = one["name"];
    const trace::ProbePath path = trace::read_path_csv(in("cases/" + name + "/path.csv")).value();
    EXPECT_EQ(path.size(), one["frames"]) << name;
    EXPECT_TRUE(exists("cases/" + name + "/points.ply")) << name;
    trace::ForceTrace nothing;  // never feels anything
    for (const Vec3& hip : path.hip_mm) {
      nothing.frames.emplace_back();
      nothing.frames.back().god_object_mm = hip;
    }
    ASSERT_TRUE(trace::write_trace_csv(path, nothing, in("mine/" + name + ".csv")));
  }
  // One trace is along another path from its second row on.
  const std::string other = in("mine/cog-even.csv");
  std::string text = file_text(other);
  const std::size_t second = text.find('\n', text.find('\n') + 1) + 1;
  text.replace(second, text.find(',', second) - second, "0.00100001");
  write_text(other, text);
  succeeds("test bench --quick --entry", in("mine"), "--out @/run --seed", secret);
  const json document = json_in("run/bench.json");
  EXPECT_EQ(document["seed"]["name"], "secret");
  EXPECT_EQ(document["entries"][0]["kind"], "traces");
  EXPECT_EQ(document["cases"], cases) << "the same ones";
  EXPECT_EQ(document["standings"]["mine"]["finished"], 17) << document["rows"];
  EXPECT_NEAR(row_of(document, "mine", "vase-hand-held")["force_rms_percent"].get<double>(), 100.0, 1e-9);
  EXPECT_EQ(row_of(document, "mine", "vase-hand-held")["frame_mean_us"], nullptr);
  EXPECT_THAT(row_of(document, "mine", "cog-even")["reason"].get<std::string>(),
              HasAll("cog-even.csv:3", "not along the case's path"));
  expect_nowhere(secret, "run");
  expect_nowhere(secret, "cases");
}

TEST_F(BenchCommand, WhatCannotBeIsRefused) {
  refuses("at least 16 characters", "test bench --seed short --out @/run");
  refuses("no renderer 'no-such'", "test bench --entry no-such --out @/run");
  refuses("two entries are called 'cloud'", "test bench --entry cloud,cloud --out @/run");
  write_text(in("other.json"), "{\"schema\": \"palpate-hunt-1\"}");
  refuses("no document of schema palpate-bench/1", "test bench --check @/other.json --out @/run");
  refuses("no document of schema palpate-bench/1", "test bench --against @/other.json --out @/run");
  write_text(in("half.json"), "{\"schema\": \"palpate-bench/1\", \"bench_version\": 1, \"quick\": true}");
  refuses("cannot be read", "test bench --check @/half.json --out @/run");
  EXPECT_FALSE(exists("run"));
}

}  // namespace
}  // namespace palpate::experiments
