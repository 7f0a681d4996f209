// What a new user does first: paths by name, surfaces from the command line, models, paths and references
// that do not fit each other.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include <palpate/generate.h>
#include <palpate/paths.h>
#include <palpate/trace.h>
#include "experiments/report/tables.h"
#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "tests/experiments/program.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const char* const kPlane = "plane:points=961:extent_mm=30";

class Usage : public OnCommandLine {
 protected:
  /// A file of points "x y z".
  std::string points(const std::string& name, const std::vector<Vec3>& at) {
    std::string text;
    for (const Vec3& p : at) text += fmt::format("{} {} {}\n", p.x(), p.y(), p.z());
    write_text(folder_ / name, text);
    return in(name);
  }
  std::string path_at(const std::string& name, const std::vector<Vec3>& at) {
    trace::ProbePath path;
    for (std::size_t k = 0; k < at.size(); ++k) path.t_s.push_back(1e-3 * static_cast<double>(k));
    path.hip_mm = at;
    EXPECT_TRUE(trace::write_path_csv(path, in(name)));
    return in(name);
  }
  /// The warnings of a run, after it was checked that terminal, document and report have the same.
  template <class... Parts>
  std::vector<std::string> warnings(const Parts&... parts) {
    const ProcessOutcome run = succeeds("compare", parts..., "--out @/out");
    const json document = json_in("out/result.json");
    std::vector<std::string> all = document["warnings"];
    for (const std::string& warning : all) {
      EXPECT_THAT(run.err, HasSubstr("palpate: warning: " + warning));
      EXPECT_THAT(text_in("out/report.html"), HasSubstr(html_escaped(warning))) << warning;
    }
    return all;
  }
};

bool any_says(const std::vector<std::string>& sentences, const std::string& what) {
  return std::any_of(sentences.begin(), sentences.end(),
                     [&](const std::string& s) { return s.find(what) != std::string::npos; });
}

// ---- paths

TEST_F(Usage, ListsHaveEverythingThereIsWithEveryOption) {
  using Owners = std::vector<std::pair<std::string, std::vector<OptionSpec>>>;
  Owners renderers, generators, steps;
  const render::Registry registry = all_renderers();
  for (const auto& info : registry.all()) renderers.emplace_back(info.name, info.options);
  for (const auto& one : paths::path_generators()) generators.emplace_back(one.name, one.options);
  for (const auto& step : all_cleaning().all()) steps.emplace_back(step.name, step.options);
  for (const auto& [kind, owners] :
       {std::pair{"renderers", renderers}, {"paths", generators}, {"steps", steps}}) {
    const std::string text = succeeds("list", kind).out;
    const json list = printed("list", kind, "--json");
    // Beside the paths of the toolkit a hand that touches, and what is read of a file.
    ASSERT_EQ(list.size(), owners.size() + (std::string(kind) == "paths" ? 2u : 0u)) << kind;
    for (std::size_t i = 0; i < owners.size(); ++i) {
      const auto& [name, options] = owners[i];
      EXPECT_EQ(list[i]["name"], name);
      ASSERT_EQ(list[i]["options"].size(), options.size()) << name;
      EXPECT_THAT(text, HasSubstr(name));
      const std::string one = succeeds("list", kind, name).out;
      for (std::size_t k = 0; k < options.size(); ++k) {
        EXPECT_EQ(list[i]["options"][k]["key"], options[k].key);
        EXPECT_EQ(list[i]["options"][k]["default"], options[k].default_value);
        EXPECT_THAT(one, HasSubstr(options[k].key + "=" + options[k].default_value)) << name;
      }
    }
  }
}

TEST_F(Usage, OneOfAListIsShownAlone) {
  for (const auto& [list, name, near] : {std::tuple{"paths", "tap", "tab"},
                                         {"paths", "FILE.traj", "FILE.tray"},
                                         {"renderers", "cloud", "cluod"}}) {
    const json shown = printed("list", list, name, "--json");
    ASSERT_EQ(shown.size(), 1u);
    EXPECT_EQ(shown[0]["name"], name);
    refuses(fmt::format("did you mean '{}'?", name), "list", list, near);
  }
}

TEST_F(Usage, EveryExampleOfAPathIsOne) {
  const cloud::GeneratedModel model = cloud::generate(*parse_named_options("sphere:points=10000")).value();
  paths::PathTarget target;
  target.cloud = &model.cloud;
  for (const bool formula : {true, false}) {
    target.surface = formula ? model.surface.get() : nullptr;
    for (const paths::PathGenerator& generator : paths::path_generators()) {
      if (generator.name == "hand") continue;  // which is run below: it needs somebody to feel
      const auto path = paths::make_path(*parse_named_options(generator.example), target);
      EXPECT_TRUE(path) << generator.example << ": " << (path ? "" : path.error().message());
    }
  }
}

TEST_F(Usage, EveryGeneratorRunsOnAFileOfPoints) {
  std::vector<Vec3> bowl;
  Random random(5);
  for (int i = 0; i < 4000; ++i) {
    const double x = random.uniform(-20, 20), y = random.uniform(-20, 20);
    bowl.emplace_back(x, y, 0.01 * (x * x + y * y));
  }
  const std::string file = points("bowl.xyz", bowl);
  for (const paths::PathGenerator& generator : paths::path_generators()) {
    EXPECT_GT(
        printed("compare", file, "--unit mm --renderers cloud --path",
                generator.name + (generator.name == "hand" ? ":frames=3000" : ":frames=3000:depth_mm=0.5"),
                "--out @/out --json")["renderers"][0]["frame"]["contact_frames"],
        500)
        << generator.name;
  }
}

TEST_F(Usage, ColumnsOfARecordingFromTheCommandLine) {
  std::string text = "# a robot's log\nn,time,px,py,pz\n";
  for (int i = 0; i < 400; ++i)
    text += fmt::format("{},{},0.001,0.002,{}\n", i, i, 0.001 * (0.4 - 0.005 * i));
  write_text(folder_ / "log.csv", text);
  const auto hash = [&](const std::vector<std::string>& path) {
    return printed("compare", kPlane, "--renderers cloud --out @/out --json",
                   path)["renderers"][0]["trace_hash"]
        .get<std::string>();
  };
  std::vector<Vec3> straight;
  for (int i = 0; i < 400; ++i) straight.emplace_back(1, 2, 1000 * (0.001 * (0.4 - 0.005 * i)));
  const std::string csv = hash({"--path", path_at("same.csv", straight)});
  EXPECT_EQ(hash({"--path", in("log.csv") + ":t=1:x=2:y=3:z=4:mm_per_unit=1000:s_per_unit=0.001"}), csv);
  std::filesystem::copy_file(folder_ / "log.csv", folder_ / "log.traj");
  EXPECT_EQ(hash({"--path", in("log.traj") + ":t=1:x=2:y=3:z=4:mm_per_unit=1000:s_per_unit=0.001"}), csv);
  // As the former version had it.
  EXPECT_EQ(hash({"--path", in("log.traj") + ":t=1:x=2:y=3:z=4", "--traj-columns",
                  "mm_per_unit=1000,s_per_unit=0.001"}),
            csv);
  const auto refused = [&](const Words& path, const Says& says) {
    refuses(says, "compare", kPlane, "--renderers cloud --out @/no", path);
  };
  refused({"--path", in("log.csv") + ":tt=2"}, "tt");
  refused({"--path", in("log.csv") + ":t=0:x=9"}, "too few");
  refused({"--path", in("log.csv")}, {"header", "FILE:t=0"});
  refused({"--path", "spirale"}, "did you mean 'spiral'?");
}

// ---- surfaces

TEST_F(Usage, SurfacesFromTheCommandLineActAndSaySo) {
  const auto largest = [&](const std::vector<std::string>& surface) {
    const ProcessOutcome run = succeeds(
        "compare", kPlane, "--renderers cloud --path tap:frames=500:depth_mm=1 --out @/out", surface);
    if (!surface.empty()) {
      EXPECT_THAT(run.err, HasSubstr("From the command line, for every model"));
    }
    double most = 0;
    const auto read = trace::read_trace_csv(in("out/trace.csv"));
    for (const render::Frame& frame : read->trace.frames) most = std::max(most, frame.force_n.norm());
    return most;
  };
  EXPECT_NEAR(largest({}), 0.5, 1e-4);
  EXPECT_NEAR(largest({"--stiffness", "0.8"}), 0.8, 1e-4);
  EXPECT_NEAR(largest({"--stiffness", "0.8", "--deformation", "0.25"}), 0.6, 1e-4);
  EXPECT_THAT(succeeds("info plan", kPlane, "--friction 0.7,0.5 --json").out,
              HasSubstr("friction 0.7 static, 0.5 dynamic"));
}

TEST_F(Usage, SurfacesThatCannotBeAreRefused) {
  for (const std::string word :
       {"--stiffness=0", "--stiffness=-1", "--stiffness=nan", "--stiffness=inf", "--stiffness=1e300",
        "--friction=1e300", "--stiffness=0.5 N", "--friction=-0.1", "--friction=0.5,0.7", "--friction=1,2,3",
        "--friction=0.5,", "--friction=a", "--deformation=1", "--deformation=-0.1", "--deformation=1e999"})
    refuses(word.substr(0, word.find('=')), "info plan", kPlane, word);
}

TEST_F(Usage, SurfacesPointByPointAreNotPassedOverInSilence) {
  const std::string model = "[[model]]\ngenerate = \"plane\"\npoints = 961\nextent_mm = 30\n";
  write_text(folder_ / "region.toml", model + "[[model.region]]\nx_mm = [0, 10]\nfriction = 0.9\n");
  const auto region = warnings("@/region.toml --friction 0.2 --renderers cloud --path tap:frames=500");
  EXPECT_TRUE(any_says(region, "--friction does not hold in a region of 'plane' (line 5)")) << json(region);
  std::string ply = "x y z k\n";
  for (int i = 0; i < 400; ++i) ply += fmt::format("{} {} 0 0.5\n", i % 20, i / 20);
  write_text(folder_ / "k.csv", ply);
  write_text(folder_ / "column.toml",
             "[[model]]\ncloud = \"k.csv\"\nunit = \"mm\"\n[model.surface]\nstiffness_n_per_mm = { column = "
             "\"k\" }\n");
  refuses({"point by point from the column 'k'", "column.toml:4"}, "info plan @/column.toml --stiffness 0.8");
}

// ---- scans by name

TEST_F(Usage, EveryCommandThatTakesAModelTakesAScanByName) {
  const Environment data("PALPATE_DATA", folder_.c_str());
  const Environment cache("XDG_CACHE_HOME", in("cache").c_str());
  refuses("palpate fetch stanford-bunny", "info stanford-bunny");
  EXPECT_THAT(palpate("info stanford-buny").err, HasSubstr("did you mean 'stanford-bunny'"));
  succeeds("clean sphere:points=2000:scale=0.001 --steps thin/cell=0.1 --out @/sphere.ply");
  std::filesystem::create_directories(folder_ / "stanford");
  std::filesystem::rename(folder_ / "sphere.ply", folder_ / "stanford/bun_zipper.ply");
  EXPECT_EQ(printed("info stanford-bunny --json")["unit"], "m");
  succeeds("info plan stanford-bunny");
  succeeds("clean stanford-bunny --steps thin --out @/thin.ply");
  succeeds("compare stanford-bunny --renderers cloud --path tap:frames=500 --out @/compare");
}

// ---- what is not here

TEST_F(Usage, TablesAreReproducedAsFarAsTheNetworkAllows) {
  if (palpate("list renderers").out.find("mesh-godobject") == std::string::npos)
    GTEST_SKIP() << "built without meshes";
  std::filesystem::create_directories(folder_ / "empty");
  const Environment data("PALPATE_DATA", in("empty").c_str()), cache("XDG_CACHE_HOME", in("cache").c_str());
  // Nobody listens on the port that is to be discarded.
  const char* const kNobody = "http://127.0.0.1:9";
  const Environment http("http_proxy", kNobody), https("https_proxy", kNobody), all("all_proxy", kNobody),
      npm("npm_config_registry", kNobody), none("no_proxy", nullptr), upper("NO_PROXY", nullptr);
  EXPECT_THAT(
      succeeds("reproduce --tables 3 --mesh-limit 0.5 --verbose --out @/out").out,
      HasAll("not done: table 3, bunny", "not done: table 3, dragon", "Reconstruction of the sinusoid"));
  EXPECT_TRUE(exists("out/report.html"));
  // Where nothing comes of what was asked for, that is a failure.
  EXPECT_EQ(palpate("reproduce --tables 9 --out @/nine").exit_code, 1);
}

// ---- models that are none

TEST_F(Usage, PointsThatAreNoSurfaceAreRefused) {
  std::vector<Vec3> line;
  for (int i = 0; i < 50; ++i) line.emplace_back(1 + 0.3 * i, 2 + 0.7 * i, 3 - 0.1 * i);
  const std::vector<std::pair<std::string, std::string>> clouds = {
      {points("one.xyz", {{1, 2, 3}}), "it has one point"},
      {points("same.xyz", std::vector<Vec3>(1000, Vec3(1, 2, 3))), "its 1000 points stand in one place"},
      {points("two.xyz", {{1, 2, 3}, {4, 5, 6}, {1, 2, 3}}), "its 3 points stand in 2 places"},
      {points("line.xyz", line), "its 50 points stand in one line"}};
  const std::string path = path_at("p.csv", {{0, 0, 10}, {0, 0, 9}});
  for (const auto& [file, says] : clouds) {
    SCOPED_TRACE(file);
    const ProcessOutcome info = succeeds("info", file, "--unit mm --json");
    EXPECT_TRUE(any_says(json::parse(info.out)["warnings"], says)) << info.out;
    for (const Words& command :
         {words("info plan", file, "--unit mm"),
          words("compare", file, "--unit mm --renderers auto --out @/out --path", path),
          words("compare", file, "--unit mm --renderers cloud --out @/out --path", path)})
      refuses({says, "at least 3 that are not in one line"}, command);
  }
  const std::string three = points("three.xyz", {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}});
  EXPECT_EQ(palpate("info plan", three, "--unit mm").exit_code, 0) << "three places are a plane";
}

TEST_F(Usage, AFileInMetresReadAsMillimetresIsSaid) {
  std::vector<Vec3> at;
  for (int i = 0; i < 400; ++i) at.emplace_back(0.01 * (i % 20), 0.01 * (i / 20), 0);
  const std::string file = points("metres.xyz", at);
  const auto warned = [&](const char* unit) {
    return any_says(printed("info", file, "--unit", unit, "--json")["warnings"], "is its file in metres");
  };
  EXPECT_TRUE(warned("mm"));
  EXPECT_FALSE(warned("m"));
  EXPECT_FALSE(warned("um")) << "said on purpose";
}

// ---- paths, references and models that do not fit

TEST_F(Usage, APathThatNeverTouchesIsSaidWithItsNearestApproach) {
  const auto run = [&](const std::vector<Vec3>& at) {
    return warnings(kPlane, "--renderers cloud,analytic --path", path_at("p.csv", at));
  };
  // Above the plane, deepest in the middle, beside a point by (0.5, 0.5).
  std::vector<Vec3> above;
  for (int i = -50; i <= 50; ++i) above.emplace_back(0.5 + 0.001 * i, 0.5, 5 + 0.01 * std::abs(i));
  std::vector<std::string> said = run(above);
  ASSERT_EQ(said.size(), 1u) << json(said);
  EXPECT_THAT(said[0], HasAll("The path never touches: its nearest approach is 5.05 mm", "at 0.05 s"));
  // A hundred models away, of its size.
  std::vector<Vec3> away;
  for (int i = 0; i < 100; ++i) away.emplace_back(3000 + 0.2 * i, 0, 1);
  said = run(away);
  EXPECT_TRUE(any_says(said, "in another frame or unit")) << json(said);
  EXPECT_TRUE(any_says(said, "approach is 2,985 mm")) << json(said);
  // The same shape in metres.
  std::vector<Vec3> metres;
  for (int i = 0; i < 100; ++i) metres.emplace_back(1e-4 * i, 0, 1e-3 * (5 - 0.03 * i));
  said = run(metres);
  EXPECT_TRUE(any_says(said, "in another unit")) << json(said);
  // And one that does touch is left in peace.
  EXPECT_TRUE(warnings(kPlane, "--renderers cloud --path tap:frames=500").empty());
}

TEST_F(Usage, ARendererThatFeelsNothingWhereTheTruthDoesIsSaid) {
  // Boxes of a hundredth of a millimetre: the HIP falls between them.
  const auto said =
      warnings(kPlane, "--renderers cloud-literal:box_mm=0.01,cloud --path tap:frames=900:u=0.517:v=0.517");
  EXPECT_TRUE(any_says(said, "cloud-literal never feels the model; the truth does in")) << json(said);
  EXPECT_FALSE(any_says(said, "never touches")) << json(said);
}

TEST_F(Usage, AReferenceElsewhereIsRefusedAndOneThatDoesNotFitSaid) {
  if (palpate("list renderers").out.find("mesh-godobject") == std::string::npos)
    GTEST_SKIP() << "built without the reference on meshes";
  const auto mesh = [&](const char* name, double scale, const Vec3& at) {
    std::string off = "OFF\n4 2 0\n";
    for (const auto& [x, y] : {std::pair{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}})
      off += fmt::format("{} {} {}\n", at.x() + 15 * scale * x, at.y() + 15 * scale * y, at.z());
    write_text(folder_ / name, off + "3 0 1 2\n3 0 2 3\n");
    return in(name);
  };
  const auto compare = [&](const std::string& reference) {
    return words(kPlane, "--renderers cloud --path", path_at("p.csv", {{1, 2, 1}, {1, 2, 0.5}, {1, 2, -0.2}}),
                 "--reference", reference);
  };
  EXPECT_TRUE(warnings(compare(mesh("right.off", 1, Vec3::Zero()))).empty());
  refuses({"stands elsewhere than the model", "(85, -15, 0) to (115, 15, 0)", "(-15, -15, 0) to (15, 15, 0)"},
          "compare", compare(mesh("elsewhere.off", 1, Vec3(100, 0, 0))), "--out @/no");
  const std::vector<std::string> small = warnings(compare(mesh("small.off", 1e-3, Vec3::Zero())));
  EXPECT_TRUE(any_says(small, "metres and millimetres?")) << json(small);
  const std::vector<std::string> aside = warnings(compare(mesh("aside.off", 1, Vec3(0, 0, 0.29))));
  EXPECT_TRUE(aside.empty()) << json(aside) << " within the spacing";
}

TEST_F(Usage, ModelsFarApartAreSaid) {
  const std::string first = "[[model]]\ngenerate = \"plane\"\npoints = 961\nextent_mm = 30\n";
  const auto said = [&](const std::string& second) {
    write_text(folder_ / "s.toml", first + first + second);
    return warnings("@/s.toml --renderers cloud --path tap:frames=500");
  };
  EXPECT_TRUE(said("position_mm = [0, 0, -20]\n").empty());
  EXPECT_TRUE(any_says(said("position_mm = [30000, 0, 0]\n"), "29,970 mm from the nearest other model"));
  EXPECT_TRUE(any_says(said("scale = 0.001\n"), "metres and millimetres?"));
}

}  // namespace
}  // namespace palpate::experiments
