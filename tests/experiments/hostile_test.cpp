// Hostile arguments and inputs: each is answered with its exit status, one line that says what is wrong, and
// no results.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>

#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

struct Case {
  const char* name;
  std::string line;  ///< '@' stands for the test's folder, '%' for a small plane, '' for an empty word
  const char* says;
  int status = 2;
};

class Hostile : public OnCommandLine, public testing::WithParamInterface<Case> {
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
    write_text(folder_ / "typo.toml",
               "[[model]]\ngenerate = \"plane\"\npoints = 441\n[renderer]\nname = \"cloud\"\nrefinne = 1\n");
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
  std::string line = GetParam().line;
  for (std::size_t at = line.find('%'); at != std::string::npos; at = line.find('%'))
    line.replace(at, 1, "plane:points=441:extent_mm=20");
  Words all = words(line.c_str());
  std::replace(all.begin(), all.end(), std::string("''"), std::string());
  const ProcessOutcome run = palpate(all);
  EXPECT_EQ(run.exit_code, GetParam().status) << run.out << run.err;
  EXPECT_THAT(run.err, HasAll(GetParam().says, "palpate: "));
  EXPECT_THAT(run.err, Not(HasSubstr("terminate")));
  EXPECT_LT(run.err.size(), 2000u) << "too much to be read";
  EXPECT_FALSE(exists("out/result.json"));
  EXPECT_EQ(text_in("foreign/thesis.doc"), "years of work");
}

const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
      {"no_command", "", "a command is missing"},
      {"unknown_command", "reply", "no command 'reply'"},
      {"unknown_flag", "info % --jsno", "unknown option '--jsno'; did you mean --json?"},
      // What is missing because of it is not named in its stead.
      {"unknown_option_with_value", "compare % --pth tap --out @/out --renderers auto",
       "unknown option '--pth'; did you mean --path? `palpate compare --help`"},
      {"unknown_option_with_equals", "compare % --pth=tap --out @/out --renderers auto",
       "unknown option '--pth'; did you mean --path?"},
      {"single_dash", "compare % -path tap --out @/out --renderers auto", "did you mean --path?"},
      {"empty_path", "compare % --renderers cloud --path '' --out @/out", "--path"},
      {"unknown_option_of_none", "--vresion", "unknown option '--vresion'; did you mean '--version'?"},
      {"no_model", "info", "MODEL"},
      {"missing_file", "info @/none.ply", "none.ply"},
      {"folder_as_model", "info @", "palpate: error"},
      {"empty_ply", "info @/empty.ply", "empty.ply"},
      {"huge_ply", "info @/huge.ply", "huge.ply"},
      {"bad_unit", "info % --unit furlong", "furlong"},
      {"scale_negative", "info % --scale -1", "--scale: '-1' is not a number from 1e-12 to"},
      {"scale_zero", "info % --scale=0", "--scale: '0' is not a number from 1e-12 to"},
      {"scale_nan", "info % --scale nan", "--scale: 'nan' is not a finite number;"},
      {"scale_inf", "info % --scale -inf", "--scale: '-inf' is not a finite number;"},
      {"scale_huge", "info % --scale 1e999", "--scale: '1e999' is not a finite number;"},
      {"scale_beyond", "info % --scale 1e300", "--scale: '1e300' is not a number from"},
      {"renderers_empty", "compare % --renderers '' --out @/out", "--renderers: is empty"},
      {"out_empty", "compare % --renderers cloud --out ''", "--out: is empty"},
      {"model_empty", "info ''", "is empty"},
      {"scale_long", "info % --scale " + std::string(5000, '9') + "x", "..' is not a number;"},
      {"scale_text", "info % --scale big", "--scale: 'big' is not a number;"},
      {"scale_comma", "info % --scale 1,5", "--scale: '1,5' is not a number;"},
      {"post_nan", "info @/points.ply --post-mm nan", "--post-mm: 'nan' is not a finite"},
      {"vertical_nan", "info @/points.ply --vertical-mm nan", "--vertical-mm: 'nan' is not"},
      {"threads_nan", "info % --threads nan", "--threads: 'nan' is not a whole number;"},
      {"threads_many", "info % --threads 5000", "whole number from 0 to 4096"},
      {"threads_hex", "info % --threads 0x2", "--threads: '0x2' is not a whole number;"},
      {"memory_zero", "info % --memory-limit-gb 0", "--memory-limit-gb: '0' is not"},
      {"mesh_limit_nan", "reproduce --mesh-limit nan --out @/out",
       "--mesh-limit: 'nan' is not a finite number"},
      {"paced_many", "compare % --renderers cloud --path tap --out @/out --paced 1e9",
       "--paced: '1e9' is not a whole number"},
      {"size_limit_nan", "fetch stanford-dragon --size-limit-gb nan", "--size-limit-gb: 'nan'"},
      // Only regular files are read, whatever reads them.
      {"endless_ply", "info @/endless.ply", "endless.ply: this is a device, not a regular file"},
      {"endless_png", "info @/endless.png", "a device, not a regular file"},
      {"endless_tif", "info @/endless.tif", "a device, not a regular file"},
      {"endless_pcd", "info @/endless.pcd", "a device, not a regular file"},
      {"endless_asc", "info @/endless.asc", "a device, not a regular file"},
      {"endless_zip", "info @/endless.zip", "a device, not a regular file"},
      {"endless_gz", "info @/endless.xyz.gz", "a device, not a regular file"},
      {"endless_scene", "info @/endless.toml", "a device, not a regular file"},
      {"endless_image", "info @/map.toml", "endless.pfm: this is a device, not a regular file"},
      {"endless_path", "compare % --renderers cloud --path @/endless.csv --out @/out",
       "a device, not a regular file"},
      {"endless_traj", "compare % --renderers cloud --path @/endless.traj --out @/out",
       "a device, not a regular file"},
      {"pipe_ply", "info @/pipe.ply", "a pipe, not a regular file"},
      {"pipe_png", "info @/pipe.png", "a pipe, not a regular file"},
      {"pipe_scene", "info @/pipe.toml", "a pipe, not a regular file"},
      {"pipe_path", "compare % --renderers cloud --path @/pipe.csv --out @/out",
       "a pipe, not a regular file"},
      {"pipe_reference", "compare % --renderers cloud --path tap --out @/out --reference @/pipe.ply",
       "a pipe, not a regular file"},
      {"dangling_link", "info @/dangling.ply", "dangling.ply"},
      {"hole_tif", "info @/hole.tif", "hole.tif"},
      {"hole_pcd", "info @/hole.pcd", "hole.pcd"},
      {"hole_ply", "info @/hole.ply", "hole.ply"},
      {"over_the_limit", "info @/huge.ply --memory-limit-gb 2", "huge.ply"},
      // Nothing is ignored in silence.
      {"post_of_a_ply", "info @/points.ply --post-mm 2", "'post_mm' is of grids of heights"},
      {"vertical_of_a_ply", "info @/points.ply --vertical-mm 2", "'vertical_mm' is of grids"},
      {"unit_of_a_generator", "info % --unit m", "--unit is of model files"},
      {"non_finite_of_a_generator", "info % --non-finite refuse", "--non-finite is of model files"},
      {"seed_without_jitter", "info %:seed=7", "option seed=7 does nothing with jitter=0"},
      {"mesh_of_a_jittered_plane", "info %:jitter=0.3:mesh=true", "no mesh can be made"},
      {"axis_of_noise", "info @/noise.toml", "noise.toml:7: 'axis' does nothing"},
      {"scenes_renderer", "info @/typo.toml", "typo.toml:4: cloud has no option 'refinne'"},
      {"scenes_renderer_though_another_runs", "compare @/typo.toml --renderers cloud --path tap --out @/out",
       "typo.toml:4: cloud has no option 'refinne'; did you mean 'refine'?"},
      {"scenes_renderer_in_a_plan", "info plan @/typo.toml --renderer cloud",
       "typo.toml:4: cloud has no option 'refinne'"},
      {"option_of_another_method",
       "compare % --renderers cloud-vertices:box=per-vertex:box_mm=2 --path tap --out @/out",
       "option box_mm=2 does nothing with box=per-vertex"},
      {"step_option_of_another_method", "clean % --steps smooth/method=bilateral/degree=3 --out @/out.ply",
       "option degree=3 does nothing with method=bilateral"},
      {"traj_rate_beside_times", "compare % --renderers cloud --path @/a.traj:rate_hz=100 --out @/out",
       "option rate_hz=100 does nothing with t=0"},
      {"traj_time_unit_without_times",
       "compare % --renderers cloud --path @/a.traj:t=-1:rate_hz=100:s_per_unit=0.001 --out @/out",
       "option s_per_unit=0.001 does nothing with t=-1"},
      {"fetch_nothing_by_force", "fetch --force", "NAME is required"},
      {"mesh_limit_without_meshes", "reproduce --tables 6 --mesh-limit 5 --out @/out", "do nothing"},
      {"quick_and_full", "reproduce --quick --full --out @/out", "--full"},
      {"generator_option", "info plane:pionts=9", "pionts"},
      {"generator_too_many", "info plane:points=99999999999", "points"},
      {"scene_later_key", "info @/bad.toml", "bad.toml:3"},
      {"unknown_renderer", "compare % --renderers cluod --path tap --out @/out", "did you mean 'cloud'"},
      {"unknown_option", "compare % --renderers cloud:shiny=1 --path tap --out @/out", "shiny"},
      {"bad_option_value", "compare % --renderers cloud-literal:shading=purple --path tap --out @/out",
       "purple"},
      {"plan_renderer", "info plan % --renderer nonsense", "no renderer"},
      {"same_label", "compare % --renderers cloud,cloud --path tap --out @/out", "label="},
      {"label_as_path", "compare % --renderers cloud:label=../../x --path tap --out @/out", "label"},
      {"empty_renderer", "compare % --renderers cloud, --path tap --out @/out", "name"},
      {"unknown_path", "compare % --renderers cloud --path wave --out @/out", "weave"},
      {"missing_path", "compare % --renderers cloud --path @/none.csv --out @/out", "none.csv"},
      {"path_backwards", "compare % --renderers cloud --path @/backwards.csv --out @/out", "backwards.csv:4"},
      {"path_inside", "compare % --renderers cloud --path @/inside.csv --out @/out", "inside.csv:2"},
      {"path_nan", "compare % --renderers cloud --path @/nan.csv --out @/out", "nan.csv:3"},
      {"path_utf16", "compare % --renderers cloud --path @/utf16.csv --out @/out",
       "utf16.csv:1: the text is UTF-16; save it as"},
      {"path_header", "compare % --renderers cloud --path @/header.csv --out @/out", "header.csv:1"},
      {"path_empty", "compare % --renderers cloud --path @/empty.csv --out @/out", "empty.csv"},
      {"out_is_file", "compare % --renderers cloud --path @/good.csv --out @/a-file", "a-file"},
      {"out_below_file", "compare % --renderers cloud --path @/good.csv --out @/a-file/out", "a-file"},
      {"out_foreign", "compare % --renderers cloud --path @/good.csv --out @/foreign",
       "not results of Palpate"},
      {"out_unwritable", "compare % --renderers cloud --path @/good.csv --out /proc/palpate",
       "/proc/palpate"},
      {"reference_missing", "compare % --renderers cloud --path tap --out @/out --reference oracle",
       "reference"},
      {"paced_negative", "compare % --renderers cloud --path tap --out @/out --paced -5", "paced"},
      {"table_unknown", "reproduce --tables 6,99 --out @/out", "99"},
      {"table_text", "reproduce --tables seven --out @/out", "seven"},
      {"fetch_unknown", "fetch stanford-dargon", "stanford-dragon"},
      {"fetch_wrong_sum", "fetch stanford-dragon --source file://@/a-file", "announces 12 bytes", 1},
      {"fetch_special", "fetch stanford-dragon --source file://@/pipe.ply", "a pipe, not a regular file", 1},
      {"fetch_missing", "fetch stanford-dragon --source file://@/nothing.ply.gz", "could not be fetched", 1},
  };
  return all;
}

INSTANTIATE_TEST_SUITE_P(All, Hostile, testing::ValuesIn(cases()),
                         [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace palpate::experiments
