// Files and folders that the user names to be written: never what is read, never somebody else's.
#include <sys/stat.h>
#include <nlohmann/json.hpp>

#include <algorithm>

#include "experiments/command/subcommands.h"
#include "experiments/session/session.h"
#include "experiments/study/study.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

const char* const kOutputPath = "tap:frames=800";

class Output : public OnCommandLine {
 protected:
  void SetUp() override {
    std::string points = "x_mm,y_mm,z_mm,heat\n";
    for (int i = 0; i < 400; ++i)
      points += std::to_string(i % 20) + ".25," + std::to_string(i / 20) + "," + std::to_string(i % 7) +
                "e-3," + std::to_string(i) + "\n";
    write_text(in("scan.csv"), points);
    write_text(in("precious.ply"), "years of work");
  }
  template <class... More>
  Words clean(const std::string& model, const std::string& out, const More&... more) const {
    return words("clean", model, "--steps outliers --out", out, more...);
  }
  bool has_cleaning() const { return all_renderers().find("mesh-godobject") != nullptr; }
};

TEST_F(Output, CleaningNeverReplacesWhatItReads) {
  if (!has_cleaning()) GTEST_SKIP() << "built without cleaning";
  const std::string scan = in("scan.csv"), before = file_text(scan);
  fs::create_symlink(scan, in("link.csv"));
  fs::create_hard_link(scan, in("hard.csv"));
  write_text(in("scene.toml"), "[[model]]\ncloud = \"scan.csv\"\nunit = \"mm\"\n");
  for (const std::string& out :
       {scan, in("link.csv"), in("hard.csv"), in("../") + folder_.filename().string() + "/scan.csv"}) {
    refuses("is read by this command", clean(scan, out));
    refuses("is read by this command", clean(in("scene.toml"), out));
  }
  EXPECT_EQ(file_text(scan), before);
  succeeds(clean(scan, scan, "--force"));
  EXPECT_EQ(file_text(scan).substr(0, 20), "# written by palpate");
  succeeds("info", scan);
  // What was cleaned is read now, whoever wrote it.
  refuses("is read by this command", clean(scan, scan));
}

TEST_F(Output, CleaningReplacesItsOwnFilesAndNoOthers) {
  if (!has_cleaning()) GTEST_SKIP() << "built without cleaning";
  refuses("Palpate did not write it", clean(in("scan.csv"), in("precious.ply")));
  EXPECT_EQ(text_in("precious.ply"), "years of work");
  fs::create_directories(in("folder.ply"));
  refuses("not a plain file", clean(in("scan.csv"), in("folder.ply"), "--force"));
  fs::create_symlink("/dev/null", in("device.ply"));
  refuses("not a plain file", clean(in("scan.csv"), in("device.ply"), "--force"));
  for (int i = 0; i < 2; ++i) succeeds(clean(in("scan.csv"), in("new.ply")));
  succeeds(clean(in("scan.csv"), in("precious.ply"), "--force"));
  EXPECT_EQ(text_in("precious.ply").substr(0, 3), "ply");
}

TEST_F(Output, TheFormatGoesByTheEnding) {
  if (!has_cleaning()) GTEST_SKIP() << "built without cleaning";
  succeeds(clean(in("scan.csv"), in("new.ply")));
  const json expected = json::parse(palpate("info @/new.ply --json").out);
  for (const char* name : {"new.xyz", "new.txt", "new.asc", "new.CSV"}) {
    ASSERT_EQ(palpate(clean(in("scan.csv"), in(name))).exit_code, 0) << name;
    EXPECT_NE(text_in(name).substr(0, 3), "ply") << name;
    const json info = json::parse(palpate("info", in(name), "--json").out);
    for (const char* key : {"content_hash", "points", "unit", "unit_guessed", "box_mm"})
      EXPECT_EQ(info[key], expected[key]) << name << " " << key;
  }
  for (const char* name : {"new.stl", "new.ply.gz", "new", "new.pcd"}) {
    refuses(".ply, .xyz, .txt, .asc, .csv", clean(in("scan.csv"), in(name)));
    EXPECT_FALSE(exists(name));
  }
}

TEST_F(Output, AMeshIsNotSavedOntoTheScan) {
  if (!has_cleaning()) GTEST_SKIP() << "built without mesh-godobject";
  succeeds(clean(in("scan.csv"), in("scan.ply")));
  const std::string before = text_in("scan.ply");
  for (const auto& [mesh, says] : {std::pair{"scan.ply", "is read by this command"},
                                   {"precious.ply", "Palpate did not write it"},
                                   {"mesh.obj", ".ply"},
                                   {"nowhere/mesh.ply", "nowhere"}})
    refuses(says, "compare @/scan.ply --renderers mesh-godobject --path", kOutputPath,
            "--out @/out --save-mesh", in(mesh));
  EXPECT_EQ(text_in("scan.ply"), before);
  EXPECT_FALSE(exists("out")) << "found before anything was made";
}

TEST_F(Output, AResultThatIsReadIsNotReplaced) {
  const auto replay = [&](const std::string& path) {
    return words("compare", kTinyWaves, "--renderers cloud --path", path, "--out @/out");
  };
  succeeds(replay(kOutputPath));
  // A path of one's own may stand there; a result may not be read.
  write_text(in("out/mine.csv"), "t_s,x_mm,y_mm,z_mm\n0,0,0,5\n0.001,0,0,5\n");
  succeeds(replay(in("out/mine.csv")));
  const std::string before = text_in("out/trace.csv");
  refuses("out/trace.csv", replay(in("out/trace.csv")));
  EXPECT_EQ(text_in("out/trace.csv"), before);
}

TEST_F(Output, ASecondRunIntoTheSameFolderIsRefused) {
  apart_ = true;
  const Result<OutputFolder> ours = OutputFolder::open(in("out"));
  ASSERT_TRUE(ours.ok());
  for (const Words& line :
       {words("compare", kTinyWaves, "--renderers cloud --path", kOutputPath),
        words("reproduce --tables 7 --quick"), words("test behaviours --only hovering --renderers cloud")})
    refuses({in("out"), "process " + std::to_string(::getpid())}, line, "--out @/out");
}

/// The exit status of the program with its standard streams redirected by a shell, as ">&-" or "2>/dev/full";
/// 128 and the signal where one ended it.
int status_with(const std::vector<std::string>& arguments, const std::string& streams) {
  std::string line = "'" PALPATE_PROGRAM "'";
  for (const std::string& one : arguments) line += " '" + one + "'";
  const int status = std::system(("{ " + line + "; } >/dev/null 2>/dev/null " + streams).c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

// A message that cannot be written is dropped, a result that cannot be is an error: of no command more comes
// of it.
TEST_F(Output, NoStandardStreamThatFailsEndsACommandOtherwise) {
  int commands = 0;
  for (const Verb& verb : kVerbs) {
    const std::string name = verb.name;
    ++commands;
    const std::vector<std::string> help = {name, "--help"}, wrong = {name, "--no-such-option"};
    // One place prints for all: the first command meets every stream, the others the worst of each kind.
    const bool first = commands == 1;
    for (const char* const streams : {"0<&- 2>&-", "", "0<&-", "2>&-", "2>/dev/full"}) {
      EXPECT_EQ(status_with(help, streams), 0) << name << " " << streams;
      EXPECT_EQ(status_with(wrong, streams), 2) << name << " " << streams;
      if (!first) break;
    }
    for (const char* const streams : {"1>/dev/full 2>/dev/full", "1>&-", "1>/dev/full", "0<&- 1>&- 2>&-"}) {
      EXPECT_EQ(status_with(help, streams), 1) << name << " " << streams;
      if (!first) break;
    }
  }
  EXPECT_EQ(commands, 12);
}

// A session with a hand in contact goes on, stops its device and keeps what it wrote, whoever reads its
// messages.
TEST_F(Output, ASessionInContactOutlivesItsTerminal) {
  int number = 0;
  for (const char* const streams : {"0<&- 2>&-", "2>/dev/full", "1>/dev/full 2>/dev/full"}) {
    const std::string out = in("live" + std::to_string(number++));
    const int status = status_with(
        words("live", kTinyWaves,
              "--device sim --seconds 2 --renderers cloud,analytic --switch-every 1 --accelerated --out",
              out),
        streams);
    EXPECT_EQ(status, std::string(streams).find("1>") == std::string::npos ? 0 : 1) << streams;
    const json live = json::parse(file_text(out + "/live.json"), nullptr, false);
    ASSERT_FALSE(live.is_discarded()) << streams;
    EXPECT_GT(live["ticks"], 1000) << streams;
    EXPECT_EQ(live["refused"], 0) << streams;
  }
}

// ---- Hostile arguments and inputs: each is answered with its exit status, one line that says what is wrong,
// and no results.

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
      {"unknown_kind", "list rendrers", "did you mean 'renderers'?"},
      {"unknown_option_of_generator", "info sinusoid:pionts=100", "did you mean 'points'?"},
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
