// Scans with missing posts through every entry of the program: what `info` calls a height field, what the
// plan chooses and what is felt.
#include <gtest/gtest.h>

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "experiments/run/cleaning.h"
#include "tests/experiments/program.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

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

  json run_json(const std::vector<std::string>& arguments) { return printed(arguments); }
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
  for (const char* cell : {"1.5", "2", "3", "4"}) {
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
  for (const double share : {0.05, 0.5, 0.7, 0.92})
    write_hill(fmt::format("holes{}.xyz", share), [&](int c, int r) { return !is_gone(c, r, share); });
  int flat = 0;
  for (const std::string& model :
       {in("holes0.05.xyz"), in("holes0.5.xyz"), in("holes0.7.xyz"), in("holes0.92.xyz"),
        std::string("sinusoid:points=2601"), std::string("sinusoid:points=2601:jitter=0.3"),
        std::string("sphere:points=1000")}) {
    SCOPED_TRACE(model);
    const bool is_file = model.find(".xyz") != std::string::npos;
    const auto with_unit = [&](std::vector<std::string> arguments) {
      if (is_file) arguments.insert(arguments.end(), {"--unit", "mm"});
      return arguments;
    };
    const json info = run_json(with_unit({"info", model, "--json"}));
    const json plan = run_json(with_unit({"info", "plan", model, "--json"}));
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
  EXPECT_EQ(flat, 4);
}

TEST_F(HolesCommand, EveryTapOnAScanWithHolesIsFelt) {
  std::vector<std::pair<double, double>> taps;
  Random random(3);
  for (int i = 0; i < 30; ++i) taps.emplace_back(random.uniform(3.0, 26.0), random.uniform(3.0, 26.0));
  write_taps("taps.csv", taps);
  for (const double share : {0.05, 0.3, 0.5, 0.7}) {
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
  std::vector<std::string> arguments = {"info"};
  arguments.insert(arguments.end(), model.begin(), model.end());
  arguments.push_back("--json");
  const json info = run_json(arguments);
  ASSERT_TRUE(info["height_field"].get<bool>()) << info["height_field_words"];
  EXPECT_GT(info["lattice"]["filled"].get<int>(), 900);
  EXPECT_GT(info["lattice"]["open"].get<int>(), 100);
  EXPECT_GE(info["lattice"]["widest_hole"].get<int>(), 12);
  // Over the void nothing is felt, around it everything.
  write_taps("taps.csv", {{18.0, 8.0}, {8.1, 8.2}, {25.0, 8.0}, {18.0, 16.0}, {18.0, 3.1}});
  arguments = model;
  arguments.insert(arguments.end(), {"--path", in("taps.csv")});
  const json r = replayed(arguments);
  EXPECT_EQ(r["name"], "heightfield");
  EXPECT_EQ(felt_taps(), 4);
  EXPECT_EQ(r["prepare"]["warnings"].size(), 1u) << r["prepare"]["warnings"];
  // Said before and after: that there is a void, and how often the HIP came under the surface through it.
  std::string text = "t_s,x_mm,y_mm,z_mm\n";
  for (int i = 0; i <= 20; ++i) text += fmt::format("{},18,8,{}\n", 0.001 * i, hill(18, 8) + 5.0 - 0.4 * i);
  for (int i = 1; i <= 20; ++i)
    text += fmt::format("{},{},8,{}\n", 0.02 + 0.001 * i, 18 - 0.5 * i, hill(18, 8) - 3.0);
  write_text(folder_ / "under.csv", text);
  arguments = model;
  arguments.insert(arguments.end(), {"--path", in("under.csv")});
  const json under = replayed(arguments);
  EXPECT_EQ(under["frame"]["contact_frames"], 0);
  EXPECT_EQ(under["prepare"]["warnings"].size(), 2u) << under["prepare"]["warnings"];
}

}  // namespace
}  // namespace palpate::experiments
