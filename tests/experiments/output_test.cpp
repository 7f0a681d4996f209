// Files and folders that the user names to be written: never what is read, never somebody else's.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>

#include "experiments/command/subcommands.h"
#include "experiments/session/session.h"
#include "experiments/study/output_folder.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

const char* const kOutputScene = "sinusoid:points=2601:extent_mm=20:wavelength_mm=20:amplitude_mm=1:seed=1";
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
  std::string refused(std::vector<std::string> arguments) const {
    const ProcessOutcome run = refuses({}, std::move(arguments));
    return run.err;
  }
  std::vector<std::string> clean(const std::string& model, const std::string& out,
                                 const std::string& more = {}) const {
    std::vector<std::string> arguments = {"clean", model, "--steps", "outliers", "--out", out};
    if (!more.empty()) arguments.push_back(more);
    return arguments;
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
    EXPECT_THAT(refused(clean(scan, out)), HasSubstr("is read by this command")) << out;
    EXPECT_THAT(refused(clean(in("scene.toml"), out)), HasSubstr("is read by this command")) << out;
  }
  EXPECT_EQ(file_text(scan), before);
  succeeds(clean(scan, scan, "--force"));
  EXPECT_EQ(file_text(scan).substr(0, 20), "# written by palpate");
  succeeds("info", scan);
  // What was cleaned is read now, whoever wrote it.
  EXPECT_THAT(refused(clean(scan, scan)), HasSubstr("is read by this command"));
}

TEST_F(Output, CleaningReplacesItsOwnFilesAndNoOthers) {
  if (!has_cleaning()) GTEST_SKIP() << "built without cleaning";
  EXPECT_THAT(refused(clean(in("scan.csv"), in("precious.ply"))), HasSubstr("Palpate did not write it"));
  EXPECT_EQ(text_in("precious.ply"), "years of work");
  fs::create_directories(in("folder.ply"));
  EXPECT_THAT(refused(clean(in("scan.csv"), in("folder.ply"), "--force")), HasSubstr("not a plain file"));
  fs::create_symlink("/dev/null", in("device.ply"));
  EXPECT_THAT(refused(clean(in("scan.csv"), in("device.ply"), "--force")), HasSubstr("not a plain file"));
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
    const std::string err = refused(clean(in("scan.csv"), in(name)));
    EXPECT_THAT(err, HasSubstr(".ply, .xyz, .txt, .asc, .csv"));
    EXPECT_FALSE(exists(name));
  }
}

TEST_F(Output, AMeshIsNotSavedOntoTheScan) {
  if (!has_cleaning()) GTEST_SKIP() << "built without mesh-godobject";
  succeeds(clean(in("scan.csv"), in("scan.ply")));
  const std::string before = text_in("scan.ply");
  const auto save = [&](const std::string& mesh, const std::string& more) {
    std::vector<std::string> arguments = {
        "compare",   in("scan.ply"), "--renderers", "mesh-godobject", "--path",
        kOutputPath, "--out",        in("out"),     "--save-mesh",    mesh};
    if (!more.empty()) arguments.push_back(more);
    return arguments;
  };
  EXPECT_THAT(refused(save(in("scan.ply"), "")), HasSubstr("is read by this command"));
  EXPECT_THAT(refused(save(in("precious.ply"), "")), HasSubstr("Palpate did not write it"));
  EXPECT_THAT(refused(save(in("mesh.obj"), "")), HasSubstr(".ply"));
  EXPECT_THAT(refused(save(in("nowhere/mesh.ply"), "")), HasSubstr("nowhere"));
  EXPECT_EQ(text_in("scan.ply"), before);
  EXPECT_FALSE(exists("out")) << "found before anything was made";
}

TEST_F(Output, AResultThatIsReadIsNotReplaced) {
  const auto replay = [&](const std::string& path) {
    return std::vector<std::string>{"compare", kOutputScene, "--renderers", "cloud",
                                    "--path",  path,         "--out",       in("out")};
  };
  succeeds(replay(kOutputPath));
  // A path of one's own may stand there; a result may not be read.
  write_text(in("out/mine.csv"), "t_s,x_mm,y_mm,z_mm\n0,0,0,5\n0.001,0,0,5\n");
  succeeds(replay(in("out/mine.csv")));
  const std::string before = text_in("out/trace.csv");
  EXPECT_THAT(refused(replay(in("out/trace.csv"))), HasSubstr("out/trace.csv"));
  EXPECT_EQ(text_in("out/trace.csv"), before);
}

TEST_F(Output, ARerunLeavesNoOldTracesOrFigures) {
  const auto compare = [&](const std::string& renderers) {
    succeeds("compare", kOutputScene, "--renderers", renderers, "--path weave:frames=600 --out @/out");
  };
  compare("cloud,cloud-literal");
  EXPECT_TRUE(exists("out/trace-cloud-literal.csv"));
  write_text(in("out/notes.txt"), "mine");
  write_text(in("out/figures/sketch.svg"), "mine");
  compare("cloud,brute-force");
  EXPECT_FALSE(exists("out/trace-cloud-literal.csv"));
  EXPECT_TRUE(exists("out/trace-brute-force.csv"));
  EXPECT_TRUE(exists("out/figures/study-force.gp"));
  compare("cloud");
  EXPECT_FALSE(exists("out/trace-cloud.csv"));
  EXPECT_EQ(text_in("out/notes.txt"), "mine");
  EXPECT_EQ(text_in("out/figures/sketch.svg"), "mine");
}

TEST_F(Output, ASecondRunIntoTheSameFolderIsRefused) {
  apart_ = true;
  const Result<OutputFolder> ours = OutputFolder::open(in("out"));
  ASSERT_TRUE(ours.ok());
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"compare", kOutputScene, "--renderers", "cloud", "--path", kOutputPath},
        {"compare", kOutputScene, "--renderers", "cloud", "--path", kOutputPath},
        {"reproduce", "--tables", "7", "--quick"},
        {"test", "behaviours", "--only", "hovering", "--renderers", "cloud"}}) {
    std::vector<std::string> all = arguments;
    all.insert(all.end(), {"--out", in("out")});
    const std::string err = refused(all);
    EXPECT_THAT(err, HasAll(in("out"), "process " + std::to_string(::getpid())));
  }
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
  EXPECT_EQ(commands, 11);
}

// A session with a hand in contact goes on, stops its device and keeps what it wrote, whoever reads its
// messages.
TEST_F(Output, ASessionInContactOutlivesItsTerminal) {
  int number = 0;
  for (const char* const streams :
       {"2>&-", "2>/dev/full", "0<&- 2>&-", "1>&- 2>&-", "1>/dev/full 2>/dev/full"}) {
    const std::string out = in("live" + std::to_string(number++));
    const int status = status_with({"live", kOutputScene, "--device", "sim", "--seconds", "2", "--renderers",
                                    "cloud,analytic", "--switch-every", "1", "--accelerated", "--out", out},
                                   streams);
    EXPECT_EQ(status, std::string(streams).find("1>") == std::string::npos ? 0 : 1) << streams;
    const json live = json::parse(file_text(out + "/live.json"), nullptr, false);
    ASSERT_FALSE(live.is_discarded()) << streams;
    EXPECT_GT(live["ticks"], 1000) << streams;
    EXPECT_EQ(live["refused"], 0) << streams;
  }
}

}  // namespace
}  // namespace palpate::experiments
