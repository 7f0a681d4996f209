// Every command on tiny scenes: what it prints, what it leaves behind, how it ends.
#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "experiments/session/session.h"
#include "tests/experiments/program.h"
#include "tests/json_schema.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const char* const kScene = "sinusoid:points=2601:extent_mm=20:wavelength_mm=20:amplitude_mm=1:seed=1";
const char* const kCommandPath = "weave:frames=1500:depth_mm=0.5:clearance_mm=0.3:period_frames=300:seed=1";

class Command : public InFolder {};

/// docs/NAME.schema.json.
std::string schema(const std::string& name) {
  return std::string(PALPATE_DOCS) + "/" + name + ".schema.json";
}

/// The commands that `palpate --help` lists, with what it says of each.
std::vector<std::pair<std::string, std::string>> listed_commands() {
  const ProcessOutcome run = palpate_command({"--help"});
  EXPECT_EQ(run.exit_code, 0);
  std::vector<std::pair<std::string, std::string>> commands;
  std::istringstream lines(run.out.substr(std::min(run.out.find("Subcommands:"), run.out.size())));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line) && line.starts_with("  ")) {
    std::istringstream words(line);
    std::string name, says;
    words >> name >> std::ws;
    std::getline(words, says);
    commands.emplace_back(name, says);
  }
  return commands;
}

// Their options and examples: pages_test.cpp.
TEST_F(Command, HelpOfEveryListedCommandSaysWhatItDoes) {
  const auto commands = listed_commands();
  EXPECT_GE(commands.size(), 12u);
  for (const auto& [name, says] : commands) {
    SCOPED_TRACE(name);
    const ProcessOutcome run = palpate_command({name, "--help"});
    EXPECT_EQ(run.exit_code, 0);
    EXPECT_EQ(run.err, "");
    EXPECT_FALSE(says.empty());
    EXPECT_TRUE(run.out.starts_with(says)) << run.out;
    EXPECT_NE(run.out.find("\nExample"), std::string::npos) << run.out;
  }
}

TEST_F(Command, VersionNamesCommitAndBuild) {
  const ProcessOutcome run = palpate_command({"--version"});
  EXPECT_EQ(run.exit_code, 0);
  // What results carry too, and nothing else.
  const ProcessOutcome replay =
      palpate_command({"replay", "plane:points=121:extent_mm=10", "--renderer", "analytic", "--path",
                       "tap:frames=100", "--out", in("out"), "--json"});
  ASSERT_EQ(replay.exit_code, 0) << replay.err;
  const json result = json::parse(replay.out);
  const std::string commit = result["commit"];
  EXPECT_NE(run.out.find(" (commit " + commit + ", "), std::string::npos) << run.out << commit;
  EXPECT_FALSE(commit.empty());
}

TEST_F(Command, RenderersAreThoseOfTheRegistry) {
  const ProcessOutcome text = palpate_command({"renderers"});
  const ProcessOutcome run = palpate_command({"renderers", "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json list = json::parse(run.out);
  const render::Registry registry = all_renderers();
  ASSERT_EQ(list.size(), registry.all().size());
  for (std::size_t i = 0; i < list.size(); ++i) {
    const render::RendererInfo& info = registry.all()[i];
    EXPECT_EQ(list[i]["name"], info.name);
    ASSERT_EQ(list[i]["options"].size(), info.options.size());
    EXPECT_NE(text.out.find(info.source), std::string::npos) << info.name;
    for (const OptionSpec& option : info.options)
      EXPECT_NE(text.out.find(option.key + "=" + option.default_value), std::string::npos) << option.key;
  }
}

TEST_F(Command, WhatIsPrintedAsJsonFollowsItsSchema) {
  write_text(folder_ / "two.toml",
             "[[model]]\ngenerate = \"plane\"\npoints = 121\nextent_mm = 10\n[[model]]\ngenerate = "
             "\"sphere\"\npoints = 500\nposition_mm = [0, 0, 90]\n");
  const ProcessOutcome recorded =
      palpate_command({"record", "plane:points=441:extent_mm=20", "--renderer", "cloud", "--seconds", "0.5",
                       "--accelerated", "--out", in("session.palrec")});
  ASSERT_EQ(recorded.exit_code, 0) << recorded.err;
  const std::pair<const char*, std::vector<std::string>> printed[] = {
      {"info", {"info", in("session.palrec")}},
      {"info", {"info", "plane:points=441:extent_mm=20"}},
      {"info", {"info", "sphere:points=500"}},
      {"info", {"info", in("two.toml")}},
      {"plan", {"plan", "plane:points=441:extent_mm=20"}},
      {"plan", {"plan", in("two.toml"), "--renderer", "cloud-literal:shading=none"}},
      {"plan", {"plan", "sphere:points=500", "--renderer", "brute-force"}},
      {"catalogue", {"renderers"}},
      {"catalogue", {"paths"}},
      {"catalogue", {"clean"}},
      {"scans", {"fetch"}},
      {"cleaned", {"clean", "sphere:points=500", "--steps", "thin", "--out", in("c.ply")}},
      {"result",
       {"replay", "plane:points=121:extent_mm=10", "--renderer", "cloud", "--path", "tap:frames=100", "--out",
        in("out")}},
  };
  for (auto [name, arguments] : printed) {
    arguments.push_back("--json");
    const ProcessOutcome run = palpate_command(arguments);
    ASSERT_EQ(run.exit_code, 0) << run.err;
    EXPECT_EQ(schema_violations(schema(name), run.out), "") << arguments.front() << " " << arguments[1];
  }
}

TEST_F(Command, InfoKnowsAPlane) {
  const ProcessOutcome run = palpate_command({"info", "plane:points=441:extent_mm=20", "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json info = json::parse(run.out);
  EXPECT_EQ(info["points"], 441);
  EXPECT_NEAR(info["resolution_mm"].get<double>(), std::sqrt(2.0), 1e-5);  // the diagonal of 1 mm cells
  EXPECT_NEAR(info["nearest_mm"]["p50"].get<double>(), 1.0, 1e-5);
  EXPECT_EQ(info["duplicates"], 0);
  EXPECT_TRUE(info["height_field"].get<bool>());
  EXPECT_EQ(info["raster"]["columns"], 21);
  EXPECT_TRUE(info["density_per_mm3"].is_null());
  EXPECT_EQ(info["triangles"], 800);
}

TEST_F(Command, InfoWarnsOfCoarseGuessedDuplicatedAndBroken) {
  std::string points = "0 0 0\n0 0 0\nnan 0 0\n";
  for (int i = 1; i < 60; ++i) points += std::to_string(5 * i) + " " + std::to_string((7 * i) % 50) + " 0\n";
  write_text(folder_ / "coarse.xyz", points);
  const ProcessOutcome run = palpate_command({"info", in("coarse.xyz"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json info = json::parse(run.out);
  EXPECT_EQ(info["duplicates"], 1);
  EXPECT_EQ(info["non_finite"], 1);
  EXPECT_TRUE(info["unit_guessed"].get<bool>());
  EXPECT_GE(info["warnings"].size(), 3u) << info["warnings"].dump(1);
  const ProcessOutcome refused = palpate_command({"info", in("coarse.xyz"), "--non-finite", "refuse"});
  EXPECT_EQ(refused.exit_code, 2);
}

TEST_F(Command, ReplayLeavesTraceAndResult) {
  const ProcessOutcome run = palpate_command(
      {"replay", kScene, "--renderer", "cloud", "--path", kCommandPath, "--out", in("out"), "--paced", "20"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const std::string trace = file_text(in("out/trace.csv"));
  EXPECT_EQ(trace.substr(0, trace.find('\n')),
            "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,gx_mm,gy_mm,gz_mm,frame_ns");
  EXPECT_EQ(std::count(trace.begin(), trace.end(), '\n'), 1501);
  const json result = json::parse(file_text(in("out/result.json")));
  EXPECT_EQ(result["renderers"].size(), 1u);
  const json& r = result["renderers"][0];
  EXPECT_EQ(r["status"], "ok");
  EXPECT_EQ(r["frame"]["frames"], 1500);
  EXPECT_GT(r["frame"]["contact_frames"].get<int>(), 0);
  EXPECT_FALSE(r["frame_paced"].is_null());
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_))
    EXPECT_NE(entry.path().extension(), ".part") << entry.path();
}

TEST_F(Command, CompareRunsEveryRendererThereIs) {
  std::string names;
  std::set<std::string> labels;
  const render::Registry registry = all_renderers();
  for (const render::RendererInfo& info : registry.all()) {
    names += (names.empty() ? "" : ",") + info.name;
    labels.insert(info.name);
  }
  const ProcessOutcome run = palpate_command(
      {"compare", kScene, "--renderers", names, "--path", kCommandPath, "--passes", "2", "--out", in("out")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json result = json::parse(file_text(in("out/result.json")));
  EXPECT_EQ(schema_violations(schema("result"), file_text(in("out/result.json"))), "");
  ASSERT_EQ(result["renderers"].size(), labels.size());
  for (const json& r : result["renderers"]) {
    const std::string label = r["label"];
    EXPECT_EQ(labels.count(label), 1u);
    EXPECT_EQ(r["status"], "ok") << label;
    EXPECT_FALSE(r["accuracy"].is_null()) << label;
    EXPECT_TRUE(std::filesystem::exists(in("out/trace-" + label + ".csv"))) << label;
    if (label == "analytic") {
      EXPECT_EQ(r["accuracy"]["missed_contact_frames"], 0);
      EXPECT_LT(r["accuracy"]["force_rms_n"].get<double>(), 1e-3);
    }
  }
  const std::string report = file_text(in("out/report.html"));
  EXPECT_NE(report.find("<svg"), std::string::npos);
  EXPECT_EQ(report.find("<script"), std::string::npos);
  EXPECT_EQ(report.find("src="), std::string::npos) << "the report must need nothing else";
  EXPECT_EQ(report.find("<link"), std::string::npos);
  EXPECT_TRUE(std::filesystem::exists(in("out/figures/study-force.gp")));
}

TEST_F(Command, TracesAreTheSameForAnyThreadsAndFromRunToRun) {
  std::set<std::string> hashes;
  int run_number = 0;
  for (const char* threads : {"1", "2", "2"}) {
    const std::string out = in("out" + std::to_string(run_number++));
    const ProcessOutcome run = palpate_command({"replay", kScene, "--renderer", "cloud", "--path",
                                                kCommandPath, "--out", out, "--threads", threads});
    ASSERT_EQ(run.exit_code, 0) << run.err;
    hashes.insert(
        json::parse(file_text(out + "/result.json"))["renderers"][0]["trace_hash"].get<std::string>());
  }
  EXPECT_EQ(hashes.size(), 1u);
}

TEST_F(Command, LabelsNameOneRendererTwice) {
  const ProcessOutcome run =
      palpate_command({"compare", kScene, "--renderers", "cloud,cloud:shading=none:label=bare", "--path",
                       kCommandPath, "--out", in("out"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json result = json::parse(run.out);
  EXPECT_EQ(result["renderers"][1]["label"], "bare");
  EXPECT_TRUE(std::filesystem::exists(in("out/trace-bare.csv")));
}

TEST_F(Command, ASceneFileNamesItsRenderer) {
  write_text(folder_ / "s.toml",
             "[[model]]\ngenerate = \"plane\"\npoints = 961\nextent_mm = 30\n[renderer]\nname = "
             "\"cloud\"\nshading = \"none\"\n");
  const ProcessOutcome run =
      palpate_command({"replay", in("s.toml"), "--path", "tap:frames=800", "--out", in("out"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(json::parse(run.out)["renderers"][0]["options"]["shading"], "none");
}

TEST_F(Command, AScenesControlActsAndSaysSo) {
  const std::string plane = "[[model]]\ngenerate = \"plane\"\npoints = 961\nextent_mm = 30\n";
  const auto replayed = [&](const std::string& control) {
    write_text(folder_ / "s.toml", plane + "[control]\n" + control);
    const ProcessOutcome run = palpate_command({"replay", in("s.toml"), "--renderer", "analytic", "--path",
                                                "tap:frames=800", "--out", in("out"), "--json"});
    EXPECT_EQ(run.exit_code, 0) << run.err;
    return json::parse(run.out)["renderers"][0];
  };
  const json free = replayed("passivity = false\n");
  // The model's 0.5 N/mm behind as much: half the force, and the error is the other half.
  const json coupled = replayed("coupling = { stiffness_n_per_mm = 0.5 }\n");
  EXPECT_NEAR(free["accuracy"]["force_rms_percent"].get<double>(), 0.0, 1e-9);
  EXPECT_NEAR(coupled["accuracy"]["force_rms_percent"].get<double>(), 50.0, 1e-6);
  EXPECT_NEAR(coupled["energy"]["max_stored_mj"].get<double>(),
              0.5 * free["energy"]["max_stored_mj"].get<double>(), 1e-9);
  EXPECT_NE(coupled["prepare"]["notes"].dump().find("virtual coupling of 0.5 N/mm"), std::string::npos);
  EXPECT_EQ(free["prepare"]["notes"].dump().find("control:"), std::string::npos);
  // A spring is passive: the controller finds nothing to take.
  EXPECT_LT(free["energy"]["generated_percent"].get<double>(), 1e-9);
  EXPECT_EQ(replayed("passivity = true\n")["status"], "ok");
}

TEST_F(Command, ASecondRunReplacesTheFirst) {
  const std::vector<std::string> replay = {"replay", kScene,       "--renderer", "cloud",
                                           "--path", kCommandPath, "--out",      in("out")};
  ASSERT_EQ(palpate_command(replay).exit_code, 0);
  EXPECT_EQ(palpate_command(replay).exit_code, 0);
}

TEST_F(Command, SaveMeshWritesAMeshThatReadsBack) {
  if (all_renderers().find("mesh-godobject") == nullptr) GTEST_SKIP() << "built without mesh-godobject";
  const ProcessOutcome run =
      palpate_command({"replay", kScene, "--renderer", "mesh-godobject:mesh=original", "--path", kCommandPath,
                       "--out", in("out"), "--save-mesh", in("mesh.ply")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const ProcessOutcome info = palpate_command({"info", in("mesh.ply"), "--json"});
  ASSERT_EQ(info.exit_code, 0) << info.err;
  EXPECT_EQ(json::parse(info.out)["triangles"], 5000);
  EXPECT_EQ(palpate_command({"replay", kScene, "--renderer", "cloud", "--path", kCommandPath, "--out",
                             in("out"), "--save-mesh", in("none.ply")})
                .exit_code,
            1);
}

TEST_F(Command, ReproduceQuickPrintsPrintedValuesBesideOurs) {
  const ProcessOutcome run = palpate_command({"reproduce", "--tables", "7", "--quick", "--out", in("out")});
  // Without the baselines a run of the table is missing, which is a shortfall.
  ASSERT_EQ(run.exit_code, all_renderers().find("mesh-godobject") != nullptr ? 0 : 1) << run.err;
  EXPECT_NE(run.out.find("54,717"), std::string::npos) << run.out;
  EXPECT_NE(run.out.find("37.4"), std::string::npos);
  EXPECT_NE(run.out.find("report.html"), std::string::npos);
  EXPECT_TRUE(std::filesystem::exists(in("out/report.html")));
  EXPECT_TRUE(std::filesystem::exists(in("out/table7/result.json")));
}

TEST_F(Command, ReproduceTakesAManifestOfOnesOwn) {
  const std::string text =
      "table = 42\nkind = \"frames\"\ntitle = \"Table 42: mine\"\n[printed]\nhardware = \"none\"\n"
      "[[model]]\nname = \"plane\"\ngenerate = \"plane:points=900\"\n"
      "[path]\nspec = \"tap:frames=500\"\n[[run]]\nrenderer = \"cloud\"\n";
  write_text(folder_ / "mine.toml", text);
  const ProcessOutcome run = palpate_command({"reproduce", "--tables", in("mine.toml"), "--out", in("out")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.out.find("Table 42: mine"), std::string::npos) << run.out;
  EXPECT_TRUE(std::filesystem::exists(in("out/table42/result.json")));
  write_text(folder_ / "mine.toml", text + "quik = \"cloud\"\n");
  const ProcessOutcome wrong =
      palpate_command({"reproduce", "--tables", in("mine.toml"), "--out", in("wrong")});
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_NE(wrong.err.find("mine.toml:13: "), std::string::npos) << wrong.err;
  EXPECT_NE(wrong.err.find("did you mean 'quick'?"), std::string::npos) << wrong.err;
  EXPECT_FALSE(std::filesystem::exists(in("wrong")));
}

TEST_F(Command, GrowthIsATableOfItsOwn) {
  if (all_renderers().find("mesh-godobject") == nullptr) GTEST_SKIP() << "built without the baselines";
  const ProcessOutcome run =
      palpate_command({"reproduce", "--tables", "growth", "--quick", "--out", in("out")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json document = json::parse(file_text(in("out/growth/result.json")));
  ASSERT_EQ(document["renderers"].size(), 8u);
  EXPECT_EQ(document["renderers"][0]["label"], "cloud-900");
  EXPECT_EQ(document["renderers"][7]["label"], "mesh-godobject-22500");
  EXPECT_NE(run.out.find("22,500"), std::string::npos) << run.out;
}

TEST_F(Command, NeighboursOfTable6AreADocumentOfTheirOwn) {
  const ProcessOutcome run = palpate_command({"reproduce", "--tables", "6", "--quick", "--out", in("out")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(file_text(in("out/report.html")).find("for the whole model"), std::string::npos)
      << "a part is not compared with the thesis's whole";
  const std::string text = file_text(in("out/table6/neighbours.json"));
  EXPECT_EQ(schema_violations(schema("neighbours"), text), "");
  const json document = json::parse(text);
  EXPECT_EQ(document["modified_knn"].size(), 2u);
  EXPECT_GT(document["builders"].size(), document["modified_knn"].size());
  EXPECT_FALSE(std::filesystem::exists(in("out/table6/result.json"))) << "no renderer ran";
}

TEST_F(Command, ReproduceMakesEachMeshOnceAndAnewWhereAsked) {
  if (all_renderers().find("mesh-godobject") == nullptr) GTEST_SKIP() << "built without the reconstructions";
  const Environment cache("PALPATE_MESH_CACHE", in("meshes").c_str());
  const auto rows = [&](const char* out, int status, const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"reproduce", "--tables", "3", "--quick", "--out", in(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProcessOutcome run = palpate_command(arguments);
    EXPECT_EQ(run.exit_code, status) << run.err;
    EXPECT_NE(run.out.find("Onyx"), std::string::npos) << run.out;
    const std::string text = file_text(in(std::string(out) + "/table3/meshes.json"));
    EXPECT_EQ(schema_violations(schema("meshes"), text), "");
    EXPECT_FALSE(std::filesystem::exists(in(std::string(out) + "/table3/result.json"))) << "no renderer ran";
    return json::parse(text)["meshes"];
  };
  // The quick stand-ins of bunny and dragon are one torus: what the first had made, the second finds.
  const json first = rows("first", 0, {});
  std::map<std::string, json> made;
  std::size_t found = 0;
  for (const json& row : first) {
    if (row.contains("failure")) continue;  // a method that this build does not have
    EXPECT_GE(row["points_to_mesh_max_mm"], row["points_to_mesh_rms_mm"]);
    EXPECT_EQ(row["recorded"], row["model"] == "dragon") << row;
    const std::string method = row["method"];
    if (row["model"] == "bunny") made[method] = row;
    if (row["model"] != "dragon") continue;
    ++found;
    ASSERT_TRUE(made.contains(method)) << row;
    for (const char* same : {"total_ms", "faces", "points_to_mesh_rms_mm"})
      EXPECT_EQ(row[same], made[method][same]) << row;
  }
  EXPECT_EQ(found, made.size());
  EXPECT_GE(found, 7u);
  // Without the cache none of them is there, and in a microsecond none is made.
  const json anew = rows("second", 1, {"--no-cache", "--mesh-limit", "1e-6"});
  ASSERT_EQ(anew.size(), first.size());
  for (const json& row : anew) EXPECT_TRUE(row.contains("failure")) << row;
}

TEST_F(Command, ARendererThatFeelsFreeSpaceIsWrongAndNotThePath) {
  if (all_renderers().find("penalty-grid") == nullptr) GTEST_SKIP() << "built without the rivals";
  // A scan without faces has no truth; the penalty is felt from the path's start on.
  ASSERT_EQ(
      palpate_command({"clean", "sphere:points=2000", "--steps", "thin/cell=0.1", "--out", in("scan.ply")})
          .exit_code,
      0);
  const ProcessOutcome run =
      palpate_command({"compare", in("scan.ply"), "--renderers", "penalty-grid:threshold=16,cloud", "--path",
                       "exploration:frames=2000:depth_mm=0.5:seed=1", "--out", in("out")});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  std::ifstream file(in("out/result.json"));
  const json result = json::parse(file);
  EXPECT_EQ(result["renderers"][0]["frame"]["contact_frames"], 2000);
  EXPECT_LT(result["renderers"][1]["frame"]["contact_frames"], 2000);
}

TEST_F(Command, APathThatStartsNearASurfaceIsNotInsideIt) {
  if (all_renderers().find("penalty-grid") == nullptr) GTEST_SKIP() << "built without the rivals";
  ASSERT_EQ(
      palpate_command({"clean", "sphere:points=2000", "--steps", "thin/cell=0.1", "--out", in("scan.ply")})
          .exit_code,
      0);
  // 1 mm above the pole of a sphere of 25 mm, where the penalty's band is felt already; beside the point
  // there, on which no direction is away from it. No truth, no generator.
  std::string path = "t_s,x_mm,y_mm,z_mm\n";
  for (int i = 0; i < 200; ++i)
    path += std::to_string(0.001 * i) + ",0.05,0," + std::to_string(26.0 - 0.01 * i) + "\n";
  write_text(folder_ / "near.csv", path);
  const ProcessOutcome run = palpate_command({"compare", in("scan.ply"), "--renderers", "penalty-grid,cloud",
                                              "--path", in("near.csv"), "--out", in("out"), "--unit", "mm"});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const json result = json::parse(file_text(in("out/result.json")));
  EXPECT_EQ(result["renderers"][0]["frame"]["contact_frames"], 200);
  EXPECT_LT(result["renderers"][1]["frame"]["contact_frames"], 200);
  EXPECT_NE(run.err.find("at the path's first position already"), std::string::npos) << run.err;
  // Where the truth is known a path that starts inside is refused, whatever the renderer feels.
  write_text(folder_ / "inside.csv", "t_s,x_mm,y_mm,z_mm\n0,0,0,20\n0.001,0,0,20\n");
  const ProcessOutcome inside =
      palpate_command({"replay", "sphere:points=2000", "--renderer", "cloud", "--reference", "none", "--path",
                       in("inside.csv"), "--out", in("two")});
  EXPECT_EQ(inside.exit_code, 2);
  EXPECT_NE(inside.err.find("inside.csv:2: the path starts inside the model"), std::string::npos)
      << inside.err;
}

TEST_F(Command, FetchListsWithLicenceAndChecksum) {
  const ProcessOutcome run = palpate_command({"fetch", "--json"});
  ASSERT_EQ(run.exit_code, 0);
  const json list = json::parse(run.out);
  ASSERT_GE(list.size(), 1u);
  for (const json& scan : list) {
    EXPECT_FALSE(scan["licence"].get<std::string>().empty());
    for (const json& source : scan["sources"]) {
      // None is known of some: theirs is recorded when they first come.
      const std::size_t size = source["sha256"].get<std::string>().size();
      EXPECT_TRUE(size == 64u || size == 0u) << scan["name"];
      if (scan["name"] == "stanford-dragon") {
        EXPECT_EQ(size, 64u);
      }
    }
  }
}

}  // namespace
}  // namespace palpate::experiments
