// Every command on tiny scenes: what it prints, what it leaves behind, how it ends.

#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "experiments/session/session.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

class Command : public OnCommandLine {};

TEST_F(Command, VersionNamesCommitAndBuild) {
  const ProcessOutcome run = succeeds("--version");
  // What results carry too, and nothing else.
  const json result = printed(
      "compare plane:points=121:extent_mm=10 --renderers analytic --path tap:frames=100 --out @/out --json");
  const std::string commit = result["commit"];
  EXPECT_THAT(run.out, HasSubstr(" (commit " + commit + ", ")) << commit;
  EXPECT_FALSE(commit.empty());
}

TEST_F(Command, WhatIsPrintedAsJsonFollowsItsSchema) {
  write_text(folder_ / "two.toml",
             "[[model]]\ngenerate = \"plane\"\npoints = 121\nextent_mm = 10\n[[model]]\ngenerate = "
             "\"sphere\"\npoints = 500\nposition_mm = [0, 0, 90]\n");
  succeeds(
      "live record plane:points=441:extent_mm=20 --renderer cloud --seconds 0.5 --accelerated --out "
      "@/session.palrec");
  for (const auto& [name, line] :
       {std::pair{"info", "info @/session.palrec"},
        {"info", "info plane:points=441:extent_mm=20"},
        {"info", "info sphere:points=500"},
        {"info", "info @/two.toml"},
        {"plan", "info plan plane:points=441:extent_mm=20"},
        {"plan", "info plan @/two.toml --renderer cloud-literal:shading=none"},
        {"plan", "info plan sphere:points=500 --renderer brute-force"},
        {"catalogue", "list renderers"},
        {"catalogue", "list paths"},
        {"catalogue", "list steps"},
        {"scans", "list scans"},
        {"cleaned", "clean sphere:points=500 --steps thin --out @/c.ply"},
        {"prepared", "prepare sphere:points=500 --out @/c.palsurf"},
        {"result",
         "compare plane:points=121:extent_mm=10 --renderers cloud --path tap:frames=100 --out @/out"}})
    expect_valid(name, succeeds(line, "--json").out);
}

TEST_F(Command, InfoKnowsAPlane) {
  const json info = printed("info plane:points=441:extent_mm=20 --json");
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
  const json info = printed("info @/coarse.xyz --json");
  EXPECT_EQ(info["duplicates"], 1);
  EXPECT_EQ(info["non_finite"], 1);
  EXPECT_TRUE(info["unit_guessed"].get<bool>());
  EXPECT_GE(info["warnings"].size(), 3u) << info["warnings"].dump(1);
  EXPECT_THAT(info["warnings"].dump(), HasSubstr("give --unit"));
  refuses({}, "info @/coarse.xyz --non-finite refuse");
}

TEST_F(Command, InfoIsSilentOnFinePointsAndKnowsRowsWithHoles) {
  // One hole makes the resolution 8 mm; the points around it are no worse for it.
  std::string points =
      "ply\nformat ascii 1.0\ncomment unit mm\nobj_info num_cols 20\nobj_info num_rows 20\n"
      "element vertex 364\nproperty float x\nproperty float y\nproperty float z\n"
      "element range_grid 400\nproperty list uchar int vertex_indices\nend_header\n";
  std::string cells;
  for (int i = 0, n = 0; i < 400; ++i) {
    const int row = i / 20, column = i % 20;
    const bool hole = row >= 7 && row < 13 && column >= 7 && column < 13;
    if (!hole) points += fmt::format("{} {} 0\n", column, row);
    cells += hole ? "0\n" : fmt::format("1 {}\n", n++);
  }
  write_text(folder_ / "scan.ply", points + cells);
  const ProcessOutcome text = succeeds("info @/scan.ply");
  EXPECT_THAT(text.out, HasSubstr("yes, with holes: 20 rows of up to 20"));
  EXPECT_THAT(text.out, HasNone("warning", "highly detailed"));
  EXPECT_THAT(succeeds("info sphere:points=2000").out, HasSubstr("none found in the order of the points"));
}

TEST_F(Command, ListsAreALineEachAndSayMoreOfOne) {
  for (const char* list : {"renderers", "steps"}) {
    const std::size_t all = printed("list", list, "--json").size();
    const std::string text = succeeds("list", list).out;
    EXPECT_LE(count_of(text, "\n"), all + 5) << text;
    EXPECT_THAT(text, HasNone("refine=0", "source: "));
  }
  EXPECT_THAT(succeeds("list renderers cloud").out, HasAll("refine=0", "source: ", "role: "));
  EXPECT_THAT(succeeds("list steps outliers").out, HasSubstr("distance="));
  refuses("did you mean 'cloud-smooth'?", "list renderers cloud-smoth");
}

TEST_F(Command, ReplayLeavesTraceAndResult) {
  succeeds("compare", kTinyWaves, "--renderers cloud --path", kTinyWeave, "--out @/out --paced 20");
  const std::string trace = text_in("out/trace.csv");
  EXPECT_EQ(trace.substr(0, trace.find('\n')),
            "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,gx_mm,gy_mm,gz_mm,frame_ns");
  EXPECT_EQ(std::count(trace.begin(), trace.end(), '\n'), 1501);
  const json result = json_in("out/result.json");
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
    if (info.geometry == render::Geometry::kImages) continue;  // waves are no stream
    names += (names.empty() ? "" : ",") + info.name;
    labels.insert(info.name);
  }
  succeeds("compare", kTinyWaves, "--renderers", names, "--path", kTinyWeave, "--passes 2 --out @/out");
  const json result = json_in("out/result.json");
  expect_valid("result", text_in("out/result.json"));
  ASSERT_EQ(result["renderers"].size(), labels.size());
  for (const json& r : result["renderers"]) {
    const std::string label = r["label"];
    EXPECT_EQ(labels.count(label), 1u);
    EXPECT_EQ(r["status"], "ok") << label;
    EXPECT_FALSE(r["accuracy"].is_null()) << label;
    EXPECT_TRUE(exists("out/trace-" + label + ".csv")) << label;
    if (label == "analytic") {
      EXPECT_EQ(r["accuracy"]["missed_contact_frames"], 0);
      EXPECT_LT(r["accuracy"]["force_rms_n"].get<double>(), 1e-3);
    }
  }
  for (const char* page : {"out/report.html", "out/study.html"}) {
    const std::string report = text_in(page);
    EXPECT_THAT(report, HasSubstr("<svg")) << page;
    EXPECT_THAT(report, HasNone("<script", "src=", "<link")) << page << " must need nothing else";
    EXPECT_LT(report.size(), 1'000'000u) << page;
  }
  EXPECT_TRUE(std::filesystem::exists(in("out/figures/study-force.gp")));
}

TEST_F(Command, CompareSaysInFewLinesWhatTheReportBeginsWith) {
  const auto compared = [&](const std::string& renderers, const Words& more) {
    return succeeds("compare", kTinyWaves, "--renderers", renderers, "--path", kTinyWeave,
                    "--passes 2 --out @/out", more)
        .out;
  };
  std::string many;
  for (int i = 0; i < 12; ++i) many += (i > 0 ? ",cloud:label=c" : "cloud:label=c") + std::to_string(i);
  for (const std::string& renderers :
       {std::string("cloud,brute-force,penalty-grid"), many, std::string("cloud")}) {
    const std::string said = compared(renderers, {}), report = text_in("out/report.html");
    EXPECT_LE(std::count(said.begin(), said.end(), '\n'), 15) << said;
    EXPECT_TRUE(said.ends_with("/out/report.html\n")) << said;
    // Its finding is the first of the report's.
    const std::size_t lead = report.find("<dt>"), text = report.find("<dd>", lead);
    const std::string first = report.substr(lead + 4, report.find("</dt>") - lead - 4);
    EXPECT_EQ(first, renderers == "cloud" ? "Contact" : "Take");
    EXPECT_THAT(said, HasSubstr("99.9 %")) << "the columns are those of the report's first table";
    EXPECT_THAT(said, HasNone("p50", "what it is"));
    std::string words = said;
    std::replace(words.begin(), words.end(), '\n', ' ');
    EXPECT_THAT(words, HasSubstr(report.substr(text + 4, report.find("</dd>", text) - text - 4))) << said;
  }
  const std::string verbose = compared("cloud,brute-force", {"--verbose"});
  EXPECT_GT(verbose.size(), 3000u);
  EXPECT_THAT(verbose, HasSubstr(" ours "));
}

TEST_F(Command, TracesAreTheSameForAnyThreadsAndFromRunToRun) {
  std::set<std::string> hashes;
  int run_number = 0;
  for (const char* threads : {"1", "2", "2"})
    hashes.insert(printed("compare", kTinyWaves, "--renderers cloud --path", kTinyWeave, "--json --out",
                          in("out" + std::to_string(run_number++)), "--threads",
                          threads)["renderers"][0]["trace_hash"]);
  EXPECT_EQ(hashes.size(), 1u);
}

TEST_F(Command, ASceneFileNamesItsRenderer) {
  write_text(folder_ / "s.toml",
             "[[model]]\ngenerate = \"plane\"\npoints = 961\nextent_mm = 30\n[renderer]\nname = "
             "\"cloud\"\nrefine = 1\n");
  const json run = printed("compare @/s.toml --path tap:frames=800 --out @/out --json --renderers auto");
  EXPECT_EQ(run["renderers"][0]["options"]["refine"], "1");
}

TEST_F(Command, AScenesControlActsAndSaysSo) {
  const std::string plane = "[[model]]\ngenerate = \"plane\"\npoints = 961\nextent_mm = 30\n";
  const auto replayed = [&](const std::string& control) {
    write_text(folder_ / "s.toml", plane + "[control]\n" + control);
    return printed(
        "compare @/s.toml --renderers analytic --path tap:frames=800 --out @/out --json")["renderers"][0];
  };
  const json free = replayed("passivity = false\n");
  // The model's 0.5 N/mm behind as much: half the force, and the error is the other half.
  const json coupled = replayed("coupling = { stiffness_n_per_mm = 0.5 }\n");
  EXPECT_NEAR(free["accuracy"]["force_rms_percent"].get<double>(), 0.0, 1e-9);
  EXPECT_NEAR(coupled["accuracy"]["force_rms_percent"].get<double>(), 50.0, 1e-6);
  EXPECT_NEAR(coupled["energy"]["max_stored_mj"].get<double>(),
              0.5 * free["energy"]["max_stored_mj"].get<double>(), 1e-9);
  EXPECT_THAT(coupled["prepare"]["notes"].dump(), HasSubstr("virtual coupling of 0.5 N/mm"));
  EXPECT_THAT(free["prepare"]["notes"].dump(), Not(HasSubstr("control:")));
  // A spring is passive: the controller finds nothing to take.
  EXPECT_LT(free["energy"]["generated_percent"].get<double>(), 1e-9);
  EXPECT_EQ(replayed("passivity = true\n")["status"], "ok");
}

TEST_F(Command, SaveMeshWritesAMeshThatReadsBack) {
  if (all_renderers().find("mesh-godobject") == nullptr) GTEST_SKIP() << "built without mesh-godobject";
  succeeds("compare", kTinyWaves, "--renderers mesh-godobject:mesh=original --path", kTinyWeave,
           "--out @/out --save-mesh @/mesh.ply");
  EXPECT_EQ(printed("info @/mesh.ply --json")["triangles"], 5000);
  ends_with(1, {},
            words("compare", kTinyWaves, "--renderers cloud --path", kTinyWeave,
                  "--out @/out --save-mesh @/none.ply"));
}

TEST_F(Command, ReproduceTakesAManifestOfOnesOwn) {
  const std::string text =
      "table = 42\nkind = \"frames\"\ntitle = \"Table 42: mine\"\n[printed]\nhardware = \"none\"\n"
      "[[model]]\nname = \"plane\"\ngenerate = \"plane:points=900\"\n"
      "[path]\nspec = \"tap:frames=500\"\n[[run]]\nrenderer = \"cloud\"\n";
  write_text(folder_ / "mine.toml", text);
  EXPECT_THAT(succeeds("reproduce --tables @/mine.toml --verbose --out @/out").out,
              HasSubstr("Table 42: mine"));
  EXPECT_TRUE(exists("out/table42/result.json"));
  write_text(folder_ / "mine.toml", text + "quik = \"cloud\"\n");
  refuses({"mine.toml:13: ", "did you mean 'quick'?"}, "reproduce --tables @/mine.toml --out @/wrong");
  EXPECT_FALSE(exists("wrong"));
}

TEST_F(Command, GrowthIsATableOfItsOwn) {
  if (all_renderers().find("mesh-godobject") == nullptr) GTEST_SKIP() << "built without the baselines";
  const ProcessOutcome run = succeeds("reproduce --tables growth --quick --verbose --out @/out");
  const json document = json_in("out/growth/result.json");
  ASSERT_EQ(document["renderers"].size(), 8u);
  EXPECT_EQ(document["renderers"][0]["label"], "cloud-900");
  EXPECT_EQ(document["renderers"][7]["label"], "mesh-godobject-22500");
  EXPECT_THAT(run.out, HasSubstr("22,500"));
}

TEST_F(Command, NeighboursOfTable6AreADocumentOfTheirOwn) {
  const ProcessOutcome run = palpate_command({"reproduce", "--tables", "6", "--quick", "--out", in("out")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(file_text(in("out/table6.html")).find("for the whole model"), std::string::npos)
      << "a part is not compared with the thesis's whole";
  const std::string text = text_in("out/table6/neighbours.json");
  expect_valid("neighbours", text);
  const json document = json::parse(text);
  EXPECT_EQ(document["modified_knn"].size(), 2u);
  EXPECT_GT(document["builders"].size(), document["modified_knn"].size());
  EXPECT_FALSE(exists("out/table6/result.json")) << "no renderer ran";
}

TEST_F(Command, ReproduceMakesEachMeshOnceAndAnewWhereAsked) {
  if (all_renderers().find("mesh-godobject") == nullptr) GTEST_SKIP() << "built without the reconstructions";
  const Environment cache("PALPATE_MESH_CACHE", in("meshes").c_str());
  const auto rows = [&](const char* out, int status, const std::vector<std::string>& more) {
    const ProcessOutcome run = palpate("reproduce --tables 3 --quick --verbose --out", in(out), more);
    EXPECT_EQ(run.exit_code, status) << run.err;
    EXPECT_THAT(run.out, HasSubstr("Onyx"));
    const std::string text = text_in(std::string(out) + "/table3/meshes.json");
    expect_valid("meshes", text);
    EXPECT_FALSE(exists(std::string(out) + "/table3/result.json")) << "no renderer ran";
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

TEST_F(Command, APathThatStartsNearASurfaceIsNotInsideIt) {
  if (all_renderers().find("penalty-grid") == nullptr) GTEST_SKIP() << "built without the rivals";
  succeeds("clean sphere:points=2000 --steps thin/cell=0.1 --out @/scan.ply");
  // 1 mm above the pole of a sphere of 25 mm, where the penalty's band is felt already; beside the point
  // there, on which no direction is away from it. No truth, no generator.
  std::string path = "t_s,x_mm,y_mm,z_mm\n";
  for (int i = 0; i < 200; ++i)
    path += std::to_string(0.001 * i) + ",0.05,0," + std::to_string(26.0 - 0.01 * i) + "\n";
  write_text(folder_ / "near.csv", path);
  const ProcessOutcome run =
      succeeds("compare @/scan.ply --renderers penalty-grid,cloud --path @/near.csv --out @/out --unit mm");
  const json result = json_in("out/result.json");
  EXPECT_EQ(result["renderers"][0]["frame"]["contact_frames"], 200);
  EXPECT_LT(result["renderers"][1]["frame"]["contact_frames"], 200);
  EXPECT_THAT(run.err, HasSubstr("at the path's first position already"));
  // Where the truth is known a path that starts inside is refused, whatever the renderer feels.
  write_text(folder_ / "inside.csv", "t_s,x_mm,y_mm,z_mm\n0,0,0,20\n0.001,0,0,20\n");
  refuses("inside.csv:2: the path starts inside the model",
          "compare sphere:points=2000 --renderers cloud --reference none --path @/inside.csv --out @/two");
}

TEST_F(Command, FetchListsWithLicenceAndChecksum) {
  const json list = printed("list scans --json");
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

// ---- files and places that are unusual: formats that are not read, corners far from the origin, numbers for
// no data, models that move

class Reading : public OnCommandLine {};

TEST_F(Reading, AScanThatIsCutShortIsNamed) {
  write_text(folder_ / "scan.laz", "LASF");
  refuses({"scan.laz", "cut short"}, "info @/scan.laz");
}

TEST_F(Reading, APreparedFileIsFeltAndTakesTheScansPlace) {
  succeeds("prepare sinusoid:points=2601 --out @/a.palsurf");
  EXPECT_THAT(succeeds("info @/a.palsurf").out, HasAll("prepared from", "level 0", "level 1"));
  succeeds("compare @/a.palsurf --renderers cloud-smooth,cloud --path weave:frames=500 --out @/felt");
  // A tile that is damaged is felt as absent, and named.
  std::string bytes = file_text(in("a.palsurf"));
  // The finest surface's tiles come first, and are more than a third of the file.
  for (std::size_t at = 516; at < bytes.size() / 3; at += 1000) bytes[at] = static_cast<char>(bytes[at] ^ 1);
  write_text(folder_ / "damaged.palsurf", bytes);
  EXPECT_THAT(
      succeeds("compare @/damaged.palsurf --renderers cloud-smooth --path weave:frames=500 --out @/hurt").err,
      HasAll("damaged", "felt as absent"));
  // Made again it replaces what was made before, and nothing else.
  succeeds("prepare sinusoid:points=2601 --out @/a.palsurf");
  write_text(folder_ / "b.palsurf", "mine");
  refuses({"b.palsurf", "--force"}, "prepare sinusoid:points=2601 --out @/b.palsurf");
  refuses("has its unit already", "info @/a.palsurf --unit m");
  refuses(".palcells", "prepare sinusoid:points=2601 --out @/a.ply");
  refuses("prepared file already", "prepare @/a.palsurf --out @/c.palsurf");

  std::string rows =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nend_header\n";
  for (const float number : {0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f})
    rows.append(reinterpret_cast<const char*>(&number), sizeof number);
  write_text(folder_ / "a.ply", rows);
  refuses("--unit", "prepare @/a.ply --out @/a.palcells");
  EXPECT_THAT(succeeds("prepare @/a.ply --unit cm --out @/a.palcells").out, HasSubstr("3 points in 1 cells"));
  EXPECT_THAT(succeeds("info @/a.palcells").out, HasSubstr("10 x 10 x 0 mm"));
  expect_valid("prepared", succeeds("prepare @/a.ply --unit cm --json --out @/a.palcells").out);
  std::filesystem::create_directory(folder_ / "tiles");
  write_text(folder_ / "tiles/a.ply", rows);
  refuses("among the tiles", "prepare @/tiles --unit cm --out @/tiles/a.palcells");
  succeeds("prepare @/tiles --unit cm --out @/b.palcells");
}

TEST_F(Reading, CornersFarFromTheOriginAreTold) {
  write_text(folder_ / "far.txt",
             "id;x(mm);y(mm);z(mm)\n1;5400000000,25;1;0\n2;5400000001,5;2;0\n3;5400000002;4;1\n");
  EXPECT_THAT(succeeds("info @/far.txt").out,
              HasAll("(5400000000.25, 1, 0) to (5400000002, 4, 1) mm", "x, y, z are columns 2, 3, 4"));
}

TEST_F(Reading, ANumberForNoDataIsOfTheCommandLineOrTheScene) {
  write_text(
      folder_ / "a.asc",
      "ncols 4\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\n-32768 -32768 -32768 7\n1 2 3 4\n5 6 7 8\n");
  EXPECT_THAT(succeeds("info @/a.asc --no-data -32768").out, HasSubstr("left out           3 "));
  write_text(folder_ / "a.toml", "[[model]]\ncloud = \"a.asc\"\nno_data = -32768\n");
  EXPECT_THAT(succeeds("info @/a.toml").out, HasSubstr("left out           3 "));
  refuses({"--no-data", "'none'", "-9999"}, "info @/a.asc --no-data none");
  write_text(folder_ / "a.xyz", "1 2 3\n");
  refuses("'no_data' is of grids of heights", "info @/a.xyz --no-data 0");
  refuses("--no-data is of model files", "info sphere:points=500 --no-data 0");
}

TEST_F(Reading, APartOfAFileIsTaken) {
  std::string points;
  for (int i = 0; i < 40; ++i)
    for (int j = 0; j < 30; ++j) points += fmt::format("{} {} {}\n", 0.5 * i, 0.5 * j, 0.01 * (i * j % 7));
  write_text(folder_ / "a.txt", points);
  succeeds("prepare @/a.txt --unit mm --out @/whole.palsurf");
  refuses("felt whole", "info @/whole.palsurf --within 0,0,0,9,9,9");
  EXPECT_THAT(succeeds("info @/a.txt --unit mm --within 0,0,-1,9.5,4.5,1").out,
              HasAll("200 of 1200 points, within (0, 0, -1) to (9.5, 4.5, 1) mm", "9.5 x 4.5 x"));
  const json info = printed("info @/a.txt --unit mm --within 0,0,-1,9.5,4.5,1 --json");
  EXPECT_EQ(info["outside"], 1000);
  EXPECT_EQ(info["points"], 200);
  expect_valid("info", info.dump());
  // Of a part there is a surface, and no cells.
  succeeds("prepare @/a.txt --unit mm --within 0,0,-1,9.5,9.5,1 --out @/part.palsurf");
  refuses("--within does nothing: cells are of all points",
          "prepare @/a.txt --unit mm --within 0,0,-1,9.5,9.5,1 --out @/part.palcells");
  refuses({"--within: 3 numbers are no box", "0,0,0,100,100,50"}, "info @/a.txt --within 0,0,0");
  refuses("--within: 'x' is not", "info @/a.txt --within 0,0,0,1,1,x");
  refuses("--within: (0, 0, 9) to (1, 1, 1) mm is no box", "info @/a.txt --within 0,0,9,1,1,1");
  refuses("the points are within (0, 0, 0) to", "info @/a.txt --unit mm --within -9,-9,-9,-8,-8,-8");
  refuses("--within is of model files", "info sphere:points=500 --within 0,0,0,1,1,1");
}

TEST_F(Reading, AModelThatMovesIsSaidToBe) {
  write_text(folder_ / "moved.toml",
             "[[model]]\ngenerate = \"sphere\"\npoints = 500\nposition_mm = [5, 100, 0]\n[model.motion]\n"
             "velocity_mm_s = [10, 0, 0]\n");
  EXPECT_THAT(succeeds("info @/moved.toml").out, HasAll("moves it by (5, 100, 0) mm", "the model moves"));
  // No remedy that is refused in its turn.
  refuses({"the model 'sphere' moves", "leave out its motion"}, "tune @/moved.toml --max-error 5 --out @/t");
  refuses({"the model 'sphere' moves", "leave out its motion"}, "test stability @/moved.toml --out @/s");
}

}  // namespace
}  // namespace palpate::experiments
