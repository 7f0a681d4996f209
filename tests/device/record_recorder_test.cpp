// The recorder while the loop runs: it never waits, and counts what it loses.
#include <sys/resource.h>
#include <sys/wait.h>

#include <csignal>

#include <palpate/clock.h>
#include "tests/device/helpers.h"
#include "tests/device/record_rig.h"
#include "tests/files.h"
#include "tests/house/allocation_count.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::device {
namespace {

constexpr std::uint64_t kRecorderSeed = 7;

/// Reads it to its end; how many ticks it holds.
std::size_t ticks_of(Recording& recording) {
  RecordedTick tick;
  std::size_t ticks = 0;
  for (;; ++ticks) {
    const Result<bool> more = recording.next(tick);
    EXPECT_TRUE(more) << more.error().message();
    if (!more || !*more) return ticks;
  }
}

std::size_t ticks_of(std::vector<std::byte> bytes, RecordingEnd& end) {
  Result<Recording> recording = open_bytes(std::move(bytes));
  EXPECT_TRUE(recording);
  if (!recording) return 0;
  const std::size_t ticks = ticks_of(*recording);
  end = recording->end();
  return ticks;
}

/// Adds the two renderers of RandomTicks.
bool add_both(Recorder& recorder) {
  for (const char* const name : {"a", "b"})
    if (!recorder.add_renderer({name, name, {}})) return false;
  return true;
}

/// A recorder on a disk in memory, of ticks that are not kept.
struct RecorderRig {
  explicit RecorderRig(const RecorderOptions& options = {})
      : made(Recorder::create(std::make_unique<MemoryFile>(disk), some_header(), source, options).value()),
        recorder(*made) {
    EXPECT_TRUE(add_both(recorder));
  }
  void take(int ticks) {
    for (int i = 0; i < ticks; ++i) recorder.took(source.next());
  }
  /// How many ticks the disk holds.
  std::size_t on_disk() { return ticks_of(disk.copy(), end); }

  MemoryDisk disk;
  RandomTicks source{kRecorderSeed, 2, false};
  std::unique_ptr<Recorder> made;
  Recorder& recorder;
  RecordingEnd end;
};

TEST(Recorder, KeepsDepthImagesBesideTheTicksInTwoPartsWhereTheyAreLong) {
  RecorderOptions options{.depth = true};
  RecorderRig rig(options);
  Random random(kRecorderSeed);
  std::vector<std::vector<std::byte>> given;
  for (const std::size_t bytes : {std::size_t{100}, kDepthPartBytes, kDepthPartBytes + 1}) {
    rig.take(5);
    std::vector<std::byte>& image = given.emplace_back(bytes);
    for (std::byte& one : image) one = static_cast<std::byte>(random.below(256));
    ASSERT_TRUE(rig.recorder.add_depth(image));
  }
  ASSERT_TRUE(rig.recorder.finish());
  EXPECT_FALSE(rig.recorder.add_depth(given.front())) << "its end stands last";
  EXPECT_EQ(rig.on_disk(), 15u) << "the ticks are as they are without images";
  EXPECT_EQ(rig.end.depth_images, given.size());
  auto recording = value_of(open_bytes(rig.disk.copy()));
  std::vector<std::byte> image;
  for (const std::vector<std::byte>& one : given) {
    ASSERT_TRUE(recording.next_depth(image).value());
    EXPECT_TRUE(image == one) << one.size();
  }
  EXPECT_FALSE(recording.next_depth(image).value());
  EXPECT_TRUE(recording.end().closed);
  // Earlier programs read what holds no images, and name the version of what does.
  constexpr std::size_t kVersionAt = 8;
  EXPECT_EQ(rig.disk.copy()[kVersionAt], std::byte{kRecordingVersionWithDepth});
  RecorderRig plain;
  EXPECT_EQ(plain.disk.copy()[kVersionAt], std::byte{kRecordingVersion});
}

TEST(Recorder, ADepthImageWithADamagedPartIsLeftOutWhole) {
  RecorderOptions options{.depth = true};
  RecorderRig rig(options);
  const std::vector<std::byte> lost(kDepthPartBytes + 1, std::byte{1}), kept(10, std::byte{2});
  ASSERT_TRUE(rig.recorder.add_depth(lost));
  ASSERT_TRUE(rig.recorder.add_depth(kept));
  ASSERT_TRUE(rig.recorder.finish());
  std::vector<std::byte> bytes = rig.disk.copy();
  const std::vector<std::byte> run(1000, std::byte{1});
  const auto at = std::search(bytes.begin(), bytes.end(), run.begin(), run.end());
  ASSERT_NE(at, bytes.end());
  *at = std::byte{3};
  ReadRecordingOptions skipping{.skip_damaged = true};
  auto recording = value_of(open_bytes(bytes, skipping));
  std::vector<std::byte> image;
  ASSERT_TRUE(recording.next_depth(image).value());
  EXPECT_TRUE(image == kept);
  EXPECT_FALSE(recording.next_depth(image).value());
  Result<Recording> strict = open_bytes(bytes);
  ASSERT_TRUE(strict);
  EXPECT_FALSE(strict->next_depth(image)) << "damage is an error unless it is left out";
}

TEST(Recorder, KeepsEveryTickOfALongSessionWithASmallRing) {
  MemoryDisk disk;
  RandomTicks source(kRecorderSeed);
  constexpr int kSession = 4'000;
  RecorderOptions options;
  options.ring_bytes = std::size_t{1} << 16;
  ASSERT_TRUE(record(disk, source, kSession, options));
  auto recording = value_of(open_bytes(disk.copy()));
  RecordedTick tick;
  std::size_t i = 0;
  std::int64_t before_ns = 0;
  for (;; ++i) {
    const Result<bool> more = recording.next(tick);
    ASSERT_TRUE(more) << more.error().message();
    if (!*more) break;
    ASSERT_LT(i, source.given.size());
    RecordedTick given = source.given[i];
    given.dt_ns = i == 0 ? 0 : tick.t_ns - before_ns;
    before_ns = tick.t_ns;
    ASSERT_EQ(difference(given, tick), "") << i;
    EXPECT_GE(tick.late_ns, 0);
    EXPECT_LT(tick.late_ns, 10'001);
  }
  EXPECT_EQ(i, std::size_t{kSession});
  ASSERT_EQ(recording.renderers().size(), 2u);
  EXPECT_EQ(recording.renderers()[1].name, "mesh-godobject");
}

TEST(Recorder, ASlowDiskCostsTicksThatAreCountedAndNeverTheLoop) {
  RecorderOptions options;
  options.ring_bytes = 1;  // the least that is given: two of the longest ticks
  RecorderRig rig(options);
  rig.disk.slow_ms = 30;
  rig.take(3000);
  const RecorderCounts running = rig.recorder.counts();
  EXPECT_EQ(running.ticks, 3000u) << "nobody waited";
  const Status done = rig.recorder.finish();
  const RecorderCounts counts = rig.recorder.counts();
  ASSERT_FALSE(done);
  EXPECT_TRUE(says(done.error().what, "were lost")) << done.error().message();
  EXPECT_TRUE(says(done.error().what, " s are kept")) << done.error().message();
  EXPECT_GT(counts.lost, 0u);
  EXPECT_EQ(counts.ticks, counts.written + counts.lost);
  EXPECT_EQ(rig.on_disk(), counts.written);
  EXPECT_EQ(rig.end.lost, counts.lost) << "what is in the file is what was counted";
  EXPECT_FALSE(rig.end.warnings().empty());
}

TEST(Recorder, ADiskThatIsFullForAWhileCostsNothing) {
  RecorderRig rig;
  const auto is_broken = [&](bool broken) {
    const std::lock_guard lock(rig.disk.mutex);
    rig.disk.broken = broken;
  };
  is_broken(true);
  rig.take(600);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(rig.recorder.counts().written, 0u);
  is_broken(false);
  EXPECT_TRUE(rig.recorder.finish());
  EXPECT_EQ(rig.on_disk(), 600u);
  EXPECT_EQ(rig.end.lost, 0u);
}

TEST(Recorder, ADiskThatStaysFullLosesTheRestAndSaysWhy) {
  RecorderRig rig;
  {
    const std::lock_guard lock(rig.disk.mutex);
    rig.disk.room = rig.disk.bytes.size() + 100;
  }
  rig.take(600);
  const Status done = rig.recorder.finish();
  ASSERT_FALSE(done);
  EXPECT_TRUE(says(done.error().what, "No space left")) << done.error().message();
  EXPECT_TRUE(says(done.error().remedy, "free some space"));
  EXPECT_TRUE(says(done.error().what, "; 0 s are kept")) << done.error().message();
  EXPECT_EQ(rig.recorder.counts().lost, 600u);
  EXPECT_EQ(rig.on_disk(), 0u);
}

TEST(Recorder, TicksAndTheWriterRunSideBySide) {
  // For ThreadSanitizer: a loop that takes ticks, a writer, and a thread that adds renderers and notes.
  RecorderOptions options;
  options.ring_bytes = std::size_t{1} << 17;
  options.chunk_s = 0.01;
  RecorderRig rig(options);
  Recorder& recorder = rig.recorder;
  std::thread loop([&] {
    for (int i = 0; i < 2000; ++i) {
      recorder.wait_for_room();
      rig.take(1);
    }
  });
  for (int i = 0; i < 20; ++i) {
    ASSERT_TRUE(recorder.note("note " + std::to_string(i)));
    ASSERT_TRUE(recorder.add_renderer({"more" + std::to_string(i), "cloud", {}}));
    static_cast<void>(recorder.counts());
  }
  loop.join();
  ASSERT_TRUE(recorder.finish());
  EXPECT_EQ(rig.on_disk(), 2000u);
}

TEST(Recorder, TakingATickAllocatesNothing) {
  RecorderOptions options;
  options.chunk_s = 1e6;  // the writer only fetches
  RecorderRig rig(options);
  rig.take(1);
  std::uint64_t counted = 0;
  {
    const house::AllocationCount allocations(house::AllocationCount::Threads::kThisOne);
    rig.take(1000);
    counted = allocations.count();
  }
  EXPECT_EQ(counted, 0u);
  EXPECT_EQ(rig.recorder.counts().written, 0u) << "nothing was written meanwhile";
  EXPECT_TRUE(rig.recorder.finish());
}

TEST(Recorder, TheTapNotesEveryCall) {
  class Answers final : public render::SceneFreeRenderer {
   public:
    render::Frame step(const Vec3& hip_mm, double) noexcept override {
      render::Frame frame;
      frame.god_object_mm = hip_mm;
      return frame;
    }
    render::Description describe() const override { return {}; }
  };
  Answers inner;
  VirtualClock clock;
  RendererTap tap(inner, clock);
  const Vec3 a{1.0, 2.0, 3.0}, b{4.0, 5.0, 6.0};
  tap.release_contact(b);
  tap.restart(a, 0.5);
  tap.release_contact(a);
  static_cast<void>(tap.step(b, 0.6));
  RecordedTrack track;
  tap.fill(track);
  ASSERT_EQ(track.calls.size(), 3u) << "what was before a restart is undone by it";
  EXPECT_EQ(track.calls[0], (RendererCall{RendererCall::Kind::kRestart, a, 0.5}));
  EXPECT_EQ(track.calls[1], (RendererCall{RendererCall::Kind::kReleaseContact, a, 0.0}));
  EXPECT_EQ(track.calls[2], (RendererCall{RendererCall::Kind::kStep, b, 0.6}));
  EXPECT_TRUE(track.stepped);
  EXPECT_EQ(track.frame.god_object_mm, b);
  tap.begin_tick();
  tap.fill(track);
  EXPECT_TRUE(track.calls.empty());
  EXPECT_FALSE(track.stepped);
  for (std::size_t i = 0; i <= kMaxCalls; ++i) static_cast<void>(tap.step(a, 1.0 + static_cast<double>(i)));
  tap.fill(track);
  EXPECT_TRUE(track.calls_lost);
  EXPECT_EQ(track.calls.size(), kMaxCalls);
}

class RecorderOnDisk : public InFolder {
 protected:
  /// Records in a child process at about 1 kHz until it is killed; the last tick's number goes through a
  /// pipe.
  pid_t record_in_child(const std::string& path, int out) {
    const pid_t pid = ::fork();
    if (pid != 0) return pid;
    RandomTicks source(kRecorderSeed, 2, false);
    auto made = Recorder::create(path, some_header(), source);
    if (!made) ::_exit(3);
    if (!add_both(**made)) ::_exit(4);
    constexpr std::int64_t kTicks = 60'000;
    for (std::int64_t i = 1; i <= kTicks; ++i) {
      (*made)->took(source.next());
      if (::write(out, &i, sizeof(i)) != sizeof(i)) ::_exit(5);
      std::this_thread::sleep_for(std::chrono::microseconds(900));
    }
    ::_exit(0);
  }
};

TEST_F(RecorderOnDisk, KilledInTheMiddleItLosesASecondAtMost) {
  const std::string path = in("killed.palrec");
  int pipes[2];
  ASSERT_EQ(::pipe(pipes), 0);
  const pid_t pid = record_in_child(path, pipes[1]);
  ASSERT_GT(pid, 0);
  ::close(pipes[1]);
  std::int64_t last = 0;
  // Four chunks and a piece of the fifth.
  constexpr std::int64_t kKilledAt = 1130;
  while (last < kKilledAt && ::read(pipes[0], &last, sizeof(last)) == sizeof(last)) {
  }
  ::kill(pid, SIGKILL);
  int status = 0;
  ::waitpid(pid, &status, 0);
  while (::read(pipes[0], &last, sizeof(last)) == sizeof(last)) {
  }
  ::close(pipes[0]);
  ASSERT_TRUE(WIFSIGNALED(status));
  auto recording = value_of(Recording::open(path));
  EXPECT_GE(static_cast<std::int64_t>(ticks_of(recording)), last - 1000)
      << "of " << last << " ticks, a millisecond each";
  EXPECT_FALSE(recording.end().closed);
  EXPECT_TRUE(says(recording.end().warnings().front(), "crashed"));
}

TEST_F(RecorderOnDisk, AFileThatMayNotGrowKeepsWhatItHasAndTheLoopGoesOn) {
  const std::string path = in("limited.palrec");
  constexpr rlim_t kMaxBytes = 250'000;  // two chunks and a half
  const pid_t pid = ::fork();
  if (pid == 0) {
    std::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{kMaxBytes, kMaxBytes};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    RandomTicks source(kRecorderSeed, 2, false);
    auto made = Recorder::create(path, some_header(), source);
    if (!made) ::_exit(3);
    if (!add_both(**made)) ::_exit(4);
    for (int i = 0; i < 3000; ++i) (*made)->took(source.next());
    const Status done = (*made)->finish();
    const RecorderCounts counts = (*made)->counts();
    const bool right = !done && counts.ticks == 3000 && counts.written > 0 && counts.lost > 0 &&
                       counts.ticks == counts.written + counts.lost &&
                       done.error().what.find("File too large") != std::string::npos;
    ::_exit(right ? 0 : 5);
  }
  int status = 0;
  ::waitpid(pid, &status, 0);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
  EXPECT_LE(std::filesystem::file_size(path), kMaxBytes);
  auto recording = value_of(Recording::open(path));
  // Whole chunks, and at most half a one behind them.
  EXPECT_GT(ticks_of(recording), 0u);
}

TEST_F(RecorderOnDisk, NeverReplacesAFileUnasked) {
  const std::string path = in("twice.palrec");
  RandomTicks source(kRecorderSeed);
  {
    auto first = Recorder::create(path, some_header(), source);
    ASSERT_TRUE(first);
    RecorderOptions replacing{.replace = true};
    EXPECT_TRUE(refused(Recorder::create(path, some_header(), source, replacing), "another program"));
  }
  EXPECT_TRUE(refused(Recorder::create(path, some_header(), source), "--force"));
  EXPECT_TRUE(is_recording(path));
  EXPECT_TRUE(
      refused(Recorder::create(in("no/such/folder.palrec"), some_header(), source), "create the folder"));
  const auto folder = Recorder::create(folder_.string(), some_header(), source);
  ASSERT_FALSE(folder);
}

}  // namespace
}  // namespace palpate::device
