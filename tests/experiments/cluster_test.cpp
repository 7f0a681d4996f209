// Cases of a command as processes of their own: what is listed, what a process leaves, and that the command
// then only draws.
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "experiments/driver/suite.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const char* const kSmallScene =
    "sinusoid:points=961:extent_mm=20:wavelength_mm=20:amplitude_mm=1:sampling=random:noise=0.05:seed=3";
const char* const kSmallPath = "weave:frames=900:depth_mm=0.5:clearance_mm=0.3:period_frames=300:seed=1";

class Cluster : public OnCommandLine {
 protected:
  Words on_scene(const char* command, const std::string& out, const char* renderers) const {
    return words(command, kSmallScene, "--renderers", std::string(renderers), "--passes 2 --path", kSmallPath,
                 "--out", in(out));
  }
  Words sweep(const std::string& out) const {
    return words(on_scene("compare sweep", out, "cloud"), "--axes points,rate");
  }
  /// Rows of the table, by id.
  std::map<std::string, Words> jobs(const std::string& out) const {
    std::map<std::string, Words> rows;
    std::istringstream lines(text_in(out + "/jobs/jobs.tsv"));
    for (std::string line; std::getline(lines, line);) {
      std::istringstream fields(line);
      Words row;
      for (std::string field; std::getline(fields, field, '\t');) row.push_back(field);
      EXPECT_EQ(row.size(), 8u) << line;
      EXPECT_TRUE(rows.emplace(row.front(), row).second) << "twice: " << line;
    }
    EXPECT_EQ(rows.erase("id"), 1u);
    return rows;
  }
};

TEST_F(Cluster, CasesOfASweepOneByOneAreTheSweep) {
  succeeds(sweep("whole"), "--budget 0");
  const ProcessOutcome listed = succeeds(sweep("out"), "--emit snakemake");
  EXPECT_THAT(listed.err, HasSubstr("profiles/slurm"));
  const std::map<std::string, Words> rows = jobs("out");
  EXPECT_EQ(rows.size(), exact("whole").size());
  EXPECT_FALSE(exists("out/rows.jsonl")) << "nothing is measured";
  std::set<std::string> settings;
  for (const auto& [id, row] : rows) {
    settings.insert(row[3]);
    EXPECT_EQ(row[4], "3") << "the seed";
    EXPECT_GT(std::stod(row[5]), 0.0);
    EXPECT_GT(std::stod(row[6]), 0.0);
    succeeds(sweep("out"), "--case", id);
    // A job that is given again measures nothing again.
    const std::string kept = text_in("out/jobs/cases/" + id + "/rows.jsonl");
    EXPECT_EQ(count_of(kept, "\n"), 1u);
    succeeds(sweep("out"), "--case", id);
    EXPECT_EQ(text_in("out/jobs/cases/" + id + "/rows.jsonl"), kept);
  }
  EXPECT_FALSE(exists("out/sweep.json"));
  succeeds(sweep("out"));
  EXPECT_EQ(exact("out"), exact("whole"));
  for (const auto& [setting, text] : exact("out")) EXPECT_TRUE(settings.contains(setting)) << setting;
  const std::string merged = text_in("out/rows.jsonl");
  for (const auto& [id, row] : rows)
    EXPECT_THAT(merged, HasSubstr(text_in("out/jobs/cases/" + id + "/rows.jsonl"))) << "measured again";
  EXPECT_TRUE(exists("out/report.html"));
}

TEST_F(Cluster, RowsOfAnotherMachineAreNotMeasuredAgain) {
  succeeds(sweep("out"), "--emit snakemake");
  const std::string id = jobs("out").begin()->first, file = "out/jobs/cases/" + id + "/rows.jsonl";
  succeeds(sweep("out"), "--case", id);
  json row = json::parse(text_in(file));
  row["machine"]["hash"] = "feedfacefeedface";
  write_text(in(file), row.dump() + "\n");
  succeeds(sweep("out"));
  EXPECT_EQ(json_in("out/sweep.json")["machines"].size(), 2u);
  EXPECT_EQ(count_of(text_in("out/rows.jsonl"), "\n"), jobs("out").size());
}

TEST_F(Cluster, CasesOfAComparisonAreTheComparison) {
  const char* const both = "cloud,cloud-smooth:label=smooth";
  succeeds(on_scene("compare", "whole", both));
  succeeds(on_scene("compare", "out", both), "--emit snakemake");
  EXPECT_FALSE(exists("out/result.json"));
  for (const auto& [id, row] : jobs("out")) succeeds(on_scene("compare", "out", both), "--case", id);
  EXPECT_FALSE(exists("out/result.json"));
  succeeds(on_scene("compare", "out", both));
  const json whole = json_in("whole/result.json"), merged = json_in("out/result.json");
  ASSERT_EQ(merged["renderers"].size(), 2u);
  for (std::size_t i = 0; i < 2; ++i)
    for (const char* key : {"label", "status", "trace_hash", "accuracy", "memory"})
      EXPECT_EQ(merged["renderers"][i][key], whole["renderers"][i][key]) << key;
  for (std::size_t i = 0; i < 2; ++i) {
    const std::string id = whole["renderers"][i]["label"];
    EXPECT_EQ(merged["renderers"][i]["frame"],
              json_in("out/jobs/cases/" + id + "/result.json")["renderers"][i]["frame"])
        << "measured again";
  }
  EXPECT_EQ(text_in("out/path.csv"), text_in("whole/path.csv"));
  EXPECT_TRUE(exists("out/trace-smooth.csv"));
}

TEST_F(Cluster, CasesOfOtherArgumentsAreRefused) {
  succeeds(on_scene("compare", "out", "cloud,cloud-smooth"), "--emit snakemake");
  succeeds(on_scene("compare", "out", "cloud,cloud-smooth"), "--case cloud");
  const ProcessOutcome other =
      palpate("compare", kSmallScene, "--renderers cloud --passes 3 --path", kSmallPath, "--out @/out");
  EXPECT_NE(other.exit_code, 0);
  EXPECT_THAT(other.err, HasSubstr("other arguments"));
  EXPECT_TRUE(exists("out/jobs/cases/cloud"));
}

TEST_F(Cluster, EveryCommandOfManyCasesListsThem) {
  for (const auto& [line, least] : std::vector<std::pair<const char*, std::size_t>>{
           {"tune plane:points=441 --path tap:frames=300 --max-error 5 --renderers cloud", 2},
           {"test stress --renderers cloud,penalty-grid --cases one-point", 2},
           {"test stability plane:points=441 --path tap:frames=300 --renderers cloud", 2},
           {"test behaviours --renderers cloud,penalty-grid --only ridge", 2},
           {"test goals --quick", 9},
           {"test hunt --renderers cloud,heightfield --trials 4", 2},
           {"test bench --quick", 18},
           {"compare ablate plane:points=441 --path tap:frames=300 --friction 0.5 --renderer cloud", 2},
           {"reproduce --quick --tables 6,10", 2}}) {
    succeeds(line, "--emit snakemake --out @/out");
    EXPECT_GE(jobs("out").size(), least) << line;
    EXPECT_FALSE(exists("out/report.html")) << line;
    std::filesystem::remove_all(in("out"));
  }
}

TEST_F(Cluster, QuestsApartFindWhatTheHuntFinds) {
  const auto hunt = [&](const char* out, const Words& more = {}) {
    return words("test hunt --renderers cloud,heightfield --trials 9 --as-given --seed 7 --out", in(out),
                 more);
  };
  palpate(hunt("whole"));
  succeeds(hunt("out", {"--emit", "snakemake"}));
  for (const auto& [id, row] : jobs("out")) succeeds(hunt("out", {"--case", id}));
  palpate(hunt("out"));
  json whole = json_in("whole/hunt.json"), merged = json_in("out/hunt.json");
  for (json* one : {&whole, &merged}) {
    for (const char* of_the_run : {"spent_s", "command", "started_utc"}) one->erase(of_the_run);
    for (json& renderer : (*one)["renderers"])
      for (const char* list : {"worst", "faults"})
        for (json& found : renderer[list]) found.erase("command");  // it names the folder
  }
  EXPECT_EQ(merged, whole);
  EXPECT_EQ(whole["trials"], 9);
}

TEST_F(Cluster, StagesLeftOutApartAreTheAblation) {
  const auto ablate = [&](const char* out, const Words& more = {}) {
    return words("compare ablate", kSmallScene, "--renderer cloud:refine=1 --friction 0.5 --budget 0 --path",
                 kSmallPath, "--out", in(out), more);
  };
  succeeds(ablate("whole"));
  succeeds(ablate("out", {"--emit", "snakemake"}));
  const auto rows = jobs("out");
  EXPECT_TRUE(rows.contains("whole"));
  for (const auto& [id, row] : rows) succeeds(ablate("out", {"--case", id}));
  succeeds(ablate("out"));
  const json whole = json_in("whole/ablate.json")["rows"], merged = json_in("out/ablate.json")["rows"];
  ASSERT_EQ(merged.size(), rows.size());
  for (std::size_t i = 0; i < whole.size(); ++i)
    for (const char* key : {"stage", "instead", "trace_hash", "error_percent", "bytes"})
      EXPECT_EQ(merged.at(i)[key], whole[i][key]) << i << " " << key;
}

TEST_F(Cluster, WhatHasNoCasesSaysSo) {
  refuses("palpate study has no jobs for --emit", "study abx --emit snakemake --out @/out");
  refuses("has no jobs for --engine", "list scans --engine snakemake");
  refuses("secret seed", "test bench --quick --seed 0123456789abcdef --emit snakemake --out @/out");
  EXPECT_FALSE(exists("out"));
}

TEST_F(Cluster, OneCaseOfAMatrixIsTakenOver) {
  const auto line = [&](const Words& more) {
    return words("test stress --renderers cloud,penalty-grid --cases one-point --out @/out", more);
  };
  succeeds(line({"--emit", "snakemake"}));
  for (const auto& [id, row] : jobs("out")) {
    EXPECT_EQ(row[7], "0") << "counted, not timed";
    succeeds(line({"--case", id}));
  }
  // A result that no measurement gives: the command takes it over.
  const std::string part = "out/jobs/cases/penalty-grid/.palpate-parts/penalty-grid";
  std::string kept = text_in(part);
  const std::string key = "\"trace_hash\\\":\\\"";
  const std::size_t at = kept.find(key.substr(1));
  ASSERT_NE(at, std::string::npos) << kept;
  kept.replace(at + key.size() - 1, 16, "feedfacefeedface");
  write_text(in(part), kept);
  palpate(line({}));
  EXPECT_THAT(text_in("out/stress.json"), HasSubstr("feedfacefeedface"));
}

// What Snakemake 7 alone understands is in config.yaml, which 8 and later leave for config.v8+.yaml.
TEST_F(Cluster, ProfilesKeepTheWordsOfTheirVersions) {
  succeeds(on_scene("compare", "out", "cloud,cloud-smooth"), "--emit snakemake");
  const std::string text = text_in("out/jobs/Snakefile"), slurm = "out/jobs/profiles/slurm/";
  EXPECT_THAT(text, HasAll("rule prepare:", "rule case:", "rule merge:", "rule report:", "localrules:",
                           "retries: 2", "mem_mb=", "runtime=", "slurm_extra=", "timing="));
  EXPECT_THAT(text, HasNone("subworkflow", "version(", "dynamic(", "cluster", "time_min")) << "gone in 8";
  EXPECT_THAT(text_in(slurm + "config.v8+.yaml"),
              testing::AllOf(HasSubstr("executor: slurm\n"), HasNone("cluster")));
  EXPECT_THAT(text_in(slurm + "config.yaml"),
              testing::AllOf(HasSubstr("cluster-status:"), HasNone("executor:")));
  if (!program_exists("snakemake")) GTEST_SKIP() << "Snakemake is not installed: the text alone was read";
  for (const char* profile : {"local", "slurm"}) {
    const auto dry =
        value_of(run_process({"snakemake", "--profile", std::string("profiles/") + profile, "--dry-run"},
                             {.folder = in("out/jobs")}));
    EXPECT_EQ(dry.exit_code, 0) << dry.err;
    EXPECT_THAT(dry.out + dry.err, HasAll("prepare", "case", "merge", "report")) << profile;
  }
}

TEST_F(Cluster, SnakemakeRunsWhatIsWritten) {
  if (!program_exists("snakemake")) GTEST_SKIP() << "Snakemake is not installed";
  apart_ = true;
  const auto line = [&](const char* more) {
    return words("compare", kSmallScene, "--renderers cloud,cloud-smooth --passes 2 --path", kSmallPath,
                 "--out @/out", more);
  };
  succeeds(line("--engine snakemake"));
  EXPECT_EQ(json_in("out/result.json")["renderers"].size(), 2u);
  EXPECT_TRUE(exists("out/jobs/done/report"));
  EXPECT_TRUE(exists("out/report.html"));
}

TEST_F(Cluster, OptionsExcludeEachOther) {
  refuses("--engine", "compare plane:points=441 --emit snakemake --engine snakemake --out @/out");
  refuses("snakemake", "compare plane:points=441 --emit make --out @/out");
  EXPECT_THAT(succeeds("compare --help-all").out, Not(HasSubstr("--case")));
  EXPECT_FALSE(exists("out"));
}

TEST(CaseId, IsAFileNameAndTellsNamesApart) {
  EXPECT_EQ(case_id("cloud-smooth"), "cloud-smooth");
  std::set<std::string> ids;
  for (const char* name : {"a/b", "a:b", "a_b", "../a", ".", "", "none", "a b", "a'b"}) {
    const std::string id = case_id(name);
    EXPECT_TRUE(ids.insert(id).second) << name;
    EXPECT_EQ(id.find_first_of("/: '"), std::string::npos) << id;
    EXPECT_FALSE(id.empty() || id.starts_with('.') || id == kNoCase) << name;
  }
  EXPECT_LT(case_id(std::string(300, 'x')).size(), 100u);
}

}  // namespace
}  // namespace palpate::experiments
