// The trial of the felt surface: what it prints and writes, on its smallest sets.

#include <nlohmann/json.hpp>
#include "tests/experiments/program.h"

#include "tests/files.h"
#include "toolkit/core/process.h"

namespace palpate::experiments {
namespace {

constexpr double kLimitS = 120.0;

class FeltSurface : public InFolder {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(PALPATE_FELT_SURFACE)) GTEST_SKIP() << "built without the benchmarks";
  }
  static ProcessOutcome run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), PALPATE_FELT_SURFACE);
    const Result<ProcessOutcome> done = run_process(arguments, {.time_limit_s = kLimitS});
    EXPECT_TRUE(done) << (done ? "" : done.error().message());
    return done ? *done : ProcessOutcome{};
  }
};

TEST_F(FeltSurface, ScoresAndSaysWhyNot) {
  const std::string file = (folder_ / "trial.json").string();
  const ProcessOutcome done =
      run({"--sets", "c5k,border", "--quick", "--frames", "2000", "--closed-paths", "3", "--json", file,
           "--renderers", "cloud,cloud:refine=1:label=fine,heightfield,nothing"});
  EXPECT_EQ(done.exit_code, 0) << done.err;
  const auto document = nlohmann::json::parse(file_text(file));
  ASSERT_EQ(document["rows"].size(), 8u);
  const auto row = [&](const std::string& label) -> nlohmann::json {
    for (const auto& one : document["rows"])
      if (one["label"] == label) return one;
    ADD_FAILURE() << "no row " << label;
    return {};
  };
  const auto cloud = row("c5k/cloud"), fine = row("c5k/fine");
  EXPECT_EQ(cloud["points"], 5000);
  EXPECT_GT(cloud["contact_frames"], 1000);
  EXPECT_GT(cloud["force_rms_percent"], 0.1);
  EXPECT_LT(cloud["force_rms_percent"], 30.0);
  // Nothing is caught behind a tube of 26 mm.
  EXPECT_NEAR(cloud["uncaught_rms_percent"], cloud["force_rms_percent"], 0.5);
  EXPECT_LT(cloud["median_error_n"], cloud["force_rms_n"]);
  EXPECT_LT(fine["force_rms_percent"], cloud["force_rms_percent"]);
  EXPECT_GE(fine["loops_generated_percent"], 0.0);
  EXPECT_GT(cloud["all_ns"], 0.0);
  EXPECT_GT(cloud["bytes_per_point"], 10.0);
  EXPECT_EQ(row("c5k/heightfield")["status"], "failed");
  EXPECT_FALSE(row("c5k/heightfield")["reason"].get<std::string>().empty()) << "a torus is no height field";
  EXPECT_THAT(row("c5k/nothing")["reason"].get<std::string>(), HasSubstr("no renderer of this name"));
  // Nothing is to be touched beside the sheet: what is felt there is told.
  EXPECT_EQ(row("border/cloud")["contact_frames"].get<int>() > 0,
            row("border/cloud")["free_force_n"].get<double>() > 0.0);
  EXPECT_THAT(done.out, HasSubstr("failed: "));
}

// Any generator is a set, a seed gives it other points and another path, and the worst places are told.
TEST_F(FeltSurface, TakesOtherSeedsAndSaysWhereItErrs) {
  const auto told = [&](const std::string& seed) {
    const std::string file = (folder_ / ("seed" + seed + ".json")).string();
    const ProcessOutcome done =
        run({"--sets", "torus:points=3000:noise=0.3:sampling=random", "--frames", "2000", "--closed-paths",
             "0", "--json", file, "--renderers", "cloud-smooth", "--seed", seed, "--where", "2"});
    EXPECT_EQ(done.exit_code, 0) << done.err;
    EXPECT_THAT(done.out, HasSubstr("% of the error; HIP ("));
    return nlohmann::json::parse(file_text(file))["rows"][0]["trace_hash"].get<std::string>();
  };
  const std::string first = told("1");
  EXPECT_EQ(told("1"), first);
  EXPECT_NE(told("2"), first);
  EXPECT_EQ(run({"--sets", "doughnut:points=3000"}).exit_code, 2);
  // What a generator is given already it is not given again, and what is wrong with it is said.
  const ProcessOutcome own =
      run({"--sets", "torus:points=3000:mesh=false:sampling=random:seed=7", "--frames", "500",
           "--closed-paths", "0", "--renderers", "cloud-smooth", "--seed", "1"});
  EXPECT_EQ(own.exit_code, 0) << own.err;
  const ProcessOutcome twice =
      run({"--sets", "torus:points=3000:points=4000", "--renderers", "cloud-smooth"});
  EXPECT_EQ(twice.exit_code, 2) << twice.err;
  EXPECT_THAT(twice.err, HasSubstr("points"));
}

TEST_F(FeltSurface, DrawsASlice) {
  const std::string file = (folder_ / "edge.svg").string();
  const ProcessOutcome done = run({"--slice", file, "--sets", "edge", "--renderers", "cloud"});
  EXPECT_EQ(done.exit_code, 0) << done.err;
  const std::string svg = file_text(file);
  EXPECT_EQ(svg.rfind("<svg", 0), 0u);
  for (const char* part : {"<circle", "<polyline", ">truth<", ">cloud<", "</svg>"})
    EXPECT_THAT(svg, HasSubstr(part)) << part;
}

TEST_F(FeltSurface, RefusesWhatItDoesNotKnow) {
  EXPECT_EQ(run({"--sets", "elll"}).exit_code, 2);
  EXPECT_THAT(run({"--sets", "elll"}).err, HasSubstr("choose from ell, rbox"));
  EXPECT_EQ(run({"--frames", "many"}).exit_code, 2);
  EXPECT_EQ(run({"--fast"}).exit_code, 2);
  EXPECT_EQ(run({"--renderers", ":a=1"}).exit_code, 2);
}

}  // namespace
}  // namespace palpate::experiments
