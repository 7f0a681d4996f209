// The verdict follows from the numbers, and the command writes a page for each goal.
#include "experiments/goals/goal.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "experiments/goals/point_image.h"
#include "tests/experiments/program.h"
#include "tests/in_folder.h"

namespace palpate::experiments {
namespace {

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
  const auto json = nlohmann::json::parse(to_json(document));
  EXPECT_EQ(json["goals"][0]["verdict"], "reached");
  EXPECT_EQ(json["goals"][0]["falls_short"], nlohmann::json({"Nothing that was measured here."}));
  EXPECT_EQ(json["goals"][1]["verdict"], "reached in part");
  ASSERT_EQ(json["goals"][1]["falls_short"].size(), 1u);
  EXPECT_THAT(json["goals"][1]["falls_short"][0].get<std::string>(), HasSubstr("the other: 3"));
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
