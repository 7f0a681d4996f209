// `palpate clean`, clean= of a renderer, and a mesh file as the truth.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "experiments/run/cleaning.h"
#include "tests/experiments/program.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/core/random.h"
#include "toolkit/io/write_mesh.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const char* const kPath = "exploration:frames=3000:depth_mm=0.5:seed=1";

/// A sphere as a scanner sees it: noisy, with stray points; and its true mesh.
class CleanCommand : public InFolder {
 protected:
  CleanCommand() {
    const cloud::GeneratedModel model = *cloud::generate(*parse_named_options("sphere:points=3000"));
    Random random(3);
    std::vector<Vec3> points;
    const auto noise = [&](double by) {
      return Vec3(random.uniform(-by, by), random.uniform(-by, by), random.uniform(-by, by));
    };
    for (std::size_t i = 0; i < model.cloud.size(); ++i)
      points.push_back(model.cloud.point_mm(i) + noise(0.5));
    for (int i = 0; i < 20; ++i) points.push_back(model.cloud.box_mm().high_mm + Vec3(9, 9, 9) + noise(9));
    EXPECT_TRUE(
        io::write_cloud_ply(in("scan.ply"), *cloud::build_cloud(points, cloud::NonFinite::kRefuse)).ok());
    EXPECT_TRUE(io::write_mesh_ply(in("truth.ply"), *model.original_mesh).ok());
    points_ = points.size();
  }
  json result(const std::string& folder) const {
    std::ifstream file(in(folder + "/result.json"));
    return json::parse(file);
  }
  std::size_t points_ = 0;
};

TEST_F(CleanCommand, ListsItsStepsWithOptions) {
  const ProcessOutcome text = palpate_command({"clean"});
  const ProcessOutcome run = palpate_command({"clean", "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json list = json::parse(run.out);
  ASSERT_EQ(list.size(), all_cleaning().all().size());
  for (const scene::CleaningStep& step : all_cleaning().all())
    for (const OptionSpec& option : step.options)
      EXPECT_NE(text.out.find(option.key + "=" + option.default_value), std::string::npos) << option.key;
}

TEST_F(CleanCommand, WritesWhatIsLeft) {
  const ProcessOutcome run = palpate_command(
      {"clean", in("scan.ply"), "--steps", "outliers+smooth", "--out", in("cleaned.ply"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json report = json::parse(run.out);
  EXPECT_EQ(report["points_before"], points_);
  EXPECT_LE(report["points_after"], points_ - 20);
  ASSERT_EQ(report["steps"].size(), 2u);
  EXPECT_GT(report["steps"][1]["ms"], 0.0);
  const ProcessOutcome info = palpate_command({"info", in("cleaned.ply"), "--json"});
  ASSERT_EQ(info.exit_code, 0) << info.err;
  EXPECT_EQ(json::parse(info.out)["points"], report["points_after"]);
}

TEST_F(CleanCommand, WrongArgumentsLeaveNothingBehind) {
  const auto refused = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "clean");
    const ProcessOutcome run = palpate_command(arguments);
    EXPECT_EQ(run.exit_code, 2) << run.err;
    EXPECT_FALSE(std::filesystem::exists(in("out.ply")));
    return run.err;
  };
  const std::string scan = in("scan.ply"), out = in("out.ply");
  EXPECT_NE(refused({scan, "--steps", "outlier", "--out", out}).find("did you mean 'outliers'"),
            std::string::npos);
  EXPECT_NE(refused({scan, "--steps", "smooth/neighbours=1", "--out", out}).find("neighbours"),
            std::string::npos);
  EXPECT_NE(refused({scan, "--out", out}).find("nothing to do"), std::string::npos);
  EXPECT_NE(refused({scan, "--steps", "smooth"}).find("--out"), std::string::npos);
  EXPECT_NE(refused({in("none.ply"), "--steps", "smooth", "--out", out}).find("none.ply"), std::string::npos);
  EXPECT_NE(refused({scan, "--steps", "outliers/distance=1e-6", "--out", out}).find("every one"),
            std::string::npos);
  EXPECT_NE(refused({scan, "--steps", "thin", "--out", in("nowhere/out.ply")}).find("nowhere"),
            std::string::npos);
}

TEST_F(CleanCommand, ARendererOnCleanedPointsIsNearerToTheTruth) {
  const ProcessOutcome run =
      palpate_command({"compare", in("scan.ply"), "--reference", in("truth.ply"), "--path", kPath,
                       "--renderers", "cloud,cloud:clean=outliers+smooth:label=cleaned", "--out", in("out")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json document = result("out");
  const json &raw = document["renderers"][0], &cleaned = document["renderers"][1];
  EXPECT_EQ(raw["model"]["points"], points_);
  EXPECT_LE(cleaned["model"]["points"], points_ - 20);
  EXPECT_EQ(cleaned["prepare"]["phases"][0]["name"], "cleaning: outliers");
  EXPECT_NE(cleaned["options"]["clean"].get<std::string>().find("smooth/"), std::string::npos);
  EXPECT_LT(cleaned["accuracy"]["force_rms_n"], 0.7 * raw["accuracy"]["force_rms_n"].get<double>());
  // What the result prints as an option can be given again.
  EXPECT_TRUE(all_cleaning().parse(cleaned["options"]["clean"].get<std::string>()).ok());
}

TEST_F(CleanCommand, CleaningOfTheSceneCountsAsPreparation) {
  std::ofstream(in("scene.toml"))
      << "[[model]]\ncloud = \"scan.ply\"\n  [[model.clean]]\n  step = \"outliers\"\n";
  const ProcessOutcome run =
      palpate_command({"replay", in("scene.toml"), "--renderer", "cloud", "--reference", in("truth.ply"),
                       "--path", kPath, "--out", in("out")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json one = result("out")["renderers"][0];
  EXPECT_EQ(one["prepare"]["phases"][0]["name"], "cleaning: outliers");
  EXPECT_LE(one["model"]["points"], points_ - 20);
  EXPECT_NE(palpate_command({"info", in("scene.toml")}).out.find("points removed"), std::string::npos);
}

TEST_F(CleanCommand, AReferenceMustBeAMesh) {
  const auto refused = [&](const std::string& reference) {
    const ProcessOutcome run =
        palpate_command({"replay", in("scan.ply"), "--renderer", "cloud", "--reference", reference, "--path",
                         kPath, "--out", in("out")});
    EXPECT_EQ(run.exit_code, 2) << run.err;
    return run.err;
  };
  EXPECT_NE(refused(in("scan.ply")).find("no faces"), std::string::npos);
  EXPECT_NE(refused("analitic").find("choose from auto"), std::string::npos);
  const Environment nowhere("PALPATE_DATA", in("nowhere").c_str()), cache("XDG_CACHE_HOME", in("no").c_str());
  EXPECT_NE(refused("stanford-bunny").find("palpate fetch stanford-bunny"), std::string::npos);
  EXPECT_NE(refused(in("missing.ply")).find("missing.ply"), std::string::npos);
}

}  // namespace
}  // namespace palpate::experiments
