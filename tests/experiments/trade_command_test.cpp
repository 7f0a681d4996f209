// palpate compare sweep, merge, tune and compare --against, as a user runs them, on a tiny scene.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const char* const kTiny =
    "sinusoid:points=961:extent_mm=20:wavelength_mm=20:amplitude_mm=1:sampling=random:noise=0.05:seed=1";
const char* const kShort = "weave:frames=900:depth_mm=0.5:clearance_mm=0.3:period_frames=300:seed=1";

class Trade : public OnCommandLine {
 protected:
  template <class... More>
  Words sweep(const std::string& out, const More&... more) const {
    return sweep_of(kTiny, out, more...);
  }
  template <class... More>
  Words sweep_of(const std::string& scene, const std::string& out, const More&... more) const {
    Words line = words("compare sweep", scene, "--axes points,rate --passes 2 --path", kShort, "--out",
                       in(out), more...);
    if (std::find(line.begin(), line.end(), "--renderers") == line.end())
      line.insert(line.end(), {"--renderers", "cloud,cloud-smooth"});
    return line;
  }
  json document(const std::string& out, const std::string& file = "sweep.json") const {
    return json_in(out + "/" + file);
  }
  std::size_t lines(const std::string& file) const {
    const std::string text = text_in(file);
    return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
  }
};

TEST_F(Trade, SweepMeasuresEverySettingAndDrawsTheFronts) {
  succeeds(sweep("out"));
  expect_valid("sweep", text_in("out/sweep.json"));
  std::istringstream rows(text_in("out/rows.jsonl"));
  for (std::string line; std::getline(rows, line);) expect_valid("rows", line);
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
    EXPECT_TRUE(exists(std::string("out/") + file)) << file;
  EXPECT_THAT(text_in("out/report.html"), HasSubstr("Dominated"));
  // What is measured here is what a comparison measures; single precision is kept frame by frame.
  succeeds("compare", kTiny, "--renderers cloud --path", kShort, "--passes 1 --out @/ab");
  const json alone = document("ab", "result.json")["renderers"][0];
  EXPECT_EQ(all["trace_hash"], alone["trace_hash"]);
  EXPECT_NEAR(all["error_p95_percent"].get<double>(), alone["accuracy"]["force_p95_percent"].get<double>(),
              1e-5 * all["error_p95_percent"].get<double>());
}

TEST_F(Trade, SweepStoppedBySignalKeepsItsRows) {
  apart_ = true;
  Started running(folder_,
                  {"compare", "sweep", kTiny, "--path", kShort, "--passes", "2", "--out", in("out")});
  ASSERT_TRUE(running.wait_for([&] { return lines("out/rows.jsonl") > 0; })) << running.err();
  running.send_group(SIGINT);
  EXPECT_EQ(running.end(), 130) << running.err();
  const std::string kept = text_in("out/rows.jsonl");
  EXPECT_GT(kept.size(), 0u);
  EXPECT_FALSE(exists("out/sweep.json")) << "nothing half done looks whole";
  succeeds(sweep("out"));
  EXPECT_TRUE(text_in("out/rows.jsonl").starts_with(kept)) << "what was measured is not measured again";
  expect_valid("sweep", text_in("out/sweep.json"));
}

TEST_F(Trade, MergedPartsAreTheWhole) {
  succeeds(sweep("whole"));
  for (const char* part : {"cloud", "cloud-smooth"}) succeeds(sweep(part, "--renderers", std::string(part)));
  succeeds("compare merge @/cloud @/cloud-smooth --out @/merged");
  EXPECT_EQ(exact("merged"), exact("whole"));
  expect_valid("sweep", text_in("merged/sweep.json"));
  draw_without_page("merged");
  EXPECT_THAT(text_in("merged/report.html"), HasSubstr("Most accurate"));
  EXPECT_TRUE(exists("merged/page.json"));
  // One folder twice is one.
  succeeds("compare merge @/cloud @/cloud --out @/twice");
  EXPECT_EQ(exact("twice"), exact("cloud"));
}

TEST_F(Trade, MergeKeepsMachinesApartAndScenesOut) {
  succeeds(sweep("a", "--renderers cloud"));
  succeeds(sweep("b", "--renderers cloud-smooth"));
  succeeds(sweep_of("plane:points=961", "other", "--renderers cloud"));
  refuses("another scene", "compare merge @/a @/other --out @/merged");
  EXPECT_FALSE(exists("merged"));
  // The second one as another machine has it.
  std::string rows = text_in("b/rows.jsonl");
  const std::string hash = json::parse(rows.substr(0, rows.find('\n')))["machine"]["hash"];
  for (std::size_t at = 0; (at = rows.find(hash, at)) != std::string::npos;)
    rows.replace(at, hash.size(), "feedfacefeedface");
  write_text(in("b/rows.jsonl"), rows);
  succeeds("compare merge @/a @/b --out @/merged");
  const json whole = document("merged");
  EXPECT_EQ(whole["machines"].size(), 2u);
  std::map<std::string, std::string> machine_of;
  for (const json& row : whole["rows"]) machine_of[row["setting"]] = row["machine"];
  for (const json& row : whole["rows"])
    if (row["dominated"] == true) {
      EXPECT_EQ(machine_of.at(row["dominated_by"]), row["machine"]) << row["setting"];
    }
  for (const char* file : {"figures/front-speed-1.svg", "figures/front-speed-2.svg"})
    EXPECT_TRUE(exists(std::string("merged/") + file)) << file;
}

TEST_F(Trade, BrokenRowsAndForeignFoldersAreRefused) {
  succeeds(sweep("out"));
  const std::string rows = text_in("out/rows.jsonl"), report = text_in("out/report.html");
  write_text(in("out/rows.jsonl"), rows + "{\"schema\":\"palpate-row/1\"");
  refuses("rows.jsonl:" + std::to_string(std::count(rows.begin(), rows.end(), '\n') + 1) + ": ",
          sweep("out"));
  EXPECT_EQ(text_in("out/report.html"), report) << "nothing was touched";
  write_text(in("out/rows.jsonl"), rows);
  refuses("another scene", sweep_of("plane:points=961", "out"));
  EXPECT_EQ(text_in("out/rows.jsonl"), rows);
  refuses("the folder holds the results of palpate compare sweep", "tune", kTiny,
          "--max-error 8 --passes 2 --path", kShort, "--out @/out");
  EXPECT_EQ(text_in("out/rows.jsonl"), rows);
  EXPECT_FALSE(exists("out/tune.json"));
  succeeds("compare plane:points=441 --path tap:frames=300 --out @/study --renderers auto");
  EXPECT_EQ(palpate(sweep("study")).exit_code, 2) << "another command's results are not written over";
  EXPECT_TRUE(exists("study/result.json"));
}

TEST_F(Trade, HostileOptionsAreAnswered) {
  std::string bare;
  for (int i = 0; i < 100; ++i) bare += fmt::format("{} {} 0\n", i / 10, i % 10);
  write_text(folder_ / "bare.xyz", bare);
  write_text(folder_ / "rough.toml",
             "[[model]]\ngenerate = \"plane\"\npoints = 441\n[model.surface]\nfriction = 0.5\n");
  for (const auto& [line, says] : std::vector<std::pair<const char*, const char*>>{
           {"compare sweep % --axes shadng", "did you mean 'shading'?"},
           {"compare sweep % --budget -1", "--budget"},
           {"compare sweep % --budget nan", "--budget"},
           {"compare sweep % --passes 0", "--passes"},
           {"compare sweep % --renderers cluod", "did you mean 'cloud'?"},
           {"compare sweep @/bare.xyz --unit mm", "ground truth"},
           {"compare sweep @/rough.toml", "friction"},
           {"compare sweep @/nowhere.ply", "nowhere.ply"},
           {"tune %", "--max-error"},
           {"tune % --max-error 0", "--max-error"},
           {"tune % --max-bytes -5", "--max-bytes"},
           {"compare merge @/nowhere", "nowhere"},
           {"compare % --against @/nowhere", "nowhere"},
           {"compare % --against @/rough.toml", "rough.toml"}}) {
    std::string all = line;
    if (const std::size_t at = all.find('%'); at != std::string::npos) all.replace(at, 1, kTiny);
    refuses(says, all.c_str(), "--out @/out");
    EXPECT_FALSE(exists("out/sweep.json"));
    EXPECT_FALSE(exists("out/result.json"));
  }
}

TEST_F(Trade, TuneWritesASceneThatKeepsTheLimit) {
  write_text(folder_ / "scene.toml",
             "[[model]]\ngenerate = \"sinusoid\"\npoints = 961\nextent_mm = 20\nwavelength_mm = 20\n"
             "amplitude_mm = 1\nscale = 1.0\n[model.surface]\nstiffness_n_per_mm = 0.7\n[renderer]\n"
             "name = \"cloud\"\n");
  const auto tune = [&](const char* limits) {
    return words("tune @/scene.toml --renderers cloud,cloud-smooth --axes points,detail --passes 2 --path",
                 kShort, limits);
  };
  succeeds(tune("--max-error 8 --out @/out"));
  expect_valid("tune", text_in("out/tune.json"));
  const json answer = document("out", "tune.json");
  const json& tried = answer["evidence"]["tried"].back();
  EXPECT_EQ(tried["keeps"], true);
  EXPECT_LE(tried["verified"]["error_p95_percent_interval"][1], 8.0);
  EXPECT_EQ(tried["verified"]["trace_hash"], answer["chosen"]["trace_hash"]) << "the scene is the setting";
  const auto answers = [&] { return document("out", "page.json")["answers"][0]; };
  EXPECT_EQ(answers()["lead"], "Take");
  EXPECT_THAT(answers()["text"].get<std::string>(),
              HasSubstr(answer["chosen"]["setting"].get<std::string>() + ": the cheapest that keeps "));
  EXPECT_EQ(document("out", "page.json")["tables"][0]["rows"].size(), 3u) << "asked, measured, run again";
  // No other setting that keeps the limit is surely cheaper.
  for (const json& row : document("out")["rows"])
    if (row["status"] == "ok" && row["error_p95_percent_interval"][1] <= 8.0) {
      EXPECT_GE(row["load_percent_interval"][1], answer["chosen"]["load_percent_interval"][0])
          << row["setting"];
    }
  succeeds("compare @/out/tuned.toml --path", kShort, "--passes 1 --out @/again --renderers auto");
  EXPECT_EQ(document("again", "result.json")["renderers"][0]["trace_hash"], answer["chosen"]["trace_hash"]);
  // The most accurate in a budget, from the same rows: nothing is measured again.
  const std::string rows = text_in("out/rows.jsonl");
  refuses("the folder holds the results of palpate tune",
          "compare sweep @/scene.toml --passes 2 --out @/out --path", kShort);
  const json fine = answer["chosen"];
  succeeds(tune("--max-bytes 20000 --out @/out"));
  EXPECT_EQ(text_in("out/rows.jsonl"), rows);
  EXPECT_LE(document("out", "tune.json")["evidence"]["tried"].back()["verified"]["bytes"], 20000);
  // What nothing keeps: the nearest is named, and no scene is left.
  ends_with(1, "the nearest is ", words(tune("--max-error 1e-6 --max-bytes 10 --out @/out")));
  EXPECT_FALSE(exists("out/tuned.toml"));
  EXPECT_TRUE(document("out", "tune.json")["chosen"].is_null());
  EXPECT_EQ(answers()["lead"], "Nothing");
}

TEST_F(Trade, TunedSceneOfAFileStandsAnywhere) {
  std::string points;
  for (int i = 0; i < 31; ++i)
    for (int j = 0; j < 31; ++j)
      points += fmt::format("{} {} {}\n", 0.5 * i + 0.1 * (j % 3), 0.5 * j, 0.05 * j);
  write_text(folder_ / "my points.xyz", points);
  std::string mesh = "OFF\n4 2 0\n-1 -1 -0.1\n17 -1 -0.1\n17 16 1.6\n-1 16 1.6\n3 0 1 2\n3 0 2 3\n";
  write_text(folder_ / "truth.off", mesh);
  succeeds("tune", in("my points.xyz"),
           "--unit mm --scale 2 --within -1,-1,-1,26,40,9 --reference @/truth.off --renderers cloud --axes "
           "points --passes 1 --path "
           "exploration:frames=600 --max-bytes 1e6 --out @/out");
  const std::string scene = text_in("out/tuned.toml");
  EXPECT_THAT(scene, HasSubstr(in("my points.xyz")));
  EXPECT_THAT(scene, HasAll("within_mm = [", "26.0", "40.0"));
  std::filesystem::create_directories(folder_ / "elsewhere");
  std::filesystem::copy_file(folder_ / "out/tuned.toml", folder_ / "elsewhere/it.toml");
  succeeds("info plan @/elsewhere/it.toml");
}

TEST_F(Trade, CompareAgainstSaysWhatChanged) {
  const auto compare = [&](const std::string& out, const char* more) {
    return palpate("compare", kTiny, "--path", kShort, "--passes 2 --out", in(out), more);
  };
  ASSERT_EQ(compare("before", "--renderers cloud:refine=1:label=it").exit_code, 0);
  const ProcessOutcome same = compare("same", "--renderers cloud:refine=1:label=it --against @/before");
  EXPECT_EQ(same.exit_code, 0) << same.out;
  expect_valid("against", text_in("same/against.json"));
  const ProcessOutcome better =
      compare("better", "--renderers cloud:label=it --against @/before/result.json");
  EXPECT_THAT(better.out, HasSubstr("memory.bytes"));
  std::map<std::string, std::string> verdicts;
  const json changes = document("better", "against.json");
  for (const json& change : changes["changes"]) verdicts[change["number"]] = change["verdict"];
  EXPECT_EQ(verdicts.at("memory.bytes"), "better") << "a quarter of the triangles";
  EXPECT_THAT(changes["notes"].dump(), HasSubstr("other options"));
  const ProcessOutcome worse = compare("worse", "--renderers cloud:refine=1:label=it --against @/better");
  EXPECT_EQ(worse.exit_code, 1) << worse.out;
  refuses("another path", "compare", kTiny,
          "--path tap:frames=300 --renderers cloud --out @/other --against @/before");
}

}  // namespace
}  // namespace palpate::experiments
