// Hostile arguments and inputs: each is answered with its exit status, one line that says what is wrong, and
// no results.
#include <gtest/gtest.h>
#include <sys/stat.h>

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
    write_text(folder_ / "points.ply",
               "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float "
               "z\nend_header\n0 0 0\n10 0 0\n0 10 0\n");
    write_text(folder_ / "utf16.csv", std::string("\xFF\xFEt\0_\0", 6));
    write_text(
        folder_ / "typo.toml",
        "[[model]]\ngenerate = \"plane\"\npoints = 441\n[renderer]\nname = \"cloud\"\nshadding = \"none\"\n");
    write_text(folder_ / "noise.toml",
               "[[model]]\ngenerate = \"plane\"\n[model.surface.texture]\nkind = \"noise\"\ndepth_mm = "
               "0.1\nwavelength_mm = 2\naxis = [1, 0, 0]\n");
    write_text(folder_ / "map.toml",
               "[[model]]\ngenerate = \"plane\"\npoints = 441\n[model.surface]\nfriction = { image = "
               "\"endless.pfm\", tile_mm = 20, low = 0.1, high = 0.8 }\n");
    // Names of every kind that lead to what has no end, or to nobody.
    for (const char* ending :
         {"ply", "png", "tif", "pcd", "asc", "zip", "xyz.gz", "csv", "traj", "toml", "pfm"})
      std::filesystem::create_symlink("/dev/zero", folder_ / (std::string("endless.") + ending));
    for (const char* ending : {"ply", "png", "csv", "toml"})
      ASSERT_EQ(::mkfifo(in(std::string("pipe.") + ending).c_str(), 0600), 0);
    std::filesystem::create_symlink(folder_ / "nowhere", folder_ / "dangling.ply");
    for (const char* ending : {"tif", "pcd", "ply"}) {
      write_text(folder_ / (std::string("hole.") + ending), "");
      std::error_code full;  // a file system may have no holes
      std::filesystem::resize_file(folder_ / (std::string("hole.") + ending), std::uint64_t{1} << 40, full);
    }
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
  EXPECT_LT(run.err.size(), 2000u) << "too much to be read";
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
        Case{"unknown_flag", {"info", kPlane, "--jsno"}, 2, "unknown option '--jsno'; did you mean --json?"},
        // What is missing because of it is not named in its stead.
        Case{"unknown_option_with_value",
             {"replay", kPlane, "--pth", "tap", "--out", "@/out"},
             2,
             "unknown option '--pth'; did you mean --path? `palpate replay --help`"},
        Case{"unknown_option_with_equals",
             {"replay", kPlane, "--pth=tap", "--out", "@/out"},
             2,
             "unknown option '--pth'; did you mean --path?"},
        Case{"single_dash", {"replay", kPlane, "-path", "tap", "--out", "@/out"}, 2, "did you mean --path?"},
        Case{"unknown_option_of_none",
             {"--vresion"},
             2,
             "unknown option '--vresion'; did you mean --version?"},
        Case{"no_model", {"info"}, 2, "MODEL"}, Case{"missing_file", {"info", "@/none.ply"}, 2, "none.ply"},
        Case{"folder_as_model", {"info", "@"}, 2, "palpate: error"},
        Case{"empty_ply", {"info", "@/empty.ply"}, 2, "empty.ply"},
        Case{"huge_ply", {"info", "@/huge.ply"}, 2, "huge.ply"},
        Case{"bad_unit", {"info", kPlane, "--unit", "furlong"}, 2, "furlong"},
        Case{"scale_negative",
             {"info", kPlane, "--scale", "-1"},
             2,
             "--scale: '-1' is not a number from 1e-12 to"},
        Case{"scale_zero", {"info", kPlane, "--scale=0"}, 2, "--scale: '0' is not a number from 1e-12 to"},
        Case{"scale_nan", {"info", kPlane, "--scale", "nan"}, 2, "--scale: 'nan' is not a finite number;"},
        Case{"scale_inf", {"info", kPlane, "--scale", "-inf"}, 2, "--scale: '-inf' is not a finite number;"},
        Case{"scale_huge",
             {"info", kPlane, "--scale", "1e999"},
             2,
             "--scale: '1e999' is not a finite number;"},
        Case{
            "scale_beyond", {"info", kPlane, "--scale", "1e300"}, 2, "--scale: '1e300' is not a number from"},
        Case{"renderers_empty",
             {"compare", kPlane, "--renderers", "", "--out", "@/out"},
             2,
             "--renderers: is empty"},
        Case{"out_empty", {"compare", kPlane, "--renderers", "cloud", "--out", ""}, 2, "--out: is empty"},
        Case{"model_empty", {"info", ""}, 2, "is empty"},
        Case{"scale_long",
             {"info", kPlane, "--scale", std::string(5000, '9') + "x"},
             2,
             "..' is not a number;"},
        Case{"scale_text", {"info", kPlane, "--scale", "big"}, 2, "--scale: 'big' is not a number;"},
        Case{"scale_comma", {"info", kPlane, "--scale", "1,5"}, 2, "--scale: '1,5' is not a number;"},
        Case{"post_nan", {"info", "@/points.ply", "--post-mm", "nan"}, 2, "--post-mm: 'nan' is not a finite"},
        Case{"vertical_nan",
             {"info", "@/points.ply", "--vertical-mm", "nan"},
             2,
             "--vertical-mm: 'nan' is not"},
        Case{"threads_nan",
             {"info", kPlane, "--threads", "nan"},
             2,
             "--threads: 'nan' is not a whole number;"},
        Case{"threads_many", {"info", kPlane, "--threads", "5000"}, 2, "whole number from 0 to 4096"},
        Case{"threads_hex",
             {"info", kPlane, "--threads", "0x2"},
             2,
             "--threads: '0x2' is not a whole number;"},
        Case{"memory_zero", {"info", kPlane, "--memory-limit-gb", "0"}, 2, "--memory-limit-gb: '0' is not"},
        Case{"mesh_limit_nan",
             {"reproduce", "--mesh-limit", "nan", "--out", "@/out"},
             2,
             "--mesh-limit: 'nan' is not a finite number"},
        Case{"paced_many",
             {"replay", kPlane, "--renderer", "cloud", "--path", "tap", "--out", "@/out", "--paced", "1e9"},
             2,
             "--paced: '1e9' is not a whole number"},
        Case{"size_limit_nan",
             {"fetch", "stanford-dragon", "--size-limit-gb", "nan"},
             2,
             "--size-limit-gb: 'nan'"},
        // Only regular files are read, whatever reads them.
        Case{
            "endless_ply", {"info", "@/endless.ply"}, 2, "endless.ply: this is a device, not a regular file"},
        Case{"endless_png", {"info", "@/endless.png"}, 2, "a device, not a regular file"},
        Case{"endless_tif", {"info", "@/endless.tif"}, 2, "a device, not a regular file"},
        Case{"endless_pcd", {"info", "@/endless.pcd"}, 2, "a device, not a regular file"},
        Case{"endless_asc", {"info", "@/endless.asc"}, 2, "a device, not a regular file"},
        Case{"endless_zip", {"info", "@/endless.zip"}, 2, "a device, not a regular file"},
        Case{"endless_gz", {"info", "@/endless.xyz.gz"}, 2, "a device, not a regular file"},
        Case{"endless_scene", {"info", "@/endless.toml"}, 2, "a device, not a regular file"},
        Case{"endless_image", {"info", "@/map.toml"}, 2, "endless.pfm: this is a device, not a regular file"},
        Case{"endless_path", replay(kPlane, "cloud", "@/endless.csv"), 2, "a device, not a regular file"},
        Case{"endless_traj", replay(kPlane, "cloud", "@/endless.traj"), 2, "a device, not a regular file"},
        Case{"pipe_ply", {"info", "@/pipe.ply"}, 2, "a pipe, not a regular file"},
        Case{"pipe_png", {"info", "@/pipe.png"}, 2, "a pipe, not a regular file"},
        Case{"pipe_scene", {"info", "@/pipe.toml"}, 2, "a pipe, not a regular file"},
        Case{"pipe_path", replay(kPlane, "cloud", "@/pipe.csv"), 2, "a pipe, not a regular file"},
        Case{"pipe_reference",
             {"replay", kPlane, "--renderer", "cloud", "--path", "tap", "--out", "@/out", "--reference",
              "@/pipe.ply"},
             2,
             "a pipe, not a regular file"},
        Case{"dangling_link", {"info", "@/dangling.ply"}, 2, "dangling.ply"},
        Case{"hole_tif", {"info", "@/hole.tif"}, 2, "hole.tif"},
        Case{"hole_pcd", {"info", "@/hole.pcd"}, 2, "hole.pcd"},
        Case{"hole_ply", {"info", "@/hole.ply"}, 2, "hole.ply"},
        Case{"over_the_limit", {"info", "@/huge.ply", "--memory-limit-gb", "2"}, 2, "huge.ply"},
        // Nothing is ignored in silence.
        Case{"post_of_a_ply",
             {"info", "@/points.ply", "--post-mm", "2"},
             2,
             "'post_mm' is of grids of heights"},
        Case{"vertical_of_a_ply",
             {"info", "@/points.ply", "--vertical-mm", "2"},
             2,
             "'vertical_mm' is of grids"},
        Case{"unit_of_a_generator", {"info", kPlane, "--unit", "m"}, 2, "--unit is of model files"},
        Case{"non_finite_of_a_generator",
             {"info", kPlane, "--non-finite", "refuse"},
             2,
             "--non-finite is of model files"},
        Case{"seed_without_jitter",
             {"info", kPlane + ":seed=7"},
             2,
             "option seed=7 does nothing with jitter=0"},
        Case{
            "mesh_of_a_jittered_plane", {"info", kPlane + ":jitter=0.3:mesh=true"}, 2, "no mesh can be made"},
        Case{"axis_of_noise", {"info", "@/noise.toml"}, 2, "noise.toml:7: 'axis' does nothing"},
        Case{"scenes_renderer", {"info", "@/typo.toml"}, 2, "typo.toml:4: cloud has no option 'shadding'"},
        Case{"scenes_renderer_though_another_runs", replay("@/typo.toml", "cloud", "tap"), 2,
             "typo.toml:4: cloud has no option 'shadding'; did you mean 'shading'?"},
        Case{"scenes_renderer_in_a_plan",
             {"plan", "@/typo.toml", "--renderer", "cloud"},
             2,
             "typo.toml:4: cloud has no option 'shadding'"},
        Case{"option_of_another_method", replay(kPlane, "cloud:box=per-vertex:box_mm=2", "tap"), 2,
             "option box_mm=2 does nothing with box=per-vertex"},
        Case{"step_option_of_another_method",
             {"clean", kPlane, "--steps", "smooth/method=bilateral/degree=3", "--out", "@/out.ply"},
             2,
             "option degree=3 does nothing with method=bilateral"},
        Case{"traj_rate_beside_times", replay(kPlane, "cloud", "@/a.traj:rate_hz=100"), 2,
             "option rate_hz=100 does nothing with t=0"},
        Case{"traj_time_unit_without_times",
             replay(kPlane, "cloud", "@/a.traj:t=-1:rate_hz=100:s_per_unit=0.001"), 2,
             "option s_per_unit=0.001 does nothing with t=-1"},
        Case{"fetch_nothing_by_force", {"fetch", "--force"}, 2, "no scan is named"},
        Case{"mesh_limit_without_meshes",
             {"reproduce", "--tables", "6", "--mesh-limit", "5", "--out", "@/out"},
             2,
             "do nothing"},
        Case{"quick_and_full", {"reproduce", "--quick", "--full", "--out", "@/out"}, 2, "--full"},
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
        Case{"path_utf16", replay(kPlane, "cloud", "@/utf16.csv"), 2,
             "utf16.csv:1: the text is UTF-16; save it as"},
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
             "announces 12 bytes"},
        Case{"fetch_special",
             {"fetch", "stanford-dragon", "--source", "file://@/pipe.ply"},
             1,
             "a pipe, not a regular file"},
        Case{"fetch_missing",
             {"fetch", "stanford-dragon", "--source", "file://@/nothing.ply.gz"},
             1,
             "could not be fetched"}),
    [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace palpate::experiments
