// palpate test stability as a user runs it, on a tiny scene.
#include <nlohmann/json.hpp>

#include <limits>
#include <map>

#include "experiments/goals/goals.h"
#include "experiments/goals/pinned_loop.h"
#include "tests/experiments/program.h"
#include "tests/files.h"
#include "toolkit/metrics/force_steps.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

class Stability : public OnCommandLine {
 protected:
  template <class... More>
  Words stability(const std::string& out, const More&... more) const {
    return words("test stability", kSmallWaves,
                 "--renderers cloud --path weave:frames=1500:depth_mm=0.5 --out", in(out), more...);
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
  const Words small = words("--rates 1000 --delays 0,2 --dampings 0");
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

// ---- The verdict follows from the numbers, and the command writes a page for each goal.

Goal with(const std::vector<Finding>& findings) {
  Goal goal{"fidelity", "title", "words"};
  goal.findings = findings;
  return goal;
}

TEST(Goals, TheNumbersDecide) {
  const Finding good{"a", 1.0, "", 1.0, true, "limit"}, bad{"b", 1.1, "", 1.0, true, "limit"};
  const Finding least{"c", 1.1, "", 1.0, false, "limit"}, unknown{"d", std::nullopt, "", 1.0, true, "limit"};
  EXPECT_EQ(verdict_of(with({good, least})), Verdict::kReached);
  EXPECT_EQ(verdict_of(with({good, bad})), Verdict::kInPart);
  EXPECT_EQ(verdict_of(with({bad})), Verdict::kMissed);
  EXPECT_EQ(verdict_of(with({good, unknown})), Verdict::kNotMeasured);
  EXPECT_EQ(verdict_of(with({})), Verdict::kNotMeasured);
}

TEST(Goals, AFindingIsKeptUpToItsLimit) {
  EXPECT_TRUE(kept({"a", 1.0, "", 1.0, true, "limit"}));
  EXPECT_FALSE(kept({"a", 1.0001, "", 1.0, true, "limit"}));
  EXPECT_TRUE(kept({"a", 1.0, "", 1.0, false, "limit"}));
  EXPECT_FALSE(kept({"a", 0.9999, "", 1.0, false, "limit"}));
  EXPECT_FALSE(kept({"a", std::nullopt, "", 1.0, true, "limit"}));
  EXPECT_FALSE(kept({"a", std::numeric_limits<double>::quiet_NaN(), "", 1.0, true, "limit"}));
}

TEST(Goals, WhatIsNotKeptFallsShort) {
  GoalsDocument document;
  document.goals = {
      with({{"the one", 1.0, "", 2.0, true, "limit"}}),
      with({{"the one", 1.0, "", 2.0, true, "limit"}, {"the other", 3.0, "", 2.0, true, "limit"}})};
  const auto written = nlohmann::json::parse(to_json(document));
  EXPECT_EQ(written["goals"][0]["verdict"], "reached");
  EXPECT_EQ(written["goals"][0]["falls_short"], nlohmann::json({"Nothing that was measured here."}));
  EXPECT_EQ(written["goals"][1]["verdict"], "reached in part");
  ASSERT_EQ(written["goals"][1]["falls_short"].size(), 1u);
  EXPECT_THAT(written["goals"][1]["falls_short"][0].get<std::string>(), HasSubstr("the other: 3"));
  const Table table = goals_table(document);
  ASSERT_EQ(table.rows.size(), 2u);
  EXPECT_EQ(table.rows[1].back().text.find("the other"), 0u);
}

TEST(Goals, NearerPointsHideFartherOnes) {
  cloud::Cloud cloud = cloud::build_cloud(std::vector<Vec3>{Vec3{0.0, -10.0, 0.0}, Vec3{0.0, 10.0, 0.0},
                                                            Vec3{10.0, 0.0, 0.0}, Vec3{-10.0, 0.0, 0.0}},
                                          cloud::NonFinite::kRefuse)
                           .value();
  PointDrawer drawer(cloud);
  drawer.begin(0.0);
  EXPECT_EQ(drawer.draw(3), 1u) << "a beginning of the points";
  EXPECT_EQ(drawer.draw(3), 0u);
  std::size_t drawn = 0;
  for (const std::uint8_t grey : drawer.image().grey) drawn += grey != 255;
  EXPECT_EQ(drawn, 4u) << "four places, four pixels";
}

class GoalsCommand : public OnCommandLine {};

TEST_F(GoalsCommand, WritesAPageForEachGoal) {
  succeeds("test goals --quick --out @/out/goals");
  const std::string text = text_in("out/goals/goals.json");
  expect_valid("goals", text);
  const auto document = nlohmann::json::parse(text);
  for (const auto& goal : document["goals"]) {
    EXPECT_NE(goal["verdict"], "not measured") << goal["id"];
    const std::string page = text_in("out/goals/" + goal["page"].get<std::string>());
    EXPECT_THAT(page, HasSubstr(goal["title"].get<std::string>()));
    EXPECT_THAT(page, HasSubstr("<svg")) << goal["id"] << " has no plot";
  }
  EXPECT_EQ(document["goals"].size(), 7u);
  // Every page is drawn again from the folder, its pictures by their scripts.
  expect_valid("page", text_in("out/goals/page.json"));
  std::map<std::string, std::string> pages;
  for (const auto& entry : std::filesystem::directory_iterator(in("out/goals")))
    if (entry.path().extension() == ".html") pages[entry.path().filename()] = file_text(entry.path());
  EXPECT_EQ(pages.size(), 8u);
  for (const auto& [name, page] : pages) std::filesystem::remove(in("out/goals/" + name));
  std::filesystem::remove(in("out/goals/figures/goal-fidelity.svg"));
  succeeds("report @/out/goals");
  for (const auto& [name, page] : pages) EXPECT_TRUE(text_in("out/goals/" + name) == page) << name;
  std::ofstream(in("out/goals/page.json")) << "{\"schema\": \"palpate-page/1\"}";
  refuses("page.json", "report @/out/goals");
  // On points of even quality what is ours is no mesh, and the mesh is one.
  for (const auto& finding : document["goals"][1]["findings"])
    if (finding["about"] == "cloud, models that it does not feel as points") {
      EXPECT_EQ(finding["value"], 0.0);
      EXPECT_GT(finding["baseline"].get<double>(), 0.0);
    }
}

TEST_F(GoalsCommand, RefusesWhatItCannotUse) {
  std::ofstream(in("file")) << "in the way";
  refuses(in("file"), "test goals --quick --out @/file");
  refuses("--quik", "test goals --quik --out @/out/none");
  EXPECT_FALSE(exists("out/none")) << "nothing is left";
}

}  // namespace
}  // namespace palpate::experiments
