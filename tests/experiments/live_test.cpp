// palpate live as a user runs it, on a tiny scene.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const char* const kSmallWaves = "sinusoid:points=2601:extent_mm=40:wavelength_mm=20:amplitude_mm=1";

class Live : public OnCommandLine {
 protected:
  template <class... More>
  Words live(const std::string& out, const More&... more) const {
    return live_of("cloud,cloud-smooth", out, more...);
  }
  template <class... More>
  Words live_of(const std::string& renderers, const std::string& out, const More&... more) const {
    return words("live", kSmallWaves, "--renderers", renderers, "--out", in(out), more...);
  }
  json document(const std::string& out) const { return json_in(out + "/live.json"); }
};

TEST_F(Live, SwitchesUnderTheHandWithoutAStepOfItsOwnAndIsTheSameTwice) {
  const std::vector<std::string> few = {"--seconds", "4", "--switch-every", "0.3", "--accelerated"};
  const ProcessOutcome run = succeeds(live("out", few));
  expect_valid("live", text_in("out/live.json"));
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
  EXPECT_THAT(run.out, HasSubstr("The session"));
  succeeds(live("again", few));
  const json second = document("again");
  EXPECT_EQ(first["decisions"], second["decisions"]);
  EXPECT_EQ(first["largest_step_n"], second["largest_step_n"]);
  for (const std::size_t i : {0u, 1u})
    EXPECT_EQ(first["renderers"][i]["felt_steps"], second["renderers"][i]["felt_steps"]);
}

TEST_F(Live, AKickUnderTheHandIsCountedAndAnExactSurfaceHasNone) {
  const std::vector<std::string> few = {"--seconds", "6", "--hand", "explore", "--accelerated", "--verbose"};
  // A penalty for each near point: its force steps as points come and go.
  succeeds(live_of("penalty-grid", "kicks", few));
  const json kicks = document("kicks")["renderers"][0]["felt_steps"];
  EXPECT_GT(kicks["over_0_2_n"], 0);
  EXPECT_GT(kicks["largest_excess"]["n"], 0.2);
  EXPECT_GE(kicks["over_0_1_n"], kicks["over_0_2_n"]);
  const ProcessOutcome run = succeeds(live_of("analytic", "exact", few));
  const json exact = document("exact")["renderers"][0];
  EXPECT_GT(exact["contact_frames"], 1000);
  EXPECT_GT(exact["felt_steps"]["largest"]["n"], 0.0);
  EXPECT_EQ(exact["felt_steps"]["over_0_1_n"], 0);
  EXPECT_THAT(run.out, HasSubstr("Steps of the force that is felt"));
}

TEST_F(Live, AHandFollowsAPathAndExploresOtherwise) {
  succeeds(live("follow", "--seconds 0.2 --path weave:frames=500 --accelerated"));
  EXPECT_EQ(document("follow")["hand"], "follow");
  succeeds(live("explore", "--seconds 0.2 --path hand:seed=7 --accelerated"));
  const json explored = document("explore");
  EXPECT_EQ(explored["hand"], "explore");
  EXPECT_THAT(explored["path"].get<std::string>(), HasSubstr("seed=7"));
}

TEST_F(Live, AChangeOfParametersTakesOverInTheSameLane) {
  succeeds(
      live_of("cloud", "out", "--seconds 3 --changes 1:cloud:stiffness=0.8,2:cloud:refine=1 --accelerated"));
  const json live = document("out");
  EXPECT_EQ(live["renderers"][0]["made"], 3);
  int by_parameters = 0;
  for (const json& decision : live["decisions"])
    if (decision["source"] == "parameters" && decision["reason"] == "") ++by_parameters;
  EXPECT_GE(by_parameters, 2);
  EXPECT_LT(live["largest_excess_n"], 1e-12);
}

TEST_F(Live, ARecordingHoldsEveryRendererAndIsReplayedToTheBit) {
  succeeds(live("out",
                "--seconds 3 --hand follow --switch-every 0.3 --changes 1:cloud:refine=1 --accelerated "
                "--record @/session.palrec"));
  const json recording = document("out")["recording"];
  EXPECT_EQ(recording["ticks"], 3001);
  EXPECT_EQ(recording["written"], 3001);
  EXPECT_EQ(recording["lost"], 0);
  for (const std::string renderer : {"cloud", "cloud-smooth"}) {
    succeeds("compare", kSmallWaves, "--renderers", renderer, "--path @/session.palrec --out",
             in("again-" + renderer));
    const json segments = json_in("again-" + renderer + "/segments.json")["segments"];
    ASSERT_FALSE(segments.empty());
    for (const json& segment : segments) {
      EXPECT_EQ(segment["same"], true) << renderer;
      EXPECT_GT(segment["contact_frames"], 100) << renderer;
    }
  }
  EXPECT_EQ(palpate(live("out", "--seconds 1 --accelerated --record @/session.palrec")).exit_code, 2)
      << "a recording is not replaced unasked";
}

TEST_F(Live, TheMappingIsStatedAsItIsFelt) {
  succeeds(live("out", "--seconds 1 --mapping 2 --accelerated"));
  const json mapping = document("out")["mapping"];
  EXPECT_EQ(mapping["world_per_device"], 2.0);
  EXPECT_EQ(mapping["felt_stiffness_n_per_mm"].get<double>(),
            2.0 * mapping["stiffness_n_per_mm"].get<double>());
}

TEST_F(Live, RunsInRealTime) {
  const ProcessOutcome run = palpate(live("out", "--seconds 1 --switch-every 0.2 --rearm"));
  const json live = document("out");
  // Whatever the machine does: what was not ticked was counted.
  EXPECT_GT(live["ticks"].get<double>() + live["late"].get<double>(), 900.0) << run.err;
  EXPECT_NE(live["scheduling"], "");
}

TEST_F(Live, WhatIsWrongIsNamedAndNothingIsLeft) {
  const std::pair<const char*, const char*> wrong[] = {
      {"--device sim:omny", "sim:omni"},
      {"--grip paw", "finger"},
      {"--hand wave", "explore"},
      {"--rule perhaps", "refuse"},
      {"--mapping large", "--mapping"},
      {"--mapping 0", "--mapping"},
      {"--rate 1000.5", "whole"},
      {"--seconds 0", "--seconds"},
      {"--changes 1:cloud", "--changes"},
      {"--changes 1:clod:shading=none", "clod"},
      {"--changes 1:cloud:shadow=none", "shadow"},
      {"--changes 2:cloud:stiffness=0.8,1:cloud:stiffness=0.7", "before"},
      {"--record session.txt", ".palrec"},
      {"--record no/such/folder/a.palrec", "folder"}};
  for (const auto& [arguments, named] : wrong) {
    refuses(named, live("bad", arguments));
    EXPECT_FALSE(exists("bad/live.json"));
  }
}

}  // namespace
}  // namespace palpate::experiments
