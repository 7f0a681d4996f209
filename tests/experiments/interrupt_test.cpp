// What happens when the program is told to stop: at once, with what is complete, and the next run goes on.
#include <sys/stat.h>

#include <array>
#include <map>
#include <nlohmann/json.hpp>

#include "experiments/session/session.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

constexpr int kInterrupted = 130, kTerminated = 143;
// Minutes of work for brute-force, and hardly any for the others.
const char* const kLargeScene = "sinusoid:points=160801";
const char* const kLongPath = "weave:frames=8000:depth_mm=1:seed=1";
// Minutes of work each, of which no test waits for the end.
const char* const kEndlessPath = "weave:frames=3000000:depth_mm=0.5:seed=1";
const char* const kEndlessExploration = "exploration:frames=5000000:depth_mm=0.5:seed=1";

class Interrupt : public OnCommandLine {
 protected:
  Interrupt() { apart_ = true; }  // only the same program goes on
  json result(const std::string& out = "out") const { return json_in(out + "/result.json"); }
  std::map<std::string, std::string> hashes(const std::string& out) const {
    std::map<std::string, std::string> all;
    const json document = result(out);
    for (const json& r : document["renderers"]) all[r["label"]] = r["trace_hash"].get<std::string>();
    return all;
  }
  std::vector<std::string> compare(const std::string& renderers, const std::string& out = "out",
                                   const std::string& path = kTinyWeave,
                                   const std::string& scene = kTinyWaves) const {
    return {"compare", scene, "--renderers", renderers, "--path", path, "--out", in(out)};
  }
  /// A file that is half written, or that only an unfinished run needs.
  bool something_left_over(const std::string& out = "out") const {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(in(out)))
      if (entry.path().extension() == ".part" || entry.path().filename() == ".palpate-parts") return true;
    return false;
  }
  /// A program that starts another one, notes its number and takes its time.
  void make_idle_program(const std::string& name) const {
    std::filesystem::create_directories(folder_ / "bin");
    const std::string file = in("bin/" + name), pid = in("pid");
    write_text(file, "#!/bin/sh\nsleep 600 &\necho $! > '" + pid + ".new'\nmv '" + pid + ".new' '" + pid +
                         "'\nwait\n");
    ::chmod(file.c_str(), 0755);
  }
  bool idle_runs() const {
    std::string pid = text_in("pid");
    if (pid.empty()) return false;
    pid.pop_back();
    // Ended ones may wait for an init that does not come for them.
    const std::string state = file_text("/proc/" + pid + "/stat");
    return !state.empty() && state.find(") Z") == std::string::npos;
  }
  /// Starts the line, sends it the signal once `seen` comes true, and checks how it ends. What it says.
  std::string stopped(const Words& line, const std::function<bool()>& seen, int signal = SIGINT) const {
    Started run(folder_, line);
    EXPECT_TRUE(run.wait_for(seen)) << run.err();
    run.send(signal);
    EXPECT_EQ(run.end(), kSignalBase + signal) << run.err();
    EXPECT_FALSE(run.killed());
    return run.err();
  }
  /// Whether a part of the unfinished run in "out" is complete.
  std::function<bool()> is_kept(const std::string& part) const {
    return [this, part] { return !text_in("out/.palpate-parts/" + part).empty(); };
  }
  bool idle_ends() const {
    constexpr int kTimes = 1000;
    for (int i = 0; i < kTimes && idle_runs(); ++i) ::usleep(10'000);
    return !idle_runs();
  }
};

TEST_F(Interrupt, WhatIsCompleteIsKeptAndTheNextRunGoesOn) {
  const std::string said =
      stopped(compare("cloud,brute-force", "out", kLongPath, kLargeScene), is_kept("cloud"));
  EXPECT_THAT(said, HasSubstr("complete and kept in " + in("out") + ": cloud;"));
  const json document = result();
  EXPECT_FALSE(document["complete"]);
  ASSERT_EQ(document["renderers"].size(), 2u);
  EXPECT_EQ(document["renderers"][0]["status"], "ok");
  EXPECT_EQ(document["renderers"][1]["status"], "did-not-finish");
  EXPECT_THAT(document["renderers"][1]["reason"].get<std::string>(), HasSubstr("interrupted"));
  EXPECT_TRUE(exists("out/trace-cloud.csv"));
  EXPECT_FALSE(exists("out/report.html"));
  // A renderer more, one less: what is complete stays, and nothing of it is measured again.
  EXPECT_THAT(succeeds(compare("cloud-literal,cloud", "out", kLongPath, kLargeScene)).err,
              HasAll("going on from an interrupted run",
                     "Finished by an earlier run, which was interrupted: cloud."));
  const json whole = result();
  EXPECT_TRUE(whole["complete"]);
  EXPECT_EQ(whole["renderers"][1], document["renderers"][0]);
  EXPECT_EQ(whole["renderers"][0]["status"], "ok");
  EXPECT_FALSE(something_left_over());
  EXPECT_TRUE(exists("out/report.html"));
}

TEST_F(Interrupt, AtAnyTimeNothingIsLostAndNothingIsWrong) {
  const char* const renderers = "cloud,cloud-literal,brute-force,analytic";
  succeeds(compare(renderers, "whole"));
  const auto expected = hashes("whole");
  std::size_t finished = 0;
  bool complete = false;
  for (int delay_ms = 0; !complete; delay_ms = delay_ms < 60 ? delay_ms + 6 : 2 * delay_ms) {
    Started run(folder_, compare(renderers));
    ::usleep(static_cast<useconds_t>(delay_ms) * 1000);
    run.send(SIGINT);
    const int status = run.end();
    complete = status == 0;
    // Before it has its first instruction a process knows no signals.
    ASSERT_TRUE(complete || status == kInterrupted) << status << " after " << delay_ms << " ms";
    if (!complete && !run.killed()) {
      EXPECT_THAT(run.err(), HasSubstr("palpate: stopped")) << delay_ms;
    }
    if (!exists("out/result.json")) continue;
    const json document = result();
    std::size_t ok = 0;
    for (const json& r : document["renderers"]) {
      if (r["status"] != "ok") continue;
      ++ok;
      EXPECT_EQ(r["trace_hash"], expected.at(r["label"])) << delay_ms;
    }
    EXPECT_GE(ok, finished) << "lost after " << delay_ms << " ms";
    EXPECT_EQ(document["complete"], ok == expected.size());
    finished = ok;
  }
  EXPECT_EQ(hashes("out"), expected);
  EXPECT_FALSE(something_left_over());
}

TEST_F(Interrupt, WhateverItIsDoing) {
  const std::string large = "sinusoid:points=1002001";
  const std::map<std::string, Words> works = {
      {"an exploration", words("compare", kTinyWaves, "--renderers cloud --reference none --out @/out --path",
                               kEndlessExploration)},
      {"the reference", words("compare", kTinyWaves, "--renderers cloud --out @/out --path", kEndlessPath)},
      {"frames",
       words("compare", large, "--renderers brute-force --reference none --out @/out --path", kTinyWeave)},
      {"a generator", words("info sinusoid:points=100000000")},
      {"a plan", words("info plan sinusoid:points=100000000")},
      {"cleaning", words("clean", large, "--steps smooth/iterations=50 --out @/cleaned.ply")},
      {"behaviours", words("test behaviours --out @/behaviours")}};
  for (const auto& [what, arguments] : works) {
    if (what == "cleaning" && all_renderers().find("mesh-godobject") == nullptr) continue;
    Started run(folder_, arguments);
    run.wait_for_signals();
    ::usleep(500'000);
    run.send(what == "frames" ? SIGTERM : SIGINT);
    EXPECT_EQ(run.end(), what == "frames" ? kTerminated : kInterrupted) << what << run.err();
    EXPECT_THAT(run.err(), HasSubstr("palpate: stopped")) << what;
  }
  EXPECT_FALSE(exists("cleaned.ply"));
  EXPECT_FALSE(exists("cleaned.ply.part"));
}

TEST_F(Interrupt, NothingChangesBeforeTheInputIsKnown) {
  succeeds(compare("cloud"));
  const std::string before = text_in("out/result.json");
  Started run(folder_, compare("cloud", "out", kEndlessExploration));
  run.wait_for_signals();
  ::usleep(500'000);
  run.send(SIGINT);
  EXPECT_EQ(run.end(), kInterrupted);
  EXPECT_THAT(run.err(), HasSubstr("nothing was changed in " + in("out")));
  EXPECT_EQ(text_in("out/result.json"), before);
  stopped(compare("cloud", "new/out", kEndlessExploration),
          [&] { return exists("new/out/.palpate-output"); });
  EXPECT_FALSE(exists("new")) << "made for nothing";
}

TEST_F(Interrupt, AChangedModelIsAnotherRun) {
  succeeds("clean sphere:points=3000 --steps thin/cell=0.1 --out @/a.ply");
  const auto arguments = [&](const std::string& renderers) {
    return words("compare @/a.ply --renderers", renderers,
                 "--path exploration:frames=300000:depth_mm=0.5:seed=1 --out @/out --reference none");
  };
  stopped(arguments("cloud,brute-force"), is_kept("cloud"));
  std::string points = text_in("a.ply");
  points[points.size() - 1] = static_cast<char>(points[points.size() - 1] ^ 1);  // a coordinate, hardly
  write_text(in("a.ply"), points);
  Started next(folder_, arguments("cloud"));
  EXPECT_EQ(next.end(), kExitBadInput);
  EXPECT_THAT(next.err(), HasSubstr("of something else"));
}

TEST_F(Interrupt, ADownloadIsEndedWithAllThatItStarted) {
  make_idle_program("curl");
  const Environment path("PATH", (in("bin") + ":" + std::getenv("PATH")).c_str());
  const Environment cache("XDG_CACHE_HOME", in("cache").c_str()), data("PALPATE_DATA", nullptr);
  EXPECT_THAT(stopped(
                  words("fetch stanford-dragon --source https://nowhere.invalid/a.ply"),
                  [&] { return idle_runs(); }, SIGTERM),
              HasSubstr("what has come is kept"));
  EXPECT_TRUE(idle_ends());
}

TEST_F(Interrupt, AReconstructionIsEndedAndIsNoFailure) {
  if (all_renderers().find("mesh-godobject") == nullptr) GTEST_SKIP() << "built without mesh-godobject";
  make_idle_program("palpate-reconstruct");
  const Environment worker("PALPATE_RECONSTRUCT", in("bin/palpate-reconstruct").c_str());
  const Environment cache("PALPATE_MESH_CACHE", "off");
  Started run(folder_, compare("cloud,mesh-godobject:mesh=advancing-front"));
  ASSERT_TRUE(run.wait_for([&] { return idle_runs(); })) << run.err();
  run.send_group(SIGINT);
  EXPECT_EQ(run.end(), kInterrupted);
  EXPECT_EQ(result()["renderers"][1]["status"], "did-not-finish");
  EXPECT_TRUE(idle_ends());
}

TEST_F(Interrupt, ReproduceKeepsItsTablesAndGoesOn) {
  if (all_renderers().find("mesh-godobject") == nullptr) GTEST_SKIP() << "built without the baselines";
  const Environment cache("PALPATE_MESH_CACHE", "off"), data("PALPATE_DATA", nullptr),
      home("XDG_CACHE_HOME", in("cache").c_str());
  const Words arguments = words("reproduce --tables 7,8,12 --quick --out @/out");
  const std::string said = stopped(arguments, is_kept("table7"));
  EXPECT_THAT(said, HasSubstr("complete and kept in " + in("out") + ": table7"));
  const json seven = json_in("out/table7/result.json");
  const ProcessOutcome next = succeeds(words(arguments, "--verbose"));
  EXPECT_THAT(next.err, HasSubstr("going on from an interrupted run"));
  EXPECT_EQ(json_in("out/table7/result.json"), seven) << "measured again";
  EXPECT_THAT(next.out, HasSubstr("54,717")) << "table 7 is printed: ";
  EXPECT_THAT(next.out, HasSubstr("49,914")) << "and table 8";
  const std::string report = text_in("out/report.html");
  for (const char* table : {"table7", "table8", "table12"}) {
    EXPECT_TRUE(std::filesystem::exists(in(std::string("out/") + table + "/result.json")));
    EXPECT_NE(report.find(std::string("<a href=\"") + table + ".html\">"), std::string::npos) << table;
    EXPECT_NE(
        file_text(in(std::string("out/") + table + ".html")).find(std::string("<section id=\"") + table),
        std::string::npos)
        << table;
  }
  EXPECT_FALSE(something_left_over());
}

TEST_F(Interrupt, ALiveSessionEndsAsIfItsTimeWereOver) {
  const auto live = [&](const char* how) {
    return words("live", kTinyWaves, "--renderers cloud --seconds 6000 --out @/out", how);
  };
  const auto felt = [&](const std::string& said) {
    EXPECT_THAT(said, HasAll("palpate: stopped: the report", "warning: The session was stopped by a signal"));
    expect_valid("live", text_in("out/live.json"));
    EXPECT_GT(json_in("out/live.json")["ticks"], 0);
    EXPECT_THAT(text_in("out/report.html"), HasSubstr("stopped by a signal"));
    EXPECT_FALSE(something_left_over());
  };
  // It listens once it runs.
  felt(stopped(live("--listen 0"),
               [&] { return text_in("started.err").find("listening") != std::string::npos; }));
  std::filesystem::remove_all(in("out"));
  const auto recorded = [&] {
    constexpr std::uintmax_t kSomeChunks = 50'000;
    std::error_code code;
    const auto bytes = std::filesystem::file_size(in("fast.palrec"), code);
    return !code && bytes > kSomeChunks;
  };
  felt(stopped(live("--accelerated --record @/fast.palrec"), recorded, SIGTERM));
  EXPECT_THAT(succeeds("info @/fast.palrec").out, HasSubstr("none lost"));
}

TEST_F(Interrupt, AClosedPipeEndsItWithoutAWord) {
  std::array<int, 2> pipe{};
  ASSERT_EQ(::pipe(pipe.data()), 0);
  ::close(pipe[0]);
  std::signal(SIGPIPE, SIG_IGN);  // as some shells and languages hand it on
  Started run(folder_, {"list", "renderers"}, pipe[1]);
  std::signal(SIGPIPE, SIG_DFL);
  EXPECT_EQ(run.end(), 128 + SIGPIPE);
  EXPECT_EQ(run.err(), "");
  ::close(pipe[1]);
}

TEST_F(Interrupt, AFullDiskIsSaid) {
  const int full = ::open("/dev/full", O_WRONLY);
  ASSERT_GE(full, 0);
  Started run(folder_, {"list", "renderers"}, full);
  EXPECT_EQ(run.end(), 1);
  EXPECT_THAT(run.err(), HasSubstr("No space left"));
  EXPECT_THAT(run.err(), Not(HasSubstr("fault of Palpate")));
  ::close(full);
}

}  // namespace
}  // namespace palpate::experiments
