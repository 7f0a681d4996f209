// Hostile arguments and inputs: each is answered with its exit status, one line that says what is wrong, and
// no results.
#include <gtest/gtest.h>

#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

struct Case {
  const char* name;
  std::vector<std::string> arguments;  ///< @ stands for the test's folder
  int status;
  const char* says;
};

class Hostile : public InFolder, public testing::WithParamInterface<Case> {
 protected:
  void SetUp() override {
    write_text(folder_ / "backwards.csv", "t_s,x_mm,y_mm,z_mm\n0,0,0,5\n0.001,0,0,5\n0.0005,0,0,5\n");
    write_text(folder_ / "inside.csv", "t_s,x_mm,y_mm,z_mm\n0,0,0,-1\n0.001,0,0,-1\n");
    write_text(folder_ / "nan.csv", "t_s,x_mm,y_mm,z_mm\n0,0,0,5\n0.001,nan,0,5\n");
    write_text(folder_ / "header.csv", "time,x,y,z\n0,0,0,5\n");
    write_text(folder_ / "empty.csv", "");
    write_text(folder_ / "good.csv", "t_s,x_mm,y_mm,z_mm\n0,0,0,5\n0.001,0,0,5\n");
    write_text(folder_ / "empty.ply", "");
    write_text(folder_ / "huge.ply",
               "ply\nformat binary_little_endian 1.0\nelement vertex 900000000000\nproperty float "
               "x\nproperty float y\nproperty float z\nend_header\n");
    write_text(folder_ / "bad.toml", "[[model]]\ngenerate = \"plane\"\nfriction = 0.5\n");
    write_text(folder_ / "a-file", "not a folder");
    std::filesystem::create_directories(folder_ / "foreign");
    write_text(folder_ / "foreign" / "thesis.doc", "years of work");
    std::filesystem::create_directories(folder_ / "cache");
  }
};

TEST_P(Hostile, IsAnsweredPlainly) {
  const Environment cache("XDG_CACHE_HOME", in("cache").c_str());
  const Environment data("PALPATE_DATA", nullptr);
  std::vector<std::string> arguments;
  for (std::string a : GetParam().arguments) {
    for (std::size_t at = a.find('@'); at != std::string::npos; at = a.find('@'))
      a.replace(at, 1, folder_.string());
    arguments.push_back(a);
  }
  const ProcessOutcome run = palpate_command(arguments);
  EXPECT_EQ(run.exit_code, GetParam().status) << run.out << run.err;
  EXPECT_NE(run.err.find(GetParam().says), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("palpate: "), std::string::npos) << run.err;
  EXPECT_EQ(run.err.find("terminate"), std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(in("out/result.json")));
  EXPECT_EQ(file_text(in("foreign/thesis.doc")), "years of work");
}

std::vector<std::string> replay(const std::string& scene, const std::string& renderer,
                                const std::string& path, const std::string& out = "@/out") {
  return {"replay", scene, "--renderer", renderer, "--path", path, "--out", out};
}
const std::string kPlane = "plane:points=441:extent_mm=20";

INSTANTIATE_TEST_SUITE_P(
    All, Hostile,
    testing::Values(
        Case{"no_command", {}, 2, "subcommand"}, Case{"unknown_command", {"reply"}, 2, "no command 'reply'"},
        Case{"unknown_flag", {"info", kPlane, "--jsno"}, 2, "--jsno"}, Case{"no_model", {"info"}, 2, "MODEL"},
        Case{"missing_file", {"info", "@/none.ply"}, 2, "none.ply"},
        Case{"folder_as_model", {"info", "@"}, 2, "palpate: error"},
        Case{"empty_ply", {"info", "@/empty.ply"}, 2, "empty.ply"},
        Case{"huge_ply", {"info", "@/huge.ply"}, 2, "huge.ply"},
        Case{"bad_unit", {"info", kPlane, "--unit", "furlong"}, 2, "furlong"},
        Case{"scale_negative", {"info", kPlane, "--scale", "-1"}, 2, "scale"},
        Case{"scale_text", {"info", kPlane, "--scale", "big"}, 2, "scale"},
        Case{"generator_option", {"info", "plane:pionts=9"}, 2, "pionts"},
        Case{"generator_too_many", {"info", "plane:points=99999999999"}, 2, "points"},
        Case{"scene_later_key", {"info", "@/bad.toml"}, 2, "bad.toml:3"},
        Case{"unknown_renderer", replay(kPlane, "cluod", "tap"), 2, "did you mean 'cloud'"},
        Case{"unknown_option", replay(kPlane, "cloud:shiny=1", "tap"), 2, "shiny"},
        Case{"bad_option_value", replay(kPlane, "cloud:shading=purple", "tap"), 2, "purple"},
        Case{"two_for_replay", replay(kPlane, "cloud,cloud-literal", "tap"), 2, "compare"},
        Case{"plan_renderer", {"plan", kPlane, "--renderer", "nonsense"}, 2, "no renderer"},
        Case{"same_label",
             {"compare", kPlane, "--renderers", "cloud,cloud", "--path", "tap", "--out", "@/out"},
             2,
             "label="},
        Case{"label_as_path",
             {"compare", kPlane, "--renderers", "cloud:label=../../x", "--path", "tap", "--out", "@/out"},
             2,
             "label"},
        Case{"empty_renderer",
             {"compare", kPlane, "--renderers", "cloud,", "--path", "tap", "--out", "@/out"},
             2,
             "name"},
        Case{"unknown_path", replay(kPlane, "cloud", "wave"), 2, "weave"},
        Case{"missing_path", replay(kPlane, "cloud", "@/none.csv"), 2, "none.csv"},
        Case{"path_backwards", replay(kPlane, "cloud", "@/backwards.csv"), 2, "backwards.csv:4"},
        Case{"path_inside", replay(kPlane, "cloud", "@/inside.csv"), 2, "inside.csv:2"},
        Case{"path_nan", replay(kPlane, "cloud", "@/nan.csv"), 2, "nan.csv:3"},
        Case{"path_header", replay(kPlane, "cloud", "@/header.csv"), 2, "header.csv:1"},
        Case{"path_empty", replay(kPlane, "cloud", "@/empty.csv"), 2, "empty.csv"},
        Case{"out_is_file", replay(kPlane, "cloud", "@/good.csv", "@/a-file"), 2, "a-file"},
        Case{"out_below_file", replay(kPlane, "cloud", "@/good.csv", "@/a-file/out"), 2, "a-file"},
        Case{"out_foreign", replay(kPlane, "cloud", "@/good.csv", "@/foreign"), 2, "not results of Palpate"},
        Case{"out_unwritable", replay(kPlane, "cloud", "@/good.csv", "/proc/palpate"), 2, "/proc/palpate"},
        Case{"reference_missing",
             {"replay", kPlane, "--renderer", "cloud", "--path", "tap", "--out", "@/out", "--reference",
              "oracle"},
             2,
             "reference"},
        Case{"paced_negative",
             {"replay", kPlane, "--renderer", "cloud", "--path", "tap", "--out", "@/out", "--paced", "-5"},
             2,
             "paced"},
        Case{"table_unknown", {"reproduce", "--tables", "6,99", "--out", "@/out"}, 2, "99"},
        Case{"table_text", {"reproduce", "--tables", "seven", "--out", "@/out"}, 2, "seven"},
        Case{"fetch_unknown", {"fetch", "stanford-dargon"}, 2, "stanford-dragon"},
        Case{"fetch_wrong_sum",
             {"fetch", "stanford-dragon", "--source", "file://@/a-file"},
             1,
             "checksum is wrong"},
        Case{"fetch_missing",
             {"fetch", "stanford-dragon", "--source", "file://@/nothing.ply.gz"},
             1,
             "could not be fetched"}),
    [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace palpate::experiments
