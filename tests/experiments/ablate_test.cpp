// palpate ablate and plan --check, as a user runs them, on tiny scenes.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "tests/experiments/program.h"
#include "tests/json_schema.h"
#include "toolkit/core/instructions.h"

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

class Ablate : public InFolder {
 protected:
  ProcessOutcome ablate(const std::string& scene, const std::string& out,
                        std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"ablate", scene, "--path", kPress, "--out", in(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return palpate_command(arguments);
  }
  json document(const std::string& out) const { return json::parse(file_text(in(out + "/ablate.json"))); }
  static std::map<std::string, json> by_stage(const json& document) {
    std::map<std::string, json> rows;
    for (const json& row : document["rows"])
      rows[row["stage"].is_null() ? std::string() : row["stage"].get<std::string>()] = row;
    return rows;
  }
};

TEST_F(Ablate, EveryStageOfASceneIsLeftOutInTurn) {
  write_text(in("much.toml"), kMuch);
  const ProcessOutcome run = ablate(in("much.toml"), "out");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(
      schema_violations(std::string(PALPATE_DOCS) + "/ablate.schema.json", file_text(in("out/ablate.json"))),
      "");
  EXPECT_TRUE(std::filesystem::exists(in("out/report.html")));
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
  if (const Status able = can_count(); !able) GTEST_SKIP() << able.error().message();
  const std::string scene = "sinusoid:points=961:extent_mm=20:wavelength_mm=20:amplitude_mm=1";
  std::vector<std::map<std::string, json>> runs;
  for (const char* out : {"one", "two"}) {
    const ProcessOutcome run = ablate(scene, out, {"--renderer", "cloud", "--friction", "0.7,0.5"});
    ASSERT_EQ(run.exit_code, 0) << run.err;
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
  const ProcessOutcome run = ablate("sinusoid:points=961:extent_mm=20:wavelength_mm=20:amplitude_mm=1", "out",
                                    {"--renderer", "cloud", "--budget", "0", "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json printed = json::parse(run.out);
  EXPECT_EQ(printed, document("out"));
  ASSERT_EQ(printed["rows"].size(), 1u);
  EXPECT_TRUE(printed["rows"][0]["instructions"].is_null());
  EXPECT_GT(printed["rows"][0]["truth_percent"].get<double>(), 0.0);
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
  const ProcessOutcome run = ablate(in("clean.toml"), "out", {"--budget", "0"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const std::map<std::string, json> rows = by_stage(document("out"));
  ASSERT_TRUE(rows.contains("cleaning of the scene"));
  EXPECT_LT(rows.at("cleaning of the scene")["saves"]["bytes"].get<double>(), 0.0) << "more points are left";
}

TEST_F(Ablate, WhatIsWrongIsSaidAndLeavesNoFile) {
  write_text(in("typo.toml"), "[[model]]\ngenerat = \"plane\"\n");
  write_text(in("inside.csv"), "t_s,x_mm,y_mm,z_mm\n0,0,0,-5\n0.001,0,0,-5\n");
  const std::string plane = "plane:points=441:extent_mm=20";
  struct Case {
    std::vector<std::string> arguments;
    const char* says;
  };
  for (const Case& c : std::vector<Case>{{{in("typo.toml")}, "generat"},
                                         {{in("nothing.ply")}, "nothing.ply"},
                                         {{plane, "--renderer", "nonsense"}, "nonsense"},
                                         {{plane, "--renderer", "cloud,cloud-smooth"}, "one renderer"},
                                         {{plane, "--renderer", "cloud-smooth:detail=nan"}, "detail"},
                                         {{plane, "--budget", "nan"}, "budget"},
                                         {{plane, "--budget", "-1"}, "budget"},
                                         {{plane, "--friction", "2,3"}, "friction"},
                                         {{plane, "--path", in("inside.csv")}, "inside"}}) {
    std::vector<std::string> arguments = {"ablate"};
    arguments.insert(arguments.end(), c.arguments.begin(), c.arguments.end());
    arguments.insert(arguments.end(), {"--out", in("out")});
    const ProcessOutcome run = palpate_command(arguments);
    EXPECT_EQ(run.exit_code, 2) << c.says << run.err;
    EXPECT_NE(run.err.find(c.says), std::string::npos) << run.err;
    EXPECT_FALSE(std::filesystem::exists(in("out/ablate.json"))) << c.says;
    EXPECT_FALSE(std::filesystem::exists(in("out/report.html"))) << c.says;
  }
}

TEST_F(Ablate, ThePlanIsCheckedByRunningIt) {
  Environment cache("XDG_CACHE_HOME", in("cache").c_str());
  for (const char* renderer : {"cloud", "cloud-smooth", "heightfield", "cloud:surface=vertices"}) {
    const ProcessOutcome run =
        palpate_command({"plan", "sinusoid:points=10201", "--renderer", renderer, "--check", "--json"});
    ASSERT_EQ(run.exit_code, 0) << run.err;
    EXPECT_EQ(schema_violations(std::string(PALPATE_DOCS) + "/plan.schema.json", run.out), "");
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
