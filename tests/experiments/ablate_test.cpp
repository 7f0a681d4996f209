// palpate compare ablate and plan --check, as a user runs them, on tiny scenes.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "tests/experiments/program.h"
#include "toolkit/core/instruction_counter.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

// Everything that a surface, a motion and control can ask for; the path presses into both halves.
const char* const kMuch = R"(
[[model]]
generate = "sinusoid"
points = 961
extent_mm = 20
wavelength_mm = 20
amplitude_mm = 1
  [model.surface]
  stiffness_n_per_mm = 0.5
  friction = { static = 0.7, dynamic = 0.5 }
    [model.surface.texture]
    kind = "noise"
    depth_mm = 0.05
    wavelength_mm = 1.0
  [[model.region]]
  x_mm = [0, 100]
  deformation = 0.5
[[model]]
generate = "sphere"
points = 500
extent_mm = 4
position_mm = [0, 0, 4]
  [model.motion]
  velocity_mm_s = [0.5, 0, 0]
[renderer]
name = "cloud"
refine = 1
[control]
force_limit_n = 0.1
)";
const char* const kPress = "weave:frames=900:depth_mm=0.5:clearance_mm=0.3:period_frames=300:seed=1";

class Ablate : public OnCommandLine {
 protected:
  /// Instructions are counted in the program, started again.
  void count() { apart_ = true; }
  template <class... More>
  Words ablate(const std::string& scene, const std::string& out, const More&... more) const {
    return words("compare ablate", scene, "--path", kPress, "--out", in(out), more...);
  }
  json document(const std::string& out) const { return json_in(out + "/ablate.json"); }
  static std::map<std::string, json> by_stage(const json& document) {
    std::map<std::string, json> rows;
    for (const json& row : document["rows"])
      rows[row["stage"].is_null() ? std::string() : row["stage"].get<std::string>()] = row;
    return rows;
  }
};

TEST_F(Ablate, EveryStageOfASceneIsLeftOutInTurn) {
  count();
  write_text(in("much.toml"), kMuch);
  succeeds(ablate(in("much.toml"), "out"));
  expect_valid("ablate", text_in("out/ablate.json"));
  EXPECT_TRUE(exists("out/report.html"));
  const json whole_document = document("out");
  const std::map<std::string, json> rows = by_stage(whole_document);
  const json& whole = rows.at("");
  EXPECT_TRUE(whole["error_percent"].is_null());
  EXPECT_TRUE(whole["truth_percent"].is_null()) << "no truth knows friction";
  for (const char* stage : {"friction", "deformation", "texture", "motion", "model 1, sinusoid",
                            "model 2, sphere", "force limit", "option refine"}) {
    ASSERT_TRUE(rows.contains(stage)) << stage;
    EXPECT_EQ(rows.at(stage)["status"], "ok") << stage << rows.at(stage)["reason"];
    EXPECT_EQ(rows.at(stage)["saves"]["bytes"].get<double>(),
              whole["bytes"].get<double>() - rows.at(stage)["bytes"].get<double>());
  }
  EXPECT_EQ(rows.size(), 9u) << whole_document["rows"].dump(1);
  // What is left out is out: the answers differ, and by as much as the thing does.
  for (const char* stage : {"friction", "deformation", "texture", "force limit", "model 1, sinusoid"})
    EXPECT_GT(rows.at(stage)["error_percent"].get<double>(), 1.0) << stage;
  EXPECT_NEAR(rows.at("model 1, sinusoid")["error_percent"].get<double>(), 100.0, 15.0)
      << "the path is over it";
  EXPECT_GT(rows.at("deformation")["saves"]["bytes"].get<double>(), 0.0) << "it varies from point to point";
  EXPECT_EQ(rows.at("force limit")["saves"]["bytes"], 0.0);
  EXPECT_GT(rows.at("option refine")["saves"]["bytes"].get<double>(), 0.5 * whole["bytes"].get<double>());
}

TEST_F(Ablate, InstructionsAreTheSameOnEveryRun) {
  if (const Status able = can_count_instructions(); !able) GTEST_SKIP() << able.error().message();
  count();
  const std::string scene = "sinusoid:points=961:extent_mm=20:wavelength_mm=20:amplitude_mm=1";
  std::vector<std::map<std::string, json>> runs;
  for (const char* out : {"one", "two"}) {
    succeeds(ablate(scene, out, "--renderer cloud --friction 0.7,0.5"));
    runs.push_back(by_stage(document(out)));
  }
  for (const auto& [stage, row] : runs[0]) {
    EXPECT_EQ(row["instructions"], runs[1].at(stage)["instructions"]) << stage;
    EXPECT_EQ(row["trace_hash"], runs[1].at(stage)["trace_hash"]) << stage;
  }
  // A cone costs some dozen instructions in each frame of contact.
  EXPECT_GT(runs[0].at("friction")["saves"]["instructions"].get<double>(), 10.0);
}

TEST_F(Ablate, ASceneThatAsksForNothingIsSaidToNeedAllThatItHas) {
  const json answer = printed(ablate("sinusoid:points=961:extent_mm=20:wavelength_mm=20:amplitude_mm=1",
                                     "out", "--renderer cloud --budget 0 --json"));
  EXPECT_EQ(answer, document("out"));
  ASSERT_EQ(answer["rows"].size(), 1u);
  EXPECT_TRUE(answer["rows"][0]["instructions"].is_null());
  EXPECT_GT(answer["rows"][0]["truth_percent"].get<double>(), 0.0);
}

TEST_F(Ablate, CleaningIsAStageOfItsOwn) {
  write_text(in("clean.toml"), R"([[model]]
generate = "sinusoid"
points = 961
extent_mm = 20
wavelength_mm = 20
amplitude_mm = 1
  [[model.clean]]
  step = "thin"
  cell = 2.0
[renderer]
name = "cloud"
)");
  succeeds(ablate(in("clean.toml"), "out", "--budget 0"));
  const std::map<std::string, json> rows = by_stage(document("out"));
  ASSERT_TRUE(rows.contains("cleaning of the scene"));
  EXPECT_LT(rows.at("cleaning of the scene")["saves"]["bytes"].get<double>(), 0.0) << "more points are left";
}

TEST_F(Ablate, WhatIsWrongIsSaidAndLeavesNoFile) {
  write_text(in("typo.toml"), "[[model]]\ngenerat = \"plane\"\n");
  write_text(in("inside.csv"), "t_s,x_mm,y_mm,z_mm\n0,0,0,-5\n0.001,0,0,-5\n");
  for (const auto& [line, says] : std::vector<std::pair<const char*, const char*>>{
           {"@/typo.toml", "generat"},
           {"@/nothing.ply", "nothing.ply"},
           {"plane --renderer nonsense", "nonsense"},
           {"plane --renderer cloud,cloud-smooth", "one renderer"},
           {"plane --renderer cloud-smooth:detail=nan", "detail"},
           {"plane --budget nan", "budget"},
           {"plane --budget -1", "budget"},
           {"plane --friction 2,3", "friction"},
           {"plane --path @/inside.csv", "inside"}}) {
    refuses(says, "compare ablate", line, "--out @/out");
    EXPECT_FALSE(exists("out/ablate.json")) << says;
    EXPECT_FALSE(exists("out/report.html")) << says;
  }
}

TEST_F(Ablate, ThePlanIsCheckedByRunningIt) {
  Environment cache("XDG_CACHE_HOME", in("cache").c_str());
  for (const char* renderer : {"cloud", "cloud-smooth", "heightfield", "cloud-vertices"}) {
    const ProcessOutcome run =
        succeeds("info plan sinusoid:points=10201 --renderer", renderer, "--check --json");
    expect_valid("plan", run.out);
    const json plan = json::parse(run.out);
    EXPECT_LE(std::abs(plan["measured"]["bytes_off_percent"].get<double>()), 25.0) << renderer;
    EXPECT_GT(plan["measured"]["frame_us"].get<double>(), 0.0);
    EXPECT_FALSE(plan["measured"]["frame_off_percent"].is_null());
  }
  std::size_t kept = 0;
  for (const auto& file : std::filesystem::directory_iterator(in("cache/palpate")))
    kept += file.path().filename().string().starts_with("machine-");
  EXPECT_EQ(kept, 1u) << "this machine is measured once";
}

}  // namespace
}  // namespace palpate::experiments
