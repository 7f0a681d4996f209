// palpate test stability as a user runs it, on a tiny scene.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/experiments/program.h"
#include "toolkit/metrics/force_steps.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const char* const kWaves = "sinusoid:points=2601:extent_mm=40:wavelength_mm=20:amplitude_mm=1";

class Stability : public OnCommandLine {
 protected:
  template <class... More>
  Words stability(const std::string& out, const More&... more) const {
    return words("test stability", kWaves, "--renderers cloud --path weave:frames=1500:depth_mm=0.5 --out",
                 in(out), more...);
  }
  json document(const std::string& out) const { return json_in(out + "/stability.json"); }
};

double largest(const json& document, const std::string& renderer, const std::string& hand,
               const std::string& varied, const std::string& key, const json& value) {
  for (const json& point : document["points"])
    if (point["renderer"] == renderer && point["hand"] == hand && point["varied"] == varied &&
        point[key] == value)
      return point["largest_stable_n_per_mm"];
  ADD_FAILURE() << "no point " << renderer << " " << hand << " " << key << " " << value;
  return -1.0;
}

TEST_F(Stability, MeasuresLimitsTasksAndScoresAndIsTheSameTwice) {
  const std::vector<std::string> small = {"--rates", "1000", "--delays", "0,2", "--dampings", "0"};
  const ProcessOutcome run = succeeds(stability("out", small));
  expect_valid("stability", text_in("out/stability.json"));
  EXPECT_THAT(run.out, HasSubstr("Largest stable stiffness"));
  const json first = document("out");
  for (const char* const hand : {"hand", "released"}) {
    const double without = largest(first, "truth", hand, "delay", "delay_ms", 0.0);
    const double with = largest(first, "truth", hand, "delay", "delay_ms", 2.0);
    EXPECT_GT(without, 0.3) << hand;
    EXPECT_LT(with, 0.7 * without) << hand << ": two milliseconds of delay cost stability";
    EXPECT_NEAR(largest(first, "cloud", hand, "delay", "delay_ms", 2.0), with, 0.5 * with) << hand;
  }
  EXPECT_GT(largest(first, "cloud", "hand", "control", "control", "coupling"),
            2.0 * largest(first, "cloud", "hand", "control", "control", "none"))
      << "behind a passive coupling no stiffness is too much";
  ASSERT_EQ(first["scores"].size(), 1u);
  for (const char* const loop : {"open", "closed"}) {
    EXPECT_GT(first["scores"][0][loop]["contact_frames"], 200) << loop;
    EXPECT_LT(first["scores"][0][loop]["force_rms_percent"], 20.0) << loop;
  }
  bool tapped = false;
  for (const json& task : first["tasks"]) {
    EXPECT_TRUE(task["stable"]) << task;
    EXPECT_LT(task["contour_max_mm"], 0.3) << task;
    EXPECT_GT(task["largest_step_n"], 0.0) << task;
    EXPECT_LT(task["largest_excess_n"], metrics::kCleanExcessN) << task;
    tapped = tapped || task["task"] == "tap";
  }
  EXPECT_TRUE(tapped);
  succeeds(stability("again", small));
  const json second = document("again");
  for (const char* const part : {"points", "tasks", "scores"}) EXPECT_EQ(first[part], second[part]) << part;
}

TEST_F(Stability, EveryRateWithEveryDelayIsMeasuredWhereAsked) {
  const ProcessOutcome run =
      succeeds(stability("out", "--rates 1000 --delays 2 --dampings 0 --cross --verbose"));
  expect_valid("stability", text_in("out/stability.json"));
  const json found = document("out");
  std::size_t crossed = 0;
  for (const json& point : found["points"]) crossed += point["varied"] == "cross";
  EXPECT_EQ(crossed, 12u) << "truth and cloud, two hands, three controls";
  for (const char* const renderer : {"truth", "cloud"}) {
    const double without = largest(found, renderer, "hand", "cross", "control", "none");
    EXPECT_EQ(without, largest(found, renderer, "hand", "delay", "delay_ms", 2.0)) << renderer;
    EXPECT_GT(largest(found, renderer, "hand", "cross", "control", "coupling"), 2.0 * without) << renderer;
    EXPECT_THAT(run.out, HasSubstr(std::string("over rate and delay, N/mm: ") + renderer));
    EXPECT_TRUE(exists(std::string("out/figures/limit-cross-") + renderer + "-released.svg"));
  }
}

TEST_F(Stability, TheAdmittanceDeviceTakesAStiffWallFromASpring) {
  EXPECT_GT(
      largest(printed(stability("out", "--device admittance --rates 1000 --delays 0 --dampings 0 --json")),
              "truth", "hand", "rate", "rate_hz", 1000.0),
      20.0);
}

TEST_F(Stability, RefusesWhatIsNotRight) {
  for (const auto& [arguments, named] :
       std::vector<std::pair<const char*, const char*>>{{"--device omnni", "did you mean 'omni'?"},
                                                        {"--grip foot", "choose from"},
                                                        {"--rates 1000,500", "--rates"},
                                                        {"--rates 0", "--rates"},
                                                        {"--delays 0,x", "--delays"},
                                                        {"--jitter 1", "--jitter"},
                                                        {"--slew 0", "--slew"}}) {
    refuses(named, stability("bad", arguments));
    EXPECT_FALSE(exists("bad/stability.json"));
  }
  refuses("--dampings", stability("bad", "--dampings", std::string()));
}

}  // namespace
}  // namespace palpate::experiments
