// `palpate clean`, clean= of a renderer, and a mesh file as the truth.
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include <palpate/generate.h>
#include <palpate/read_model.h>
#include "experiments/run/stage.h"
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
  std::size_t points_ = 0;
};

TEST_F(CleanCommand, WritesWhatIsLeft) {
  const json report = printed("clean @/scan.ply --steps outliers+smooth --out @/cleaned.ply --json");
  EXPECT_EQ(report["points_before"], points_);
  EXPECT_LE(report["points_after"], points_ - 20);
  ASSERT_EQ(report["steps"].size(), 2u);
  EXPECT_GT(report["steps"][1]["ms"], 0.0);
  EXPECT_EQ(printed("info @/cleaned.ply --json")["points"], report["points_after"]);
}

TEST_F(CleanCommand, WrongArgumentsLeaveNothingBehind) {
  for (const auto& [line, says] :
       {std::pair{"@/scan.ply --steps outlier --out @/out.ply", "did you mean 'outliers'"},
        {"@/scan.ply --steps smooth/neighbours=1 --out @/out.ply", "neighbours"},
        {"@/scan.ply --out @/out.ply", "nothing to do"},
        {"@/scan.ply --steps smooth", "--out"},
        {"@/none.ply --steps smooth --out @/out.ply", "none.ply"},
        {"@/scan.ply --steps outliers/distance=1e-6 --out @/out.ply", "every one"},
        {"@/scan.ply --steps thin --out @/nowhere/out.ply", "nowhere"}}) {
    refuses(says, "clean", line);
    EXPECT_FALSE(exists("out.ply"));
  }
}

TEST_F(CleanCommand, ARendererOnCleanedPointsIsNearerToTheTruth) {
  succeeds("compare @/scan.ply --reference @/truth.ply --path", kPath,
           "--renderers cloud,cloud:clean=outliers+smooth:label=cleaned --out @/out");
  const json document = json_in("out/result.json");
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
  const json one = json_in("out/result.json")["renderers"][0];
  EXPECT_EQ(one["prepare"]["phases"][0]["name"], "cleaning: outliers");
  EXPECT_LE(one["model"]["points"], points_ - 20);
  EXPECT_THAT(palpate("info @/scene.toml").out, HasSubstr("points removed"));
}

TEST_F(CleanCommand, AReferenceMustBeAMesh) {
  const Environment nowhere("PALPATE_DATA", in("nowhere").c_str()), cache("XDG_CACHE_HOME", in("no").c_str());
  for (const auto& [reference, says] : {std::pair{"@/scan.ply", "no faces"},
                                        {"analitic", "choose from auto"},
                                        {"stanford-bunny", "palpate fetch stanford-bunny"},
                                        {"@/missing.ply", "missing.ply"}})
    refuses(says, "compare @/scan.ply --renderers cloud --reference", reference, "--path", kPath,
            "--out @/out");
}

// ---- Scans with missing posts through every entry of the program: what `info` calls a height field, what
// the plan chooses and what is felt.

class HolesCommand : public OnCommandLine {
 protected:
  static constexpr int kSide = 60;

  /// A hill of 60 x 60 posts 0.5 mm apart, as columns of numbers, where `there` says so.
  template <class There>
  void write_hill(const std::string& name, const There& there) {
    std::string text;
    for (int row = 0; row < kSide; ++row)
      for (int column = 0; column < kSide; ++column)
        if (there(column, row))
          text += fmt::format("{} {} {}\n", 0.5 * column, 0.5 * row, hill(0.5 * column, 0.5 * row));
    write_text(folder_ / name, text);
  }
  static double hill(double x, double y) { return 2.0 * std::sin(0.2 * x) * std::sin(0.2 * y); }

  /// Taps at (x, y), one after the other, each from 1 mm above the hill to 0.5 mm below it.
  void write_taps(const std::string& name, const std::vector<std::pair<double, double>>& taps) {
    std::string text = "t_s,x_mm,y_mm,z_mm\n";
    int frame = 0;
    for (const auto& [x, y] : taps)
      for (const double over : {5.0, 1.0, 0.6, 0.3, 0.1, -0.1, -0.3, -0.5, -0.3, 0.1, 1.0, 5.0})
        text += fmt::format("{},{},{},{}\n", 0.001 * frame++, x, y, hill(x, y) + over);
    write_text(folder_ / name, text);
  }
  static constexpr std::size_t kTapFrames = 12, kDeepest = 7;

  json replayed(const std::vector<std::string>& arguments) {
    succeeds("compare --renderers auto", arguments, "--out @/out");
    return json_in("out/result.json")["renderers"][0];
  }
  /// In how many taps the deepest frame is felt.
  int felt_taps() {
    const std::string trace = text_in("out/trace.csv");
    int felt = 0;
    std::size_t row = 0, begin = trace.find('\n') + 1;
    for (; begin < trace.size(); ++row, begin = trace.find('\n', begin) + 1) {
      if (row % kTapFrames != kDeepest) continue;
      std::size_t comma = begin;
      for (int i = 0; i < 7; ++i) comma = trace.find(',', comma) + 1;
      felt += trace[comma] == '1';
    }
    return felt;
  }
};

bool is_gone(int column, int row, double share) {
  return Random(static_cast<std::uint64_t>(1000 * column + row)).uniform() < share;
}

TEST_F(HolesCommand, AThinnedSinusoidIsFelt) {
  if (all_cleaning().find("thin") == nullptr) GTEST_SKIP() << "cleaning needs the baselines";
  for (const char* cell : {"1.5", "4"}) {
    write_text(
        folder_ / "thin.toml",
        fmt::format("[[model]]\ngenerate = \"sinusoid\"\npoints = 10201\nextent_mm = 40\namplitude_mm = 1\n"
                    "wavelength_mm = 20\n  [[model.clean]]\n  step = \"thin\"\n  cell = {}\n",
                    cell));
    const json r = replayed({in("thin.toml"), "--path", "weave:frames=3000:depth_mm=0.5"});
    EXPECT_GT(r["frame"]["contact_frames"].get<int>(), 1500) << cell << " " << r["name"];
    EXPECT_LT(r["accuracy"]["force_rms_percent"].get<double>(), 10.0) << cell << " " << r["name"];
    EXPECT_EQ(r["accuracy"]["missed_contact_frames"], 0) << cell << " " << r["name"];
  }
}

TEST_F(HolesCommand, InfoPlanAndRenderersAgree) {
  for (const double share : {0.7, 0.92})
    write_hill(fmt::format("holes{}.xyz", share), [&](int c, int r) { return !is_gone(c, r, share); });
  int flat = 0;
  for (const std::string& model :
       {in("holes0.7.xyz"), in("holes0.92.xyz"), std::string("sinusoid:points=2601"),
        std::string("sinusoid:points=2601:jitter=0.3")}) {
    SCOPED_TRACE(model);
    const bool is_file = model.find(".xyz") != std::string::npos;
    const auto with_unit = [&](std::vector<std::string> arguments) {
      if (is_file) arguments.insert(arguments.end(), {"--unit", "mm"});
      return arguments;
    };
    const json info = printed(with_unit({"info", model, "--json"}));
    const json plan = printed(with_unit({"info", "plan", model, "--json"}));
    const bool is = info["height_field"].get<bool>();
    flat += is;
    EXPECT_EQ(plan["renderer"], is ? "heightfield" : "cloud-smooth");
    EXPECT_THAT(plan["decisions"][0]["reason"].get<std::string>(),
                HasSubstr(info["height_field_words"].get<std::string>()));
    EXPECT_EQ(info["lattice"].is_null(), !is);
    for (const char* renderer : {"heightfield", "heightfield-literal"}) {
      EXPECT_EQ(palpate(with_unit({"info", "plan", model, "--renderer", renderer})).exit_code, is ? 0 : 2);
      if (!is_file) continue;
      write_taps("taps.csv", {{10.0, 10.0}});
      const ProcessOutcome run =
          palpate("compare", model, "--unit mm --renderers", renderer, "--path @/taps.csv --out @/out");
      EXPECT_EQ(run.exit_code, is ? 0 : 1) << run.err;
      EXPECT_EQ(run.err.find("use the renderer cloud") == std::string::npos, is) << run.err;
    }
  }
  EXPECT_EQ(flat, 2);
}

TEST_F(HolesCommand, EveryTapOnAScanWithHolesIsFelt) {
  std::vector<std::pair<double, double>> taps;
  Random random(3);
  for (int i = 0; i < 30; ++i) taps.emplace_back(random.uniform(3.0, 26.0), random.uniform(3.0, 26.0));
  write_taps("taps.csv", taps);
  for (const double share : {0.05, 0.7}) {
    write_hill("scan.xyz", [&](int c, int r) { return !is_gone(c, r, share); });
    EXPECT_EQ(replayed({in("scan.xyz"), "--unit", "mm", "--path", in("taps.csv")})["name"], "heightfield");
    EXPECT_EQ(felt_taps(), 30) << share;
  }
}

TEST_F(HolesCommand, AGridsVoidsFollowTheSameRule) {
  const auto is_void = [](int c, int r) { return c >= 30 && c < 42 && r >= 10 && r < 22; };
  std::string grid = fmt::format("Pf\n{} {}\n-1.0\n", kSide, kSide);  // little-endian, rows from the south
  for (int row = 0; row < kSide; ++row)
    for (int column = 0; column < kSide; ++column) {
      const float height = is_void(column, row) || is_gone(column, row, 0.3)
                               ? std::numeric_limits<float>::quiet_NaN()
                               : static_cast<float>(hill(0.5 * column, 0.5 * row));
      const auto bytes = std::bit_cast<std::array<char, sizeof(float)>>(height);
      grid.append(bytes.begin(), bytes.end());
    }
  write_text(folder_ / "grid.pfm", grid);
  const std::vector<std::string> model = {in("grid.pfm"), "--post-mm", "0.5", "--vertical-mm", "1"};
  const json info = printed("info", model, "--json");
  ASSERT_TRUE(info["height_field"].get<bool>()) << info["height_field_words"];
  EXPECT_GT(info["lattice"]["filled"].get<int>(), 900);
  EXPECT_GT(info["lattice"]["open"].get<int>(), 100);
  EXPECT_GE(info["lattice"]["widest_hole"].get<int>(), 12);
  // Over the void nothing is felt, around it everything.
  write_taps("taps.csv", {{18.0, 8.0}, {8.1, 8.2}, {25.0, 8.0}, {18.0, 16.0}, {18.0, 3.1}});
  const json r = replayed(words(model, "--path", in("taps.csv")));
  EXPECT_EQ(r["name"], "heightfield");
  EXPECT_EQ(felt_taps(), 4);
  EXPECT_EQ(r["prepare"]["warnings"].size(), 1u) << r["prepare"]["warnings"];
  // Said before and after: that there is a void, and how often the HIP came under the surface through it.
  std::string text = "t_s,x_mm,y_mm,z_mm\n";
  for (int i = 0; i <= 20; ++i) text += fmt::format("{},18,8,{}\n", 0.001 * i, hill(18, 8) + 5.0 - 0.4 * i);
  for (int i = 1; i <= 20; ++i)
    text += fmt::format("{},{},8,{}\n", 0.02 + 0.001 * i, 18 - 0.5 * i, hill(18, 8) - 3.0);
  write_text(folder_ / "under.csv", text);
  const json under = replayed(words(model, "--path", in("under.csv")));
  EXPECT_EQ(under["frame"]["contact_frames"], 0);
  EXPECT_EQ(under["prepare"]["warnings"].size(), 2u) << under["prepare"]["warnings"];
}

}  // namespace
}  // namespace palpate::experiments
