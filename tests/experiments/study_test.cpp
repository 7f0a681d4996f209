// The folder of a study suffices: report and scores come from its files alone.

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "experiments/session/session.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

class StudyFolder : public OnCommandLine {
 protected:
  void compare(const std::string& renderers, const std::vector<std::string>& more = {},
               const std::string& scene = kTinyWaves, const std::string& path = kTinyWeave) const {
    succeeds("compare", scene, "--renderers", renderers, "--path", path, "--out @/out", more);
  }
  [[nodiscard]] json result(const std::string& folder = "out") const {
    return json_in(folder + "/result.json");
  }
  /// With one thing changed in result.json.
  void change(const std::function<void(json&)>& how) const {
    json document = result();
    how(document);
    write_text(in("out/result.json"), document.dump(2) + "\n");
  }
  /// Both commands refuse the folder with these words, and change nothing.
  void expect_refused(const std::string& folder, const std::vector<std::string>& words) const {
    for (const char* command : {"report", "score"}) {
      const ProcessOutcome run = palpate(command, in(folder));
      EXPECT_EQ(run.exit_code, 2) << command << " " << folder << run.out;
      for (const std::string& word : words)
        EXPECT_THAT(run.err, HasSubstr(word)) << command << ": "
                                              << "lacks " << word;
    }
  }
};

TEST_F(StudyFolder, TheReportIsDrawnAgainFromItByteByByte) {
  compare("cloud,cloud-literal,analytic,brute-force");
  const std::string first = file_text(in("out/report.html")), second = file_text(in("out/study.html"));
  ASSERT_GT(first.size(), 10000u);
  ASSERT_GT(second.size(), 10000u);
  fs::remove(in("out/report.html"));
  fs::remove(in("out/study.html"));
  fs::remove_all(in("out/figures"));
  const ProcessOutcome run = palpate_command({"report", in("out")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.out.find("report.html"), std::string::npos) << run.out;
  EXPECT_TRUE(file_text(in("out/report.html")) == first) << "another page";
  EXPECT_TRUE(file_text(in("out/study.html")) == second) << "another page";
  // The folder alone: moved away, hidden files too, it is the same study.
  fs::copy(in("out"), in("elsewhere"), fs::copy_options::recursive);
  fs::remove(in("elsewhere/report.html"));
  succeeds("report @/elsewhere");
  EXPECT_TRUE(text_in("elsewhere/report.html") == first) << "another page elsewhere";
  EXPECT_EQ(text_in("elsewhere/result.json"), text_in("out/result.json"));
}

TEST_F(StudyFolder, ScoringAgainGivesTheSameNumbers) {
  compare("cloud,cloud-literal,analytic");
  const std::string first = text_in("out/result.json");
  std::map<std::string, std::string> scores;
  for (const char* label : {"cloud", "cloud-literal", "analytic"})
    scores[label] = text_in(std::string("out/scores-") + label + ".csv");
  // What was measured stays; what is scored comes again, whatever stood there.
  change([](json& document) {
    for (json& r : document["renderers"]) {
      ASSERT_FALSE(r["accuracy"]["pop_throughs"].is_null());
      ASSERT_FALSE(r["accuracy"]["god_object_surface_rms_mm"].is_null());
      r["accuracy"] = nullptr;
      r["energy"] = nullptr;
    }
  });
  const ProcessOutcome run = succeeds("report score @/out --json");
  EXPECT_EQ(text_in("out/result.json"), first);
  EXPECT_EQ(json::parse(run.out), json::parse(first));
  for (const auto& [label, text] : scores)
    EXPECT_TRUE(text_in("out/scores-" + label + ".csv") == text) << label;
  // Another stiffness of the truth's basis gives other scores: they do come from there.
  change([](json& document) { document["scoring"]["device_resolution_mm"] = 0.2; });
  succeeds("report score @/out");
  EXPECT_NE(result()["renderers"][1]["accuracy"]["floor_n"],
            json::parse(first)["renderers"][1]["accuracy"]["floor_n"]);
}

TEST_F(StudyFolder, AReplayIsAStudyToo) {
  succeeds("compare", kTinyWaves, "--renderers cloud --path", kTinyWeave, "--reference none --out @/out");
  expect_valid("result", text_in("out/result.json"));
  EXPECT_TRUE(result()["truth"].is_null());
  ASSERT_EQ(palpate_command({"report", in("out")}).exit_code, 0);
  EXPECT_NE(file_text(in("out/study.html")).find("there is no ground truth here"), std::string::npos);
  ASSERT_EQ(palpate_command({"report", "score", in("out")}).exit_code, 0);
  EXPECT_TRUE(result()["renderers"][0]["accuracy"].is_null());
}

TEST_F(StudyFolder, ATableOfTheThesisIsAStudy) {
  succeeds("reproduce --tables 8 --quick --out @/out");
  const std::string page = text_in("out/report.html"), text = text_in("out/table8/result.json");
  expect_valid("result", text);
  succeeds("report @/out/table8");
  EXPECT_GT(text_in("out/table8/report.html").size(), 10000u);
  succeeds("report score @/out/table8");
  EXPECT_EQ(text_in("out/table8/result.json"), text);
  EXPECT_TRUE(text_in("out/report.html") == page) << "the whole report stays";
  refuses("is no study", "report score @/out");
}

TEST_F(StudyFolder, TheWholeReportIsDrawnAgainFromItsFolderByteByByte) {
  const ProcessOutcome run = palpate("reproduce --tables 6,8,growth --quick --out @/out");
  ASSERT_EQ(run.exit_code, all_renderers().find("mesh-godobject") != nullptr ? 0 : 1) << run.err;
  EXPECT_LE(std::count(run.out.begin(), run.out.end(), '\n'), 15) << run.out;
  EXPECT_THAT(run.out, HasAll("The thesis: ", "report: ", "out/report.html"));
  EXPECT_THAT(run.out, Not(HasSubstr("Table 8"))) << "tables are for --verbose";
  const std::string first = file_text(in("out/report.html"));
  EXPECT_LT(first.size(), 1'000'000u) << "the first page";
  const std::string second = file_text(in("out/table8.html"));
  ASSERT_GT(second.size(), 50000u);
  expect_valid("reproduction", text_in("out/reproduction.json"));
  // The folder alone: elsewhere, without the page and without any picture.
  fs::copy(in("out"), in("elsewhere"), fs::copy_options::recursive);
  fs::remove(in("elsewhere/report.html"));
  fs::remove(in("elsewhere/table8.html"));
  for (const auto& entry : fs::directory_iterator(in("elsewhere/figures")))
    if (entry.path().extension() == ".svg") fs::remove(entry.path());
  const ProcessOutcome again = palpate_command({"report", in("elsewhere")});
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_TRUE(file_text(in("elsewhere/report.html")) == first) << "another page";
  EXPECT_TRUE(file_text(in("elsewhere/table8.html")) == second) << "another page";
  // The tables are drawn from their studies: what stands there is what is shown.
  std::string table = text_in("elsewhere/table8/result.json");
  const std::string title = "Table 8: test 2, friction and deformation";
  for (std::size_t at = table.find(title); at != std::string::npos; at = table.find(title))
    table.replace(at, title.size(), "Table 8: another title");
  write_text(in("elsewhere/table8/result.json"), table);
  succeeds("report @/elsewhere");
  EXPECT_THAT(text_in("elsewhere/report.html"), HasSubstr("Table 8: another title"));
  // What is missing or spoiled is named.
  fs::remove(in("elsewhere/table8/result.json"));
  refuses("table8", "report @/elsewhere");
  write_text(in("elsewhere/reproduction.json"), "{}");
  refuses("reproduction.json", "report @/elsewhere");
}

TEST_F(StudyFolder, WhatIsNoStudyIsRefused) {
  expect_refused("nothing", {in("nothing"), "there is no such folder", "--out"});
  write_text(folder_ / "file", "text");
  expect_refused("file", {in("file"), "is a file", "--out"});
  fs::create_directories(folder_ / "empty");
  expect_refused("empty", {in("empty"), "no result.json", "--out"});
  compare("cloud,analytic");
  const std::string good = text_in("out/result.json");
  const auto refused = [&](const std::function<void(json&)>& how, const std::vector<std::string>& words) {
    write_text(in("out/result.json"), good);
    change(how);
    expect_refused("out", words);
  };
  refused([](json& j) { j["complete"] = false; },
          {"result.json", "half written", "the same command go on", "palpate compare"});
  refused([](json& j) { j["schema"] = "palpate-result/99"; }, {"result.json", "palpate-result/99"});
  refused([](json& j) { j["renderers"][0]["files"]["trace"] = "../trace.csv"; },
          {"result.json", "outside of the study"});
  refused([](json& j) { j["renderers"][0]["role"] = "friend"; }, {"result.json", "role", "ours"});
  refused([](json& j) { j["scoring"] = nullptr; }, {"result.json", "no study"});
  refused([](json& j) { j["renderers"][0]["trace_hash"] = "0000000000000000"; },
          {"trace-cloud.csv", "is not the trace of cloud", "run it again"});
  write_text(in("out/result.json"), "{ \"schema\": ");
  expect_refused("out", {"result.json", "not a JSON"});
  write_text(in("out/result.json"), good);
  for (const char* file : {"trace-cloud.csv", "scores-cloud.csv", "reference.csv", "model-1.csv"}) {
    const std::string whole = text_in(std::string("out/") + file);
    fs::remove(in(std::string("out/") + file));
    expect_refused("out",
                   {in(std::string("out/") + file), "is missing", "copy the whole folder", "run it again"});
    // Half of it: the last line is no row.
    write_text(in(std::string("out/") + file), whole.substr(0, whole.size() / 2));
    if (std::string(file) != "model-1.csv") expect_refused("out", {file});
    write_text(in(std::string("out/") + file), whole);
  }
  succeeds("report @/out");
  fs::remove(in("out/.palpate-output"));
  expect_refused("out", {in("out"), ".palpate-output", "hidden files too"});
}

TEST_F(StudyFolder, ForcesThatCannotBeComparedAreNotScored) {
  write_text(folder_ / "rough.toml",
             "[[model]]\ngenerate = \"plane\"\npoints = 2601\nextent_mm = 20\n[model.surface]\nfriction = "
             "0.5\n");
  compare("cloud,cloud-literal", {}, in("rough.toml"), kTinyWeave);
  expect_valid("result", text_in("out/result.json"));
  const json document = result();
  EXPECT_FALSE(document["scoring"]["forces_comparable"]);
  for (const json& r : document["renderers"]) {
    for (const char* key : {"force_rms_n", "force_max_n", "within_7_percent", "direction_p99_deg",
                            "excess_jump_max_n", "excess_jumps", "excess_jumps_per_m", "god_object_rms_mm",
                            "god_object_surface_rms_mm", "god_object_surface_max_mm", "path_dependence_n"})
      EXPECT_TRUE(r["accuracy"][key].is_null()) << r["label"] << " " << key << " " << r["accuracy"][key];
    EXPECT_FALSE(r["accuracy"]["missed_contact_frames"].is_null());
    EXPECT_FALSE(r["accuracy"]["pop_throughs"].is_null());
    EXPECT_THAT(text_in("out/" + r["files"]["scores"].get<std::string>()), Not(HasSubstr("force_error")));
  }
  const std::string page = file_text(in("out/study.html"));
  EXPECT_EQ(file_text(in("out/report.html")).find("Time against error"), std::string::npos);
  EXPECT_EQ(page.find("Force error"), std::string::npos);
  EXPECT_EQ(page.find("is the ground truth"), std::string::npos);
  EXPECT_NE(page.find("is no truth of the force"), std::string::npos);
  EXPECT_FALSE(fs::exists(in("out/figures/study-error.svg")));
  // Scored again it stays so.
  const std::string first = text_in("out/result.json");
  succeeds("report score @/out");
  EXPECT_EQ(text_in("out/result.json"), first);
}

TEST_F(StudyFolder, SaysWhatEachRendererIsAndLeavesOut) {
  write_text(folder_ / "rough.toml",
             "[[model]]\ngenerate = \"plane\"\npoints = 2601\nextent_mm = "
             "20\n[model.surface.dent]\nradius_mm = 2\nrate_mm_s = 10\nyield_mm "
             "= 0.2\n");
  compare("cloud,cloud-literal", {"--allow-missing"}, in("rough.toml"));
  const json document = result();
  EXPECT_EQ(document["renderers"][0]["role"], "ours");
  EXPECT_EQ(document["renderers"][0]["works_on"], "points");
  EXPECT_EQ(document["renderers"][0]["missing"], json::array());
  EXPECT_EQ(document["renderers"][1]["role"], "literal");
  EXPECT_EQ(document["renderers"][1]["missing"], json::array({"dents"}));
  ASSERT_EQ(document["models"].size(), 1u);
  EXPECT_EQ(document["models"][0]["points"], 2601);
  EXPECT_EQ(document["models"][0]["hash"].get<std::string>().size(), 16u);
}

TEST_F(StudyFolder, WhatThePageWarnsOfStandsInTheDocument) {
  // Far above the model: nobody ever touches.
  write_text(folder_ / "far.csv", "t_s,x_mm,y_mm,z_mm\n0,0,0,50\n0.001,0,0,51\n0.002,0,0,52\n");
  compare("cloud,analytic", {}, kTinyWaves, in("far.csv"));
  const std::string page = text_in("out/report.html");
  const json document = result();
  ASSERT_FALSE(document["warnings"].empty());
  EXPECT_THAT(page, HasSubstr("<strong>Warning:</strong>"));
  const auto& warnings = document["warnings"];
  EXPECT_TRUE(std::any_of(warnings.begin(), warnings.end(), [](const json& text) {
    return text.get<std::string>().find("never touch") != std::string::npos;
  })) << warnings.dump(1);
}

}  // namespace
}  // namespace palpate::experiments
