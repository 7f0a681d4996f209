// palpate sweep, merge, tune and compare --against, as a user runs them, on a tiny scene.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "tests/experiments/program.h"
#include "tests/json_schema.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const char* const kTiny =
    "sinusoid:points=961:extent_mm=20:wavelength_mm=20:amplitude_mm=1:sampling=random:noise=0.05:seed=1";
const char* const kShort = "weave:frames=900:depth_mm=0.5:clearance_mm=0.3:period_frames=300:seed=1";

class Trade : public InFolder {
 protected:
  static std::string schema(const std::string& name) {
    return std::string(PALPATE_DOCS) + "/" + name + ".schema.json";
  }
  ProcessOutcome sweep(const std::string& out, std::vector<std::string> more = {},
                       const std::string& scene = kTiny) {
    std::vector<std::string> arguments = {"sweep",    scene,         "--renderers", "cloud,cloud-smooth",
                                          "--axes",   "points,rate", "--path",      kShort,
                                          "--passes", "2",           "--out",       in(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return palpate_command(arguments);
  }
  json document(const std::string& out, const std::string& file = "sweep.json") const {
    return json::parse(file_text(in(out + "/" + file)));
  }
  /// What no clock has a say in, by setting.
  std::map<std::string, std::string> exact(const std::string& out) const {
    std::map<std::string, std::string> all;
    const json whole = document(out);
    for (const json& row : whole["rows"])
      all[row["setting"]] =
          fmt::format("{} {} {} {}", row["trace_hash"].dump(), row["error_p95_percent"].dump(),
                      row["bytes"].dump(), row["points"].dump());
    return all;
  }
  std::size_t lines(const std::string& file) const {
    const std::string text = file_text(in(file));
    return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
  }
};

TEST_F(Trade, SweepMeasuresEverySettingAndDrawsTheFronts) {
  const ProcessOutcome run = sweep("out");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(schema_violations(schema("sweep"), file_text(in("out/sweep.json"))), "");
  std::istringstream rows(file_text(in("out/rows.jsonl")));
  for (std::string line; std::getline(rows, line);)
    EXPECT_EQ(schema_violations(schema("rows"), line), "") << line;
  const json whole = document("out");
  EXPECT_EQ(whole["not_measured"].size(), 0u);
  std::size_t on_speed = 0;
  std::map<std::string, json> by;
  for (const json& row : whole["rows"]) {
    EXPECT_EQ(row["status"], "ok") << row["setting"] << row["reason"];
    EXPECT_GT(row["frame_all_mean_us"].get<double>(), 0.0);
    EXPECT_GE(row["frame_all_p999_us"].get<double>(), 0.0);
    EXPECT_LE(row["error_p95_percent_interval"][0].get<double>(), row["error_p95_percent"].get<double>());
    EXPECT_GE(row["error_p95_percent_interval"][1].get<double>(), row["error_p95_percent"].get<double>());
    on_speed += row["fronts"].dump().find("speed") != std::string::npos ? 1u : 0u;
    by[row["setting"]] = row;
  }
  EXPECT_GT(on_speed, 0u);
  // Fewer points are less memory and more error; half the rate is more error and the same memory.
  const json &all = by.at("cloud"), &thin = by.at("cloud:clean=thin/cell=2.5"),
             &slow = by.at("cloud-smooth:rate_divisor=4"), &fast = by.at("cloud-smooth");
  EXPECT_LT(thin["bytes"], all["bytes"]);
  EXPECT_LT(thin["points"], all["points"]);
  EXPECT_GT(thin["error_p95_percent"], all["error_p95_percent"]);
  EXPECT_EQ(slow["bytes"], fast["bytes"]);
  EXPECT_GT(slow["error_p95_percent"], fast["error_p95_percent"]);
  EXPECT_DOUBLE_EQ(slow["rate_hz"].get<double>() * 4.0, all["rate_hz"].get<double>());
  for (const char* file : {"report.html", "figures/front-speed-1.svg", "figures/front-memory-1.gp"})
    EXPECT_TRUE(std::filesystem::exists(in(std::string("out/") + file))) << file;
  EXPECT_NE(file_text(in("out/report.html")).find("Dominated"), std::string::npos);
}

TEST_F(Trade, SweepErrorIsThatOfCompare) {
  ASSERT_EQ(sweep("out", {"--budget", "60"}).exit_code, 0);
  const ProcessOutcome run = palpate_command(
      {"compare", kTiny, "--renderers", "cloud", "--path", kShort, "--passes", "1", "--out", in("ab")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json result = document("ab", "result.json")["renderers"][0];
  for (const json& row : document("out")["rows"])
    if (row["setting"] == "cloud") {
      EXPECT_EQ(row["trace_hash"], result["trace_hash"]);
      EXPECT_NEAR(row["error_p95_percent"].get<double>(),
                  result["accuracy"]["force_p95_percent"].get<double>(),
                  1e-5 * row["error_p95_percent"].get<double>())
          << "single precision is kept frame by frame";
    }
}

TEST_F(Trade, SweepGoesOnWhereItStopped) {
  ASSERT_EQ(sweep("whole").exit_code, 0);
  ASSERT_EQ(sweep("out").exit_code, 0);
  // As if it had been stopped after three settings.
  std::istringstream rows(file_text(in("out/rows.jsonl")));
  std::string kept, line;
  for (int i = 0; i < 3 && std::getline(rows, line); ++i) kept += line + "\n";
  write_text(in("out/rows.jsonl"), kept);
  const ProcessOutcome again = sweep("out");
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_TRUE(file_text(in("out/rows.jsonl")).starts_with(kept)) << "what was measured is not measured again";
  EXPECT_EQ(exact("out"), exact("whole"));
  // Once more: there is nothing left to measure.
  const std::string before = file_text(in("out/rows.jsonl"));
  ASSERT_EQ(sweep("out").exit_code, 0);
  EXPECT_EQ(file_text(in("out/rows.jsonl")), before);
}

TEST_F(Trade, SweepStoppedBySignalKeepsItsRows) {
  Started running(folder_, {"sweep", kTiny, "--path", kShort, "--passes", "2", "--out", in("out")});
  ASSERT_TRUE(running.wait_for([&] { return lines("out/rows.jsonl") > 0; })) << running.err();
  running.send_group(SIGINT);
  EXPECT_EQ(running.end(), 130) << running.err();
  EXPECT_GT(lines("out/rows.jsonl"), 0u);
  EXPECT_FALSE(std::filesystem::exists(in("out/sweep.json"))) << "nothing half done looks whole";
  EXPECT_EQ(sweep("out").exit_code, 0);
  EXPECT_EQ(schema_violations(schema("sweep"), file_text(in("out/sweep.json"))), "");
}

TEST_F(Trade, ShardsAreTheWhole) {
  ASSERT_EQ(sweep("whole").exit_code, 0);
  for (const char* part : {"1", "2", "3"})
    ASSERT_EQ(sweep(std::string("shard-") + part, {"--shard", std::string(part) + "/3"}).exit_code, 0);
  const ProcessOutcome merged =
      palpate_command({"merge", in("shard-1"), in("shard-2"), in("shard-3"), "--out", in("merged")});
  ASSERT_EQ(merged.exit_code, 0) << merged.err;
  EXPECT_EQ(exact("merged"), exact("whole"));
  EXPECT_EQ(schema_violations(schema("sweep"), file_text(in("merged/sweep.json"))), "");
  // One folder twice is one.
  ASSERT_EQ(palpate_command({"merge", in("shard-1"), in("shard-1"), "--out", in("twice")}).exit_code, 0);
  EXPECT_EQ(exact("twice"), exact("shard-1"));
}

TEST_F(Trade, MergeKeepsMachinesApartAndScenesOut) {
  ASSERT_EQ(sweep("a", {"--shard", "1/2"}).exit_code, 0);
  ASSERT_EQ(sweep("b", {"--shard", "2/2"}).exit_code, 0);
  ASSERT_EQ(sweep("other", {"--shard", "1/2"}, "plane:points=961").exit_code, 0);
  const ProcessOutcome refused = palpate_command({"merge", in("a"), in("other"), "--out", in("merged")});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("another scene"), std::string::npos) << refused.err;
  EXPECT_FALSE(std::filesystem::exists(in("merged")));
  // The second half as another machine has it.
  std::string rows = file_text(in("b/rows.jsonl"));
  const std::string hash = json::parse(rows.substr(0, rows.find('\n')))["machine"]["hash"];
  for (std::size_t at = 0; (at = rows.find(hash, at)) != std::string::npos;)
    rows.replace(at, hash.size(), "feedfacefeedface");
  write_text(in("b/rows.jsonl"), rows);
  ASSERT_EQ(palpate_command({"merge", in("a"), in("b"), "--out", in("merged")}).exit_code, 0);
  const json whole = document("merged");
  EXPECT_EQ(whole["machines"].size(), 2u);
  std::map<std::string, std::string> machine_of;
  for (const json& row : whole["rows"]) machine_of[row["setting"]] = row["machine"];
  for (const json& row : whole["rows"])
    if (row["dominated"] == true) {
      EXPECT_EQ(machine_of.at(row["dominated_by"]), row["machine"]) << row["setting"];
    }
  for (const char* file : {"figures/front-speed-1.svg", "figures/front-speed-2.svg"})
    EXPECT_TRUE(std::filesystem::exists(in(std::string("merged/") + file))) << file;
}

TEST_F(Trade, BrokenRowsAndForeignFoldersAreRefused) {
  ASSERT_EQ(sweep("out").exit_code, 0);
  const std::string rows = file_text(in("out/rows.jsonl")), report = file_text(in("out/report.html"));
  write_text(in("out/rows.jsonl"), rows + "{\"schema\":\"palpate-row/1\"");
  const ProcessOutcome cut = sweep("out");
  EXPECT_EQ(cut.exit_code, 2);
  EXPECT_NE(
      cut.err.find("rows.jsonl:" + std::to_string(std::count(rows.begin(), rows.end(), '\n') + 1) + ": "),
      std::string::npos)
      << cut.err;
  EXPECT_EQ(file_text(in("out/report.html")), report) << "nothing was touched";
  write_text(in("out/rows.jsonl"), rows);
  const ProcessOutcome other = sweep("out", {}, "plane:points=961");
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("another scene"), std::string::npos) << other.err;
  EXPECT_EQ(file_text(in("out/rows.jsonl")), rows);
  ASSERT_EQ(palpate_command({"replay", "plane:points=441", "--path", "tap:frames=300", "--out", in("study")})
                .exit_code,
            0);
  EXPECT_EQ(sweep("study").exit_code, 2) << "another command's results are not written over";
  EXPECT_TRUE(std::filesystem::exists(in("study/result.json")));
}

TEST_F(Trade, HostileOptionsAreAnswered) {
  std::string bare;
  for (int i = 0; i < 100; ++i) bare += fmt::format("{} {} 0\n", i / 10, i % 10);
  write_text(folder_ / "bare.xyz", bare);
  write_text(folder_ / "rough.toml",
             "[[model]]\ngenerate = \"plane\"\npoints = 441\n[model.surface]\nfriction = 0.5\n");
  for (const auto& [arguments, says] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"sweep", kTiny, "--axes", "shadng"}, "did you mean 'shading'?"},
           {{"sweep", kTiny, "--shard", "3/2"}, "--shard"},
           {{"sweep", kTiny, "--shard", "1"}, "--shard"},
           {{"sweep", kTiny, "--shard", "0/2"}, "--shard"},
           {{"sweep", kTiny, "--shard", "a/b"}, "--shard"},
           {{"sweep", kTiny, "--budget", "-1"}, "--budget"},
           {{"sweep", kTiny, "--budget", "nan"}, "--budget"},
           {{"sweep", kTiny, "--passes", "0"}, "--passes"},
           {{"sweep", kTiny, "--renderers", "cluod"}, "did you mean 'cloud'?"},
           {{"sweep", in("bare.xyz"), "--unit", "mm"}, "ground truth"},
           {{"sweep", in("rough.toml")}, "friction"},
           {{"sweep", in("nowhere.ply")}, "nowhere.ply"},
           {{"tune", kTiny}, "--max-error"},
           {{"tune", kTiny, "--max-error", "0"}, "--max-error"},
           {{"tune", kTiny, "--max-bytes", "-5"}, "--max-bytes"},
           {{"merge", in("nowhere")}, "nowhere"},
           {{"compare", kTiny, "--against", in("nowhere")}, "nowhere"},
           {{"compare", kTiny, "--against", in("rough.toml")}, "rough.toml"}}) {
    std::vector<std::string> all = arguments;
    all.insert(all.end(), {"--out", in("out")});
    const ProcessOutcome run = palpate_command(all);
    EXPECT_EQ(run.exit_code, 2) << arguments[0] << " " << arguments[2 % arguments.size()] << ": " << run.err;
    EXPECT_NE(run.err.find(says), std::string::npos) << run.err;
    EXPECT_FALSE(std::filesystem::exists(in("out/sweep.json")));
    EXPECT_FALSE(std::filesystem::exists(in("out/result.json")));
  }
}

TEST_F(Trade, TuneWritesASceneThatKeepsTheLimit) {
  write_text(folder_ / "scene.toml",
             "[[model]]\ngenerate = \"sinusoid\"\npoints = 961\nextent_mm = 20\nwavelength_mm = 20\n"
             "amplitude_mm = 1\nscale = 1.0\n[model.surface]\nstiffness_n_per_mm = 0.7\n[renderer]\n"
             "name = \"cloud\"\n");
  const std::vector<std::string> common = {
      "--renderers", "cloud,cloud-smooth", "--axes", "points,detail", "--path", kShort, "--passes", "2"};
  const auto tune = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"tune", in("scene.toml")});
    arguments.insert(arguments.end(), common.begin(), common.end());
    return palpate_command(arguments);
  };
  const ProcessOutcome run = tune({"--max-error", "8", "--out", in("out")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(schema_violations(schema("tune"), file_text(in("out/tune.json"))), "");
  const json answer = document("out", "tune.json");
  const json& tried = answer["evidence"]["tried"].back();
  EXPECT_EQ(tried["keeps"], true);
  EXPECT_LE(tried["verified"]["error_p95_percent_interval"][1], 8.0);
  EXPECT_EQ(tried["verified"]["trace_hash"], answer["chosen"]["trace_hash"]) << "the scene is the setting";
  // No other setting that keeps the limit is surely cheaper.
  for (const json& row : document("out")["rows"])
    if (row["status"] == "ok" && row["error_p95_percent_interval"][1] <= 8.0) {
      EXPECT_GE(row["load_percent_interval"][1], answer["chosen"]["load_percent_interval"][0])
          << row["setting"];
    }
  const ProcessOutcome replay = palpate_command(
      {"replay", in("out/tuned.toml"), "--path", kShort, "--passes", "1", "--out", in("again")});
  ASSERT_EQ(replay.exit_code, 0) << replay.err << file_text(in("out/tuned.toml"));
  EXPECT_EQ(document("again", "result.json")["renderers"][0]["trace_hash"], answer["chosen"]["trace_hash"]);
  // The most accurate in a budget, from the same rows: nothing is measured again.
  const std::string rows = file_text(in("out/rows.jsonl"));
  const json fine = answer["chosen"];
  const ProcessOutcome small = tune({"--max-bytes", "20000", "--out", in("out")});
  ASSERT_EQ(small.exit_code, 0) << small.err;
  EXPECT_EQ(file_text(in("out/rows.jsonl")), rows);
  EXPECT_LE(document("out", "tune.json")["evidence"]["tried"].back()["verified"]["bytes"], 20000);
  // What nothing keeps: the nearest is named, and no scene is left.
  const ProcessOutcome none = tune({"--max-error", "1e-6", "--max-bytes", "10", "--out", in("out")});
  EXPECT_EQ(none.exit_code, 1);
  EXPECT_NE(none.err.find("the nearest is "), std::string::npos) << none.err;
  EXPECT_FALSE(std::filesystem::exists(in("out/tuned.toml")));
  EXPECT_TRUE(document("out", "tune.json")["chosen"].is_null());
}

TEST_F(Trade, TunedSceneOfAFileStandsAnywhere) {
  std::string points;
  for (int i = 0; i < 31; ++i)
    for (int j = 0; j < 31; ++j)
      points += fmt::format("{} {} {}\n", 0.5 * i + 0.1 * (j % 3), 0.5 * j, 0.05 * j);
  write_text(folder_ / "my points.xyz", points);
  std::string mesh = "OFF\n4 2 0\n-1 -1 -0.1\n17 -1 -0.1\n17 16 1.6\n-1 16 1.6\n3 0 1 2\n3 0 2 3\n";
  write_text(folder_ / "truth.off", mesh);
  const ProcessOutcome run = palpate_command({"tune",        in("my points.xyz"),
                                              "--unit",      "mm",
                                              "--scale",     "2",
                                              "--reference", in("truth.off"),
                                              "--renderers", "cloud",
                                              "--axes",      "points",
                                              "--passes",    "1",
                                              "--path",      "exploration:frames=600",
                                              "--max-bytes", "1e6",
                                              "--out",       in("out")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const std::string scene = file_text(in("out/tuned.toml"));
  EXPECT_NE(scene.find(in("my points.xyz")), std::string::npos) << scene;
  std::filesystem::create_directories(folder_ / "elsewhere");
  std::filesystem::copy_file(folder_ / "out/tuned.toml", folder_ / "elsewhere/it.toml");
  EXPECT_EQ(palpate_command({"plan", in("elsewhere/it.toml")}).exit_code, 0);
}

TEST_F(Trade, CompareAgainstSaysWhatChanged) {
  const auto compare = [&](const std::string& out, std::vector<std::string> more) {
    std::vector<std::string> arguments = {"compare",  kTiny, "--path", kShort,
                                          "--passes", "2",   "--out",  in(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return palpate_command(arguments);
  };
  ASSERT_EQ(compare("before", {"--renderers", "cloud:refine=1:label=it"}).exit_code, 0);
  const ProcessOutcome same =
      compare("same", {"--renderers", "cloud:refine=1:label=it", "--against", in("before")});
  EXPECT_EQ(same.exit_code, 0) << same.out;
  EXPECT_EQ(schema_violations(schema("against"), file_text(in("same/against.json"))), "");
  const ProcessOutcome better =
      compare("better", {"--renderers", "cloud:label=it", "--against", in("before/result.json")});
  EXPECT_NE(better.out.find("memory.bytes"), std::string::npos) << better.out;
  std::map<std::string, std::string> verdicts;
  const json changes = document("better", "against.json");
  for (const json& change : changes["changes"]) verdicts[change["number"]] = change["verdict"];
  EXPECT_EQ(verdicts.at("memory.bytes"), "better") << "a quarter of the triangles";
  EXPECT_NE(changes["notes"].dump().find("other options"), std::string::npos);
  const ProcessOutcome worse =
      compare("worse", {"--renderers", "cloud:refine=1:label=it", "--against", in("better")});
  EXPECT_EQ(worse.exit_code, 1) << worse.out;
  const ProcessOutcome other = palpate_command({"compare", kTiny, "--path", "tap:frames=300", "--renderers",
                                                "cloud", "--out", in("other"), "--against", in("before")});
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("another path"), std::string::npos) << other.err;
}

}  // namespace
}  // namespace palpate::experiments
