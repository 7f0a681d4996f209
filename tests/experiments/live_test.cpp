// palpate live as a user runs it, on a tiny scene.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/experiments/program.h"
#include "tests/json_schema.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const char* const kSmallWaves = "sinusoid:points=2601:extent_mm=40:wavelength_mm=20:amplitude_mm=1";

class Live : public InFolder {
 protected:
  ProcessOutcome live(const std::string& out, std::vector<std::string> more,
                      const std::string& renderers = "cloud,cloud-smooth") {
    std::vector<std::string> arguments = {"live", kSmallWaves, "--renderers", renderers, "--out", in(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return palpate_command(arguments);
  }
  json document(const std::string& out) const { return json::parse(file_text(in(out + "/live.json"))); }
};

TEST_F(Live, SwitchesUnderTheHandWithoutAStepOfItsOwnAndIsTheSameTwice) {
  const std::vector<std::string> few = {"--seconds", "4", "--switch-every", "0.3", "--accelerated"};
  const ProcessOutcome run = live("out", few);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(
      schema_violations(std::string(PALPATE_DOCS) + "/live.schema.json", file_text(in("out/live.json"))), "");
  const json first = document("out");
  EXPECT_EQ(first["ticks"], 4001);
  EXPECT_EQ(first["late"], 0);
  EXPECT_EQ(first["faults"], 0);
  EXPECT_GT(first["switches"], 4);
  EXPECT_LT(first["largest_excess_n"], 1e-12) << "more than rounding";
  EXPECT_GT(first["largest_step_n"], 0.0);
  for (const json& renderer : first["renderers"]) {
    EXPECT_GT(renderer["contact_frames"], 500) << renderer["label"];
    EXPECT_GT(renderer["felt_frames"], 500) << renderer["label"];
    EXPECT_EQ(renderer["frames"], 4001) << "stepped every frame";
    EXPECT_EQ(renderer["disqualified"], "");
  }
  EXPECT_NE(run.out.find("The session"), std::string::npos);
  ASSERT_EQ(live("again", few).exit_code, 0);
  const json second = document("again");
  EXPECT_EQ(first["decisions"], second["decisions"]);
  EXPECT_EQ(first["largest_step_n"], second["largest_step_n"]);
}

TEST_F(Live, AChangeOfParametersTakesOverInTheSameLane) {
  const ProcessOutcome run = live(
      "out", {"--seconds", "3", "--changes", "1:cloud:stiffness=0.8,2:cloud:shading=none", "--accelerated"},
      "cloud");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json live = document("out");
  EXPECT_EQ(live["renderers"][0]["made"], 3);
  int by_parameters = 0;
  for (const json& decision : live["decisions"])
    if (decision["source"] == "parameters" && decision["reason"] == "") ++by_parameters;
  EXPECT_GE(by_parameters, 2);
  EXPECT_LT(live["largest_excess_n"], 1e-12);
}

TEST_F(Live, TheMappingIsStatedAsItIsFelt) {
  ASSERT_EQ(live("out", {"--seconds", "1", "--mapping", "2", "--accelerated"}).exit_code, 0);
  const json mapping = document("out")["mapping"];
  EXPECT_EQ(mapping["world_per_device"], 2.0);
  EXPECT_EQ(mapping["felt_stiffness_n_per_mm"].get<double>(),
            2.0 * mapping["stiffness_n_per_mm"].get<double>());
}

TEST_F(Live, RunsInRealTime) {
  const ProcessOutcome run = live("out", {"--seconds", "1", "--switch-every", "0.2", "--rearm"});
  const json live = document("out");
  // Whatever the machine does: what was not ticked was counted.
  EXPECT_NEAR(live["ticks"].get<double>() + live["late"].get<double>(), 1000.0, 200.0) << run.err;
  EXPECT_NE(live["scheduling"], "");
}

TEST_F(Live, WhatIsWrongIsNamedAndNothingIsLeft) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> wrong = {
      {{"--device", "sim:omny"}, "sim:omni"},
      {{"--grip", "paw"}, "finger"},
      {{"--hand", "wave"}, "explore"},
      {{"--rule", "perhaps"}, "refuse"},
      {{"--mapping", "large"}, "--mapping"},
      {{"--mapping", "0"}, "--mapping"},
      {{"--rate", "1000.5"}, "whole"},
      {{"--seconds", "0"}, "--seconds"},
      {{"--changes", "1:cloud"}, "--changes"},
      {{"--changes", "1:clod:shading=none"}, "clod"},
      {{"--changes", "1:cloud:shadow=none"}, "shadow"},
      {{"--changes", "2:cloud:stiffness=0.8,1:cloud:stiffness=0.7"}, "before"},
      {{"--record", "session.palrec"}, "--record"},
  };
  for (const auto& [arguments, named] : wrong) {
    const ProcessOutcome run = live("bad", arguments);
    EXPECT_EQ(run.exit_code, 2) << named << run.err;
    EXPECT_NE(run.err.find(named), std::string::npos) << run.err;
    EXPECT_FALSE(std::filesystem::exists(in("bad/live.json")));
  }
}

}  // namespace
}  // namespace palpate::experiments
