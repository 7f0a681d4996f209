// The folder of results: whose it is, which files in it are ours, and what stays of an interrupted run.
#include "experiments/study/output_folder.h"

#include <gtest/gtest.h>

#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;
using Begun = OutputFolder::Begun;

class Folder : public InFolder {
 protected:
  OutputFolder open() const {
    const Result<OutputFolder> opened = OutputFolder::open(in("out"));
    EXPECT_TRUE(opened.ok()) << opened.error().message();
    return *opened;
  }
  OutputFolder begun(const std::string& key, Begun expected) const {
    const OutputFolder folder = open();
    const Result<Begun> how = folder.begin(key);
    EXPECT_TRUE(how.ok() && *how == expected);
    return folder;
  }
  bool there(const std::string& name) const { return fs::exists(fs::symlink_status(in("out/" + name))); }
  static bool take(const OutputFolder& folder, const std::string& part, const std::string& key,
                   const std::string& expected) {
    return folder.take_over(part, key, [&](const std::string& text) { return text == expected; });
  }
};

TEST_F(Folder, IsMadeAndKeptFromStrangers) {
  {
    const Result<OutputFolder> made = OutputFolder::open(in("a/b/"));
    ASSERT_TRUE(made.ok()) << made.error().message();
    ASSERT_TRUE(made->begin("k").ok() && made->write("result.json", "{}").ok() && made->complete().ok());
  }
  EXPECT_TRUE(OutputFolder::open(in("a/b")).ok());
  EXPECT_TRUE(fs::exists(in("a/b/result.json"))) << "nothing changes before a run begins";
  EXPECT_FALSE(OutputFolder::open(in("a")).ok()) << "a folder with somebody's files";
  EXPECT_TRUE(OutputFolder::open(in("a/b")).ok());
}

TEST_F(Folder, WithoutAResultIsAsItWas) {
  { const OutputFolder folder = open(); }
  EXPECT_FALSE(there("")) << "made for nothing";
  {
    const OutputFolder folder = begun("k", Begun::kAnew);
    ASSERT_TRUE(folder.write("result.json", "{}").ok());
  }
  EXPECT_FALSE(there("")) << "no part was complete";
}

TEST_F(Folder, IsForOneRunAtATime) {
  const OutputFolder first = open();
  const Result<OutputFolder> second = OutputFolder::open(in("out"));
  ASSERT_FALSE(second.ok());
  EXPECT_THAT(second.error().message(), HasSubstr("process " + std::to_string(::getpid())));
  EXPECT_EQ(second.error().file, in("out"));
  EXPECT_TRUE(there(kFolderMark)) << "the second one must not take the first one's folder away";
}

TEST_F(Folder, ANewRunRemovesOurFilesAndNoOthers) {
  {
    const OutputFolder folder = begun("k", Begun::kAnew);
    const Result<OutputFolder> figures = folder.inside("figures");
    ASSERT_TRUE(figures.ok() && figures->write("old.svg", "1").ok());
    ASSERT_TRUE(folder.write("trace-old.csv", "1").ok() && folder.write("both.csv", "1").ok());
    ASSERT_TRUE(folder.complete().ok());
  }
  write_text(in("out/notes.txt"), "years of work");
  const OutputFolder folder = begun("k", Begun::kAnew);
  EXPECT_FALSE(there("trace-old.csv"));
  EXPECT_FALSE(there("figures")) << "empty and ours";
  EXPECT_EQ(file_text(in("out/notes.txt")), "years of work");
  const Status onto = folder.write("notes.txt", "a result");
  ASSERT_FALSE(onto.ok());
  EXPECT_THAT(onto.error().message(), HasSubstr("Palpate did not write it"));
  EXPECT_TRUE(folder.write("both.csv", "2").ok() && folder.write("both.csv", "3").ok());
  EXPECT_EQ(file_text(in("out/both.csv")), "3");
  EXPECT_EQ(file_text(in("out/notes.txt")), "years of work");
}

TEST_F(Folder, TheMarkCannotPointOutOfTheFolder) {
  fs::create_directories(in("out"));
  write_text(in("precious"), "years of work");
  {
    const OutputFolder folder = begun("k", Begun::kAnew);
    ASSERT_TRUE(folder.write("a.csv", "1").ok() && folder.complete().ok());
  }
  std::ofstream(in("out/.palpate-output"), std::ios::app)
      << "file ../precious\nfile " << in("precious") << "\nfile \nfile .\nfile figures\n";
  fs::create_directories(in("out/figures/mine"));
  const OutputFolder folder = begun("k", Begun::kAnew);
  EXPECT_FALSE(there("a.csv"));
  EXPECT_TRUE(there("figures/mine"));
  EXPECT_EQ(file_text(in("precious")), "years of work");
}

TEST_F(Folder, PartsOfAnInterruptedRunAreTakenOver) {
  {
    const OutputFolder folder = begun("k", Begun::kAnew);
    ASSERT_TRUE(folder.write("result.json", "{}").ok());
    for (const char* part : {"a", "b", "c"}) {
      folder.start_part();
      ASSERT_TRUE(folder.write(std::string(part) + ".csv", part).ok() &&
                  folder.keep(part, "1", std::string("text of ") + part).ok());
    }
    ASSERT_TRUE(folder.write("half.csv", "half").ok());
  }
  write_text(in("out/c.csv"), "something else");
  const OutputFolder folder = begun("k", Begun::kGoesOn);
  ASSERT_TRUE(folder.write("result.json", "{1}").ok());
  EXPECT_TRUE(take(folder, "a", "1", "text of a"));
  EXPECT_FALSE(take(folder, "b", "2", "text of b")) << "another key";
  EXPECT_FALSE(take(folder, "b", "1", "another text")) << "of no use";
  EXPECT_FALSE(take(folder, "c", "1", "text of c")) << "its file has changed";
  EXPECT_FALSE(take(folder, "d", "1", "")) << "never kept";
  ASSERT_TRUE(folder.complete().ok());
  EXPECT_TRUE(there("a.csv"));
  for (const char* gone : {"b.csv", "c.csv", "half.csv", ".palpate-parts"}) EXPECT_FALSE(there(gone)) << gone;
}

TEST_F(Folder, ACompleteRunIsNotTakenOverAndAnotherOneIsDropped) {
  const auto run = [&](const char* key, Begun expected, bool complete) {
    const OutputFolder folder = begun(key, expected);
    EXPECT_FALSE(take(folder, "a", "1", "text") && expected != Begun::kGoesOn);
    EXPECT_TRUE(folder.write("a.csv", "1").ok() && folder.keep("a", "1", "text").ok());
    EXPECT_TRUE(!complete || folder.complete().ok());
  };
  run("k", Begun::kAnew, true);
  run("k", Begun::kAnew, false);
  run("k", Begun::kGoesOn, false);
  run("other", Begun::kOtherDropped, true);
}

TEST_F(Folder, AFileThatIsReadIsNotReplaced) {
  {
    const OutputFolder folder = begun("k", Begun::kAnew);
    ASSERT_TRUE(folder.write("trace.csv", "1").ok() && folder.complete().ok());
  }
  write_text(in("out/mine.csv"), "mine");
  fs::create_symlink(in("out/trace.csv"), in("link.csv"));
  const OutputFolder folder = open();
  EXPECT_TRUE(folder.check_not_read(std::vector<std::string>{in("out/mine.csv")}).ok());
  for (const std::string& read : {in("out/trace.csv"), in("link.csv"), in("out/../out/trace.csv")})
    EXPECT_FALSE(folder.check_not_read(std::vector<std::string>{read}).ok()) << read;
}

TEST_F(Folder, ThatAnOlderVersionMarkedIsOurs) {
  fs::create_directories(in("out"));
  write_text(in("out/.palpate-output"), "Results of Palpate: replaced by the next run with this folder.\n");
  write_text(in("out/result.json"), "{}");
  write_text(in("out/trace-a.csv"), "1");
  const OutputFolder folder = begun("k", Begun::kAnew);
  EXPECT_FALSE(there("result.json"));
  EXPECT_TRUE(folder.write("trace-a.csv", "2").ok()) << "it kept no list: what we write is taken for ours";
}

TEST_F(Folder, OpenedAgainKeepsWhatItDoesNotWrite) {
  EXPECT_FALSE(OutputFolder::reopen(in("out")).ok()) << "there is none";
  EXPECT_FALSE(fs::exists(in("out"))) << "and none is made";
  {
    const OutputFolder folder = begun("k", Begun::kAnew);
    ASSERT_TRUE(folder.write("result.json", "{}").ok() && folder.write("report.html", "old").ok());
    const Result<OutputFolder> inner = folder.inside("table7");
    ASSERT_TRUE(inner.ok() && inner->write("result.json", "{7}").ok() && folder.complete().ok());
  }
  write_text(in("out/mine.txt"), "not Palpate's");
  {
    const Result<OutputFolder> again = OutputFolder::reopen(in("out") + "/");
    ASSERT_TRUE(again.ok()) << again.error().message();
    EXPECT_FALSE(OutputFolder::reopen(in("out/table7")).ok()) << "locked as a whole";
    EXPECT_TRUE(again->write("report.html", "new").ok() && again->write("more.svg", "more").ok());
    EXPECT_FALSE(again->write("mine.txt", "taken").ok());
  }
  EXPECT_EQ(file_text(in("out/result.json")), "{}");
  EXPECT_EQ(file_text(in("out/report.html")), "new");
  {
    const Result<OutputFolder> table = OutputFolder::reopen(in("out/table7"));
    ASSERT_TRUE(table.ok()) << table.error().message();
    EXPECT_TRUE(table->write("result.json", "{8}").ok());
  }
  EXPECT_EQ(file_text(in("out/table7/result.json")), "{8}");
  EXPECT_EQ(file_text(in("out/result.json")), "{}");
  // The next run knows all of it, and takes it away.
  EXPECT_TRUE(begun("k", Begun::kAnew).complete().ok());
  EXPECT_FALSE(there("more.svg") || there("table7/result.json") || there("report.html"));
  EXPECT_TRUE(there("mine.txt"));
}

}  // namespace
}  // namespace palpate::experiments
