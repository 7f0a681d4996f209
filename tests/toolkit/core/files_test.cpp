// Files that are whole or absent, and what is done when a program is stopped.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "tests/in_folder.h"
#include "toolkit/core/at_stop.h"
#include "toolkit/core/atomic_file.h"
#include "toolkit/core/locked_file.h"

namespace palpate {
namespace {

class Files : public InFolder {
 protected:
  std::string text(const std::string& name) const {
    std::ostringstream all;
    all << std::ifstream(in(name)).rdbuf();
    return all.str();
  }
  bool there(const std::string& name) const { return std::filesystem::exists(in(name)); }
};

TEST_F(Files, AppearWholeOrNotAtAll) {
  {
    Result<AtomicFile> file = AtomicFile::create(in("a"));
    ASSERT_TRUE(file.ok() && file->write("half").ok());
    EXPECT_FALSE(there("a"));
  }
  EXPECT_FALSE(there("a.part"));
  // What a writer that was killed has left is no part of the next one's file.
  std::ofstream(in("a.part")) << "left behind by a writer that was killed";
  ASSERT_TRUE(write_file(in("a"), "whole").ok());
  EXPECT_EQ(text("a"), "whole");
  EXPECT_FALSE(there("a.part"));
}

TEST_F(Files, ASecondWriterIsRefused) {
  Result<AtomicFile> first = AtomicFile::create(in("a"));
  ASSERT_TRUE(first.ok() && first->write("first").ok());
  const Status second = write_file(in("a"), "second");
  ASSERT_FALSE(second.ok());
  EXPECT_NE(second.error().message().find("another program is writing"), std::string::npos);
  ASSERT_TRUE(first->commit().ok());
  EXPECT_EQ(text("a"), "first");
  EXPECT_TRUE(write_file(in("a"), "second").ok());
}

TEST_F(Files, ALockIsOfTheFileThatHasTheName) {
  const Result<LockedFile> first = LockedFile::open(in("lock"));
  ASSERT_TRUE(first.ok() && first->held());
  Result<LockedFile> second = LockedFile::open(in("lock"));
  ASSERT_TRUE(second.ok());
  EXPECT_FALSE(second->held());
  std::filesystem::remove(in("lock"));
  {
    const Result<LockedFile> third = LockedFile::open(in("lock"));
    ASSERT_TRUE(third.ok() && third->held()) << "that of a file that is gone keeps nobody out";
  }
  EXPECT_TRUE(LockedFile::open(in("lock"))->held()) << "given back";
  EXPECT_FALSE(LockedFile::open(in("nowhere/lock")).ok());
}

/// What a stop does, in a process of its own: it ends there.
TEST_F(Files, AStopRunsWhatLivesTheNewestFirst) {
  const auto stop = [&] {
    const AtStop oldest([] { return std::string("three"); });
    AtStop moved;
    {
      AtStop dropped([] { return std::string("dropped"); });
      AtStop inner([] { return std::string("two"); });
      moved = std::move(inner);
    }
    const AtStop silent([] { return std::string(); });
    Result<AtomicFile> half = AtomicFile::create(in("half"));
    Result<AtomicFile> done = AtomicFile::create(in("done"));
    const AtStop newest([] { return std::string("one"); });
    const bool written = half->write("half").ok() && done->commit().ok();
    const std::string said = run_stop_actions();
    ::_exit(written && said == "one; two; three" ? 0 : 1);
  };
  EXPECT_EXIT(stop(), testing::ExitedWithCode(0), "");
  EXPECT_FALSE(there("half.part"));
  EXPECT_TRUE(there("done"));
}

}  // namespace
}  // namespace palpate
