// palpate study, as a user runs it.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/experiments/study_folder.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

class Blinded : public StudyFolder {
 protected:
  json document(const std::string& out) const { return json_in(out + "/study.json"); }
  std::vector<std::map<std::string, std::string>> trials(const std::string& out) const {
    std::istringstream lines(text_in(out + "/trials.csv"));
    std::vector<std::string> names;
    std::vector<std::map<std::string, std::string>> rows;
    for (std::string line; std::getline(lines, line);) {
      std::istringstream cells(line + ",");
      std::vector<std::string> values;
      for (std::string cell; std::getline(cells, cell, ',');) values.push_back(cell);
      if (names.empty()) {
        names = values;
        continue;
      }
      EXPECT_EQ(values.size(), names.size()) << line;
      auto& row = rows.emplace_back();
      for (std::size_t i = 0; i < names.size() && i < values.size(); ++i) row[names[i]] = values[i];
    }
    return rows;
  }
  /// The example, with one text put in the place of another.
  std::string changed(const std::string& example, const std::string& from, const std::string& to) const {
    const std::string file = in(example + "-changed.toml");
    std::filesystem::remove(file);
    succeeds("study", example, "--save-plan", file);
    std::string text = file_text(file);
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    if (at != std::string::npos) text.replace(at, from.size(), to);
    write_text(file, text);
    return file;
  }
};

TEST_F(Blinded, AbxFindsItsObserver) {
  EXPECT_THAT(succeeds("study abx --power").out, HasSubstr("69"))
      << "trials to find 65 % are said beforehand: ";
  EXPECT_THAT(succeeds(study("abx", "simulated:dprime=2.5", "out", "--verbose")).out, HasSubstr("69"));
  expect_valid("observed", text_in("out/study.json"));
  const json found = document("out");
  EXPECT_EQ(found["trials"]["main"], 80);
  EXPECT_EQ(found["design"]["power"]["trials_to_detect"]["first"], 69);
  EXPECT_LE(found["interval"][0].get<double>(), 2.5);
  EXPECT_GE(found["interval"][1].get<double>(), 2.5);
  EXPECT_LT(found["difference"]["p_by_chance"].get<double>(), 0.001);
  // What is in the rows is what is counted; every order equally often, and shams among the switches.
  std::map<std::string, int> shown;
  int right = 0, shams = 0, catches = 0;
  for (const auto& row : trials("out")) {
    catches += row.at("kind") == "catch" ? 1 : 0;
    if (row.at("kind") != "main") continue;
    ++shown[row.at("shown")];
    right += row.at("correct") == "1" ? 1 : 0;
    shams += row.at("sham_switches") == "1" ? 1 : 0;
    EXPECT_EQ(row.at("switch_delay_s"), "0.500") << "of sham and real switches";
    for (const auto& [name, cell] : row) EXPECT_THAT(cell, Not(HasSubstr("cloud"))) << name;
  }
  EXPECT_EQ(shown, (std::map<std::string, int>{{"ABA", 20}, {"ABB", 20}, {"BAA", 20}, {"BAB", 20}}));
  EXPECT_EQ(shams, 40);
  EXPECT_GT(catches, 6);
  EXPECT_EQ(found["difference"]["correct"], right);
  for (const char* file : {"report.html", "plan.toml", "read.R", "read.py", "figures/share.svg"})
    EXPECT_TRUE(exists(std::string("out/") + file)) << file;
}

TEST_F(Blinded, NothingFeltIsShownToBeNothing) {
  const std::string plan = changed("abx", "count = 80", "count = 160");
  const std::string printed = succeeds(study(plan, "simulated:dprime=0", "out")).out;
  EXPECT_LE(std::count(printed.begin(), printed.end(), '\n'), 15) << printed;
  EXPECT_THAT(printed, HasAll("report: ", "trials: "));
  const json found = document("out");
  EXPECT_LT(found["difference"]["equivalence"]["p"].get<double>(), 0.05);
  EXPECT_GT(found["difference"]["p_by_chance"].get<double>(), 0.05);
  EXPECT_DOUBLE_EQ(found["interval"][0].get<double>(), 0.0);
}

TEST_F(Blinded, EveryProcedureFindsTheJnd) {
  for (const char* example : {"constant", "staircase", "psi"}) {
    succeeds(study(example, "simulated:jnd=0.05", example));
    expect_valid("observed", text_in(std::string(example) + "/study.json"));
    const json found = document(example);
    EXPECT_EQ(found["estimate"]["name"], "jnd");
    EXPECT_EQ(found["estimate"]["unit"], "N/mm");
    // One study each: within a factor of two of the truth, and the interval holds its own value.
    EXPECT_GT(found["estimate"]["value"].get<double>(), 0.025) << example;
    EXPECT_LT(found["estimate"]["value"].get<double>(), 0.1) << example;
    EXPECT_LE(found["interval"][0], found["estimate"]["value"]);
    EXPECT_GE(found["interval"][1], found["estimate"]["value"]);
    EXPECT_TRUE(exists(std::string(example) + "/figures/function.svg"));
  }
}

TEST_F(Blinded, GoesOnWhereItStopped) {
  for (const char* example : {"abx", "staircase"}) {
    const std::string observer = std::string(example) == "abx" ? "simulated:dprime=1" : "simulated:jnd=0.05";
    const std::string whole = std::string(example) + "-whole", parts = std::string(example) + "-parts";
    succeeds(study(example, observer, whole));
    succeeds(study(example, observer, parts, "--stop-after 7"));
    EXPECT_EQ(trials(parts).size(), 7u);
    EXPECT_FALSE(exists(parts + "/study.json")) << "nothing half done looks whole";
    succeeds(study(example, observer, parts, "--stop-after 13"));
    // As if the machine had lost its power in the middle of a row.
    write_text(in(parts + "/trials.csv"), text_in(parts + "/trials.csv") + "P01,simul");
    succeeds(study(example, observer, parts));
    EXPECT_EQ(text_in(parts + "/trials.csv"), text_in(whole + "/trials.csv")) << example;
    EXPECT_EQ(document(parts)["estimate"], document(whole)["estimate"]);
    // Once more: nothing is left to ask.
    succeeds(study(example, observer, parts));
    EXPECT_EQ(text_in(parts + "/trials.csv"), text_in(whole + "/trials.csv")) << example;
  }
}

TEST_F(Blinded, OtherPlansPeopleAndChangedRowsAreRefused) {
  succeeds(study("abx", "simulated:dprime=1", "out", "--stop-after 9"));
  const std::string before = text_in("out/trials.csv");
  refuses({}, study("same-different", "simulated:dprime=1", "out"));
  refuses({}, study("abx", "simulated:dprime=2", "out"));
  refuses("trials.csv:2", study("abx", "simulated:dprime=1", "out", "--participant P02"));
  EXPECT_EQ(text_in("out/trials.csv"), before);
  std::string forged = before;
  const std::size_t at = forged.find(",practice,");
  ASSERT_NE(at, std::string::npos);
  forged.replace(at, std::string(",practice,").size(), ",main,");
  write_text(in("out/trials.csv"), forged);
  refuses({}, study("abx", "simulated:dprime=1", "out"));
  succeeds(study("abx", "simulated:dprime=1", "second", "--participant P02"));
  succeeds(study("abx", "simulated:dprime=1", "first"));
  int same = 0, all = 0;
  const auto first = trials("first"), second = trials("second");
  for (std::size_t i = 0; i < std::min(first.size(), second.size()); ++i, ++all)
    same += first[i].at("shown") == second[i].at("shown") ? 1 : 0;
  EXPECT_LT(same, all) << "participants have orders of their own";
}

TEST_F(Blinded, ExclusionsAreThoseRegistered) {
  succeeds(study("abx", "simulated:dprime=2:missed=0.3", "out"));
  const json found = document("out");
  int excluded = 0;
  for (const auto& row : trials("out")) {
    if (row.at("kind") == "practice") continue;
    EXPECT_EQ(row.at("excluded"), row.at("missed_deadlines") != "0"     ? "missed deadline"
                                  : std::stod(row.at("answer_s")) < 0.2 ? "too fast"
                                                                        : "");
    excluded += row.at("excluded").empty() ? 0 : 1;
  }
  EXPECT_GT(excluded, 5);
  EXPECT_EQ(found["trials"]["excluded"], excluded);
  EXPECT_EQ(found["difference"]["trials"], found["trials"]["main"]);
  // Who misses the catch trials counts for nothing, and the report says so.
  succeeds(study("abx", "simulated:dprime=0:catch_dprime=0", "asleep"));
  const json asleep = document("asleep");
  EXPECT_FALSE(asleep["participant_excluded"].get<std::string>().empty());
  EXPECT_EQ(asleep["warnings"].size(), 1u);
}

TEST_F(Blinded, WrongPlansNameLineAndRemedy) {
  const struct {
    const char *example, *from, *to, *line, *says;
  } kWrong[] = {
      {"abx", "task = \"abx\"", "task = \"abc\"", ":3", "abx"},
      {"abx", "count = 80", "count = 81", ":12", "multiple of 4"},
      {"abx", "a = \"cloud\"", "a = \"clud\"", ":8", "cloud"},
      {"abx", "b = \"cloud-smooth\"", "b = \"cloud\"", ":9", "same"},
      {"abx", "practice = 4", "practise = 4", ":13", "practice"},
      {"abx", "[compare]", "[compares]", "", "[compare]"},
      {"constant", "task = \"2ifc\"", "task = \"yes-no\"", ":3", "2ifc"},
      {"constant", "key = \"stiffness\"", "key = \"stifness\"", ":9", "stiffness"},
      {"constant", "levels = [0.02, 0.035", "levels = [0.2, 0.035", ":17", "rise"},
      {"staircase", "reversals = 14", "reversals = 4", ":21", "reversals"},
      {"staircase", "[up_down]", "[updown]", "", "up_down"},
      {"psi", "low = 0.005", "low = 5.0", "", "low"},
      {"psi", "title = ", "title == ", ":2", "TOML"},
  };
  for (const auto& wrong : kWrong) {
    const std::string plan = changed(wrong.example, wrong.from, wrong.to);
    const ProcessOutcome run = refuses({}, study(plan, "simulated:dprime=1", "out"));
    EXPECT_THAT(run.err, HasSubstr(plan + wrong.line)) << wrong.to << ": ";
    EXPECT_THAT(run.err, HasSubstr(wrong.says)) << wrong.to << ": ";
    EXPECT_FALSE(exists("out")) << wrong.to;
  }
  refuses({}, study("abx", "persons", "out"));
  refuses({}, study("abx", "simulated:jnd=0.1", "out"));
  refuses({}, study("psi", "simulated:dprime=1", "out"));
  refuses({}, study("abc", "simulated:dprime=1", "out"));
  refuses({}, study("abx", "simulated:dprime=1", "out", "--participant", std::string("Jane Doe")));
  EXPECT_FALSE(exists("out"));
}

}  // namespace
}  // namespace palpate::experiments
