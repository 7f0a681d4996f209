// `palpate clean`, clean= of a renderer, and a mesh file as the truth.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include <palpate/generate.h>
#include <palpate/write_mesh.h>
#include "experiments/run/cleaning.h"
#include "tests/experiments/program.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const char* const kPath = "exploration:frames=3000:depth_mm=0.5:seed=1";

/// A sphere as a scanner sees it: noisy, with stray points; and its true mesh.
class CleanCommand : public OnCommandLine {
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
  const ProcessOutcome text = palpate("list steps");
  const json list = printed("list steps --json");
  ASSERT_EQ(list.size(), all_cleaning().all().size());
  for (const scene::CleaningStep& step : all_cleaning().all())
    for (const OptionSpec& option : step.options)
      EXPECT_THAT(text.out, HasSubstr(option.key + "=" + option.default_value)) << option.key;
}

TEST_F(CleanCommand, WritesWhatIsLeft) {
  const json report = printed("clean @/scan.ply --steps outliers+smooth --out @/cleaned.ply --json");
  EXPECT_EQ(report["points_before"], points_);
  EXPECT_LE(report["points_after"], points_ - 20);
  ASSERT_EQ(report["steps"].size(), 2u);
  EXPECT_GT(report["steps"][1]["ms"], 0.0);
  EXPECT_EQ(printed("info @/cleaned.ply --json")["points"], report["points_after"]);
}

TEST_F(CleanCommand, WrongArgumentsLeaveNothingBehind) {
  const auto refused = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "clean");
    const ProcessOutcome run = refuses({}, arguments);
    EXPECT_FALSE(exists("out.ply"));
    return run.err;
  };
  const std::string scan = in("scan.ply"), out = in("out.ply");
  EXPECT_THAT(refused({scan, "--steps", "outlier", "--out", out}), HasSubstr("did you mean 'outliers'"));
  EXPECT_THAT(refused({scan, "--steps", "smooth/neighbours=1", "--out", out}), HasSubstr("neighbours"));
  EXPECT_THAT(refused({scan, "--out", out}), HasSubstr("nothing to do"));
  EXPECT_THAT(refused({scan, "--steps", "smooth"}), HasSubstr("--out"));
  EXPECT_THAT(refused({in("none.ply"), "--steps", "smooth", "--out", out}), HasSubstr("none.ply"));
  EXPECT_THAT(refused({scan, "--steps", "outliers/distance=1e-6", "--out", out}), HasSubstr("every one"));
  EXPECT_THAT(refused({scan, "--steps", "thin", "--out", in("nowhere/out.ply")}), HasSubstr("nowhere"));
}

TEST_F(CleanCommand, ARendererOnCleanedPointsIsNearerToTheTruth) {
  succeeds("compare @/scan.ply --reference @/truth.ply --path", kPath,
           "--renderers cloud,cloud:clean=outliers+smooth:label=cleaned --out @/out");
  const json document = result("out");
  const json &raw = document["renderers"][0], &cleaned = document["renderers"][1];
  EXPECT_EQ(raw["model"]["points"], points_);
  EXPECT_LE(cleaned["model"]["points"], points_ - 20);
  EXPECT_EQ(cleaned["prepare"]["phases"][0]["name"], "cleaning: outliers");
  EXPECT_THAT(cleaned["options"]["clean"].get<std::string>(), HasSubstr("smooth/"));
  EXPECT_LT(cleaned["accuracy"]["force_rms_n"], 0.7 * raw["accuracy"]["force_rms_n"].get<double>());
  // What the result prints as an option can be given again.
  EXPECT_TRUE(all_cleaning().parse(cleaned["options"]["clean"].get<std::string>()).ok());
}

TEST_F(CleanCommand, CleaningOfTheSceneCountsAsPreparation) {
  std::ofstream(in("scene.toml"))
      << "[[model]]\ncloud = \"scan.ply\"\n  [[model.clean]]\n  step = \"outliers\"\n";
  succeeds("compare @/scene.toml --renderers cloud --reference @/truth.ply --path", kPath, "--out @/out");
  const json one = result("out")["renderers"][0];
  EXPECT_EQ(one["prepare"]["phases"][0]["name"], "cleaning: outliers");
  EXPECT_LE(one["model"]["points"], points_ - 20);
  EXPECT_THAT(palpate("info @/scene.toml").out, HasSubstr("points removed"));
}

TEST_F(CleanCommand, AReferenceMustBeAMesh) {
  const auto refused = [&](const std::string& reference) {
    const ProcessOutcome run = refuses({}, "compare @/scan.ply --renderers cloud --reference", reference,
                                       "--path", kPath, "--out @/out");
    return run.err;
  };
  EXPECT_THAT(refused(in("scan.ply")), HasSubstr("no faces"));
  EXPECT_THAT(refused("analitic"), HasSubstr("choose from auto"));
  const Environment nowhere("PALPATE_DATA", in("nowhere").c_str()), cache("XDG_CACHE_HOME", in("no").c_str());
  EXPECT_THAT(refused("stanford-bunny"), HasSubstr("palpate fetch stanford-bunny"));
  EXPECT_THAT(refused(in("missing.ply")), HasSubstr("missing.ply"));
}

}  // namespace
}  // namespace palpate::experiments
