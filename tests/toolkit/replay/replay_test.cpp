// Replay: what is counted, what is refused, and that every pass answers alike. Never how long anything took.
#include <gtest/gtest.h>

#include <palpate/replay.h>
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"
#include "toolkit/core/statistics.h"
#include "toolkit/render/wrapped_renderer.h"
#include "toolkit/trace/timed_passes.h"

namespace palpate::trace {
namespace {

// A half space z < 0 with a spring; `forgets` makes every restart answer a little differently.
class Wall final : public render::SceneFreeRenderer {
 public:
  explicit Wall(bool forgets = false) : forgets_(forgets) {}
  void restart(const Vec3&, double t_s) noexcept override {
    ++restarts_;
    last_s_ = t_s;
    counters_ = {};
  }
  render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    ++counters_.frames;
    const double dt_s = t_s - last_s_;
    last_s_ = t_s;
    last_dt_s = dt_s;
    if (counters_.frames == 1) first_dt_s = dt_s;
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    if (hip_mm.z() >= 0.0) return frame;
    frame.contact = true;
    frame.model = 0;
    frame.god_object_mm.z() = 0.0;
    frame.force_n.z() = -0.5 * hip_mm.z() + (forgets_ ? 1e-9 * restarts_ : 0.0);
    if (hip_mm.z() < -1.5) {
      frame.status = render::FrameStatus::kBoundHit;
      ++counters_.bound_hits;
    }
    return frame;
  }
  render::FrameCounters counters() const noexcept override { return counters_; }
  render::Description describe() const override { return {"wall", "", "", "constant", {}}; }

  double first_dt_s = 0.0, last_dt_s = 0.0;

 private:
  bool forgets_;
  int restarts_ = 0;
  double last_s_ = 0.0;
  render::FrameCounters counters_;
};

ProbePath path_of(std::vector<double> z_mm) {
  ProbePath path;
  path.name = "test.csv";
  for (std::size_t i = 0; i < z_mm.size(); ++i) {
    path.t_s.push_back(0.001 * static_cast<double>(i));
    path.hip_mm.emplace_back(0.0, 0.0, z_mm[i]);
  }
  return path;
}

// What stands side by side is comparable, whatever the clock read in either pass.
void expect_in_order(const FrameStatistics& s) {
  EXPECT_LE(*s.min_us, *s.p50_us);
  EXPECT_LE(*s.p50_us, *s.p99_us);
  EXPECT_LE(*s.p99_us, *s.p999_us);
  EXPECT_LE(*s.p999_us, *s.max_us);
  EXPECT_LE(*s.min_us, *s.mean_clocked_us);
  EXPECT_LE(*s.mean_clocked_us, *s.max_us);
  EXPECT_LE(*s.mean_us, *s.max_us);
}

TEST(FrameStatistics, AnInterruptedRunIsLongerThanTheLongestFrameOfTheOtherPass) {
  // Three frames of 100 ns with the clock; without it, a run of two in which something took 5 ms.
  const FrameStatistics s =
      frame_statistics({100, 100, 100}, std::vector<RunTime>{{5'000'000, 2}, {50, 1}}, 40.0);
  expect_in_order(s);
  EXPECT_DOUBLE_EQ(*s.mean_us, 5000.05 / 3.0);
  EXPECT_DOUBLE_EQ(*s.mean_clocked_us, 0.1);
  EXPECT_DOUBLE_EQ(*s.max_us, 2500.0) << "one of the two took at least half of it";
  EXPECT_DOUBLE_EQ(*s.p999_us, 0.1);
  EXPECT_EQ(s.timed_frames, 3u);
  EXPECT_EQ(s.clock_overhead_ns, 40.0);
}

TEST(FrameStatistics, AreInOrderForEveryTiming) {
  constexpr std::uint64_t kSeed = 20240807;
  SCOPED_TRACE(kSeed);
  Random random(kSeed);
  for (int trial = 0; trial < 2000; ++trial) {
    std::vector<std::int64_t> frames(1 + random.below(9));
    std::vector<RunTime> runs(random.below(4));
    // All equal, or anything up to a second.
    const auto ns = [&] { return static_cast<std::int64_t>(random.below(1 + random.below(1'000'000'000))); };
    const std::int64_t same = ns();
    for (std::int64_t& frame : frames) frame = trial % 2 == 0 ? same : ns();
    for (RunTime& run : runs) run = {ns(), random.below(5)};
    expect_in_order(frame_statistics(frames, runs, 20.0));
    // The same time all over: its mean must not round past it.
    runs.assign(3, {same * 7, 7});
    expect_in_order(frame_statistics(frames, runs, 20.0));
  }
}

TEST(FrameStatistics, WithoutRunsBothMeansAreThatOfTheFrames) {
  const FrameStatistics s = frame_statistics({100, 300}, {}, 20.0);
  EXPECT_DOUBLE_EQ(*s.mean_us, 0.2);
  EXPECT_DOUBLE_EQ(*s.mean_clocked_us, 0.2);
  EXPECT_FALSE(frame_statistics({}, {}, 20.0).mean_us.has_value());
}

TEST(Replay, OneFrameForEachSample) {
  Wall wall;
  ProbePath path = path_of({0.5, -0.5, -1.0, 0.5});
  path.t_s = {0.0, 0.002, 0.003, 0.010};
  const auto trace = test::value_of(replay(wall, path));
  ASSERT_EQ(trace.frames.size(), 4u);
  EXPECT_EQ(trace.label, "wall");
  EXPECT_FALSE(trace.frames[0].contact);
  EXPECT_DOUBLE_EQ(trace.frames[2].force_n.z(), 0.5);
  EXPECT_NEAR(wall.first_dt_s, 0.002, 1e-15) << "the first frame takes the dt of the second";
  EXPECT_NEAR(wall.last_dt_s, 0.007, 1e-15);
  // A force at the first sample is part of the trace.
  const auto felt = test::value_of(replay(wall, path_of({-0.1, 0.5})));
  EXPECT_TRUE(felt.frames[0].contact);
  EXPECT_FALSE(felt.frames[1].contact);
}

TEST(Replay, RefusesWhatIsNoPath) {
  Wall wall;
  EXPECT_FALSE(replay(wall, path_of({})));

  ProbePath back = path_of({1.0, 1.0, 1.0});
  back.t_s[2] = back.t_s[1];
  const Result<ForceTrace> still = replay(wall, back);
  ASSERT_FALSE(still);
  EXPECT_EQ(still.error().line, 4);

  ProbePath uneven = path_of({1.0, 1.0});
  uneven.hip_mm.pop_back();
  EXPECT_FALSE(replay(wall, uneven));
}

TEST(Measure, CountsContactAndAllFramesApart) {
  Wall wall;
  const ProbePath path = path_of({1, -1, -2, 1, 1, -1, 1});
  const auto report = test::value_of(measure(wall, path, {}));
  ASSERT_TRUE(report.contact && report.all);
  EXPECT_EQ(report.contact->frames, 7u);
  EXPECT_EQ(report.contact->contact_frames, 3u);
  EXPECT_EQ(report.contact->timed_frames, 3u);
  EXPECT_EQ(report.contact->bound_hits, 1u);
  EXPECT_EQ(report.all->timed_frames, 7u);
  EXPECT_EQ(report.all->contact_frames, 3u);
  EXPECT_EQ(report.free->timed_frames, 4u);
  EXPECT_EQ(report.contact->episodes, 2u);
  EXPECT_EQ(report.free->episodes, 3u);
  EXPECT_EQ(report.all->episodes, 2u) << "what is free belongs to the contact before it";
  EXPECT_EQ(report.counters.frames, 7u);
  EXPECT_EQ(report.trace.frame_ns.size(), 7u);
  EXPECT_EQ(report.trace_hash, trace_hash(report.trace));
  for (const FrameStatistics& s : {*report.contact, *report.all}) {
    ASSERT_TRUE(s.min_us && s.mean_us && s.p50_us && s.p99_us && s.p999_us && s.max_us);
    expect_in_order(s);
    EXPECT_GE(*s.mean_us, 0.0);
    EXPECT_GE(s.clock_overhead_ns, 0.0);
  }
}

TEST(Measure, WithoutContactThereAreNoContactTimes) {
  Wall wall;
  const auto report = test::value_of(measure(wall, path_of({1, 2, 3}), {true, 2, 0, nullptr}));
  EXPECT_EQ(report.contact->timed_frames, 0u);
  EXPECT_FALSE(report.contact->mean_us || report.contact->p50_us || report.contact->max_us);
  EXPECT_TRUE(report.all->mean_us.has_value());
  ASSERT_TRUE(report.paced.has_value());
  EXPECT_FALSE(report.paced->frame.p50_us.has_value());
}

TEST(Measure, ASingleSampleIsAPath) {
  Wall wall;
  const auto report = test::value_of(measure(wall, path_of({1}), {}));
  EXPECT_EQ(report.all->timed_frames, 1u);
  EXPECT_NEAR(wall.last_dt_s, 1e-3, 1e-15);
}

TEST(Measure, UntimedOnRequest) {
  Wall wall;
  ReplayOptions options;
  options.timed = false;
  const auto report = test::value_of(measure(wall, path_of({1, -1}), options));
  EXPECT_FALSE(report.contact || report.all || report.paced);
  EXPECT_TRUE(report.trace.frame_ns.empty());
}

TEST(Measure, PacedStretchIncludesContact) {
  Wall wall;
  const ProbePath path = path_of({1, 1, 1, -1, -1, 1, 1, 1});
  const auto report = test::value_of(measure(wall, path, {true, 3, 2, nullptr}));
  ASSERT_TRUE(report.paced && report.paced_evicted);
  EXPECT_EQ(report.paced->first_frame, 2u);
  EXPECT_EQ(report.paced->frame.frames, 3u);
  EXPECT_EQ(report.paced->frame.contact_frames, 2u);
  EXPECT_EQ(report.paced->evicted_bytes, 0u);
  EXPECT_EQ(report.paced_evicted->first_frame, 3u);
  EXPECT_EQ(report.paced_evicted->frame.contact_frames, 2u);
  EXPECT_EQ(report.paced_evicted->evicted_bytes, 64u * 1024u * 1024u);
  EXPECT_TRUE(report.paced_evicted->frame.p50_us.has_value());
}

TEST(Measure, RefusesARendererThatAnswersDifferently) {
  Wall wall(true);
  EXPECT_TRUE(test::refused(measure(wall, path_of({1, -1, 1}), {}), "answered differently"));
}

TEST(Measure, StopsWhenAsked) {
  class Stop final : public Progress {
    void report(std::string_view, double) override {}
    bool cancelled() const override { return true; }
  } stop;
  Wall wall;
  EXPECT_FALSE(measure(wall, path_of({1, -1, 1}), {true, 3, 0, &stop}));
}

TEST(DensestStretch, FirstOfTheBest) {
  const std::vector<std::uint8_t> contact = {0, 1, 0, 1, 1, 0, 1, 1};
  EXPECT_EQ(densest_contact_stretch(contact, 2), 3u);
  EXPECT_EQ(densest_contact_stretch(contact, 3), 1u);
  EXPECT_EQ(densest_contact_stretch(contact, 8), 0u);
  EXPECT_EQ(densest_contact_stretch(contact, 100), 0u);
  EXPECT_EQ(densest_contact_stretch(contact, 0), 0u);
}

TEST(TraceHash, CoversForceGodObjectAndContactOnly) {
  ForceTrace trace;
  trace.frames.resize(2);
  const std::string plain = trace_hash(trace);
  trace.frame_ns = {1, 2};
  trace.frames[1].model = 3;
  trace.frames[1].force_n.x() = -0.0;
  EXPECT_EQ(trace_hash(trace), plain);
  trace.frames[1].contact = true;
  EXPECT_NE(trace_hash(trace), plain);
  trace.frames[1].contact = false;
  trace.frames[1].god_object_mm.y() = 1e-300;
  EXPECT_NE(trace_hash(trace), plain);
  EXPECT_EQ(trace_hash({}), "cbf29ce484222325") << "the offset basis of FNV-1a";
}

// Timed passes: which frames belong together, what many passes say, and intervals that hold what they claim.

std::vector<render::Frame> frames_of(std::size_t n) {
  return std::vector<render::Frame>(n);
}

/// So many contacts of `frames`, a free frame after each.
std::vector<std::uint8_t> episodes(int count, std::size_t frames) {
  std::vector<std::uint8_t> contact;
  for (int e = 0; e < count; ++e) {
    contact.insert(contact.end(), frames, 1);
    contact.push_back(0);
  }
  return contact;
}

/// Every frame takes `ns`, in every pass.
PassTimes even(const std::vector<std::uint8_t>& contact, std::size_t passes, std::uint32_t contact_ns,
               std::uint32_t free_ns) {
  PassTimes times;
  times.stretches = frame_spans_of(contact);
  for (std::size_t p = 0; p < passes; ++p) {
    auto& by_span = times.by_span.emplace_back();
    for (const FrameSpan& s : times.stretches) {
      const auto ns = static_cast<std::int64_t>(s.end - s.begin) * (s.contact ? contact_ns : free_ns);
      by_span.push_back({ns, ns / 2, {}});
    }
    auto& by_frame = times.by_frame.emplace_back();
    for (const std::uint8_t c : contact) by_frame.push_back(c != 0 ? contact_ns : free_ns);
  }
  return times;
}

TEST(Stretches, CoverThePathInOrder) {
  const std::vector<FrameSpan> s = frame_spans_of(std::vector<std::uint8_t>{0, 0, 1, 1, 1, 0, 1});
  ASSERT_EQ(s.size(), 4u);
  EXPECT_EQ(s[1].begin, 2u);
  EXPECT_EQ(s[1].end, 5u);
  EXPECT_TRUE(s[1].contact && s[3].contact && !s[0].contact && !s[2].contact);
  EXPECT_TRUE(frame_spans_of({}).empty());
}

TEST(PassStatistics, MeansAreTheMedianOfThePasses) {
  const std::vector<std::uint8_t> contact = {0, 1, 1, 0, 1, 0};
  PassTimes times = even(contact, 3, 200, 100);
  for (FrameSpanTime& t : times.by_span[2]) t.wall_ns *= 50;  // one pass was disturbed
  const PassStatistics s = pass_statistics(times, frames_of(contact.size()));
  EXPECT_DOUBLE_EQ(*s.contact.mean_us, 0.2);
  EXPECT_DOUBLE_EQ(*s.free.mean_us, 0.1);
  EXPECT_DOUBLE_EQ(*s.all.mean_us, 0.15);
  EXPECT_DOUBLE_EQ(*s.contact.cpu_mean_us, 0.1) << "the thread's own clock";
  EXPECT_EQ(s.contact.timed_frames, 3u);
  EXPECT_EQ(s.free.timed_frames, 3u);
  EXPECT_EQ(s.all.timed_frames, 6u);
  EXPECT_EQ(s.contact.passes, 3u);
  EXPECT_EQ(s.contact.episodes, 2u);
  EXPECT_EQ(s.all.episodes, 2u);
}

TEST(PassStatistics, WhatHitsAFrameOnceIsTheMachines) {
  const std::vector<std::uint8_t> contact(100, 1);
  PassTimes times = even(contact, 5, 200, 100);
  times.by_frame[3][7] = 9'000'000;                    // once: an interrupt
  for (auto& pass : times.by_frame) pass[60] = 5'000;  // always: the renderer
  const PassStatistics s = pass_statistics(times, frames_of(contact.size()));
  EXPECT_DOUBLE_EQ(*s.all.max_us, 5.0);
  EXPECT_DOUBLE_EQ(*s.all.worst_us, 9'000.0) << "and it is not hidden";
  EXPECT_EQ(s.all.deadline_misses_1khz, 0u);
  EXPECT_EQ(s.frame_ns[60], 5'000);
  EXPECT_EQ(s.frame_ns[7], 200);
}

TEST(PassStatistics, AnIntervalSaysHowMuchEpisodesDiffer) {
  // Two hundred episodes of ten frames: alike in one path, very unlike in the other.
  const std::vector<std::uint8_t> contact = episodes(200, 10);
  const PassTimes alike = even(contact, 3, 200, 100);
  PassTimes unlike = alike;
  for (auto& pass : unlike.by_span)
    for (std::size_t i = 0; i < pass.size(); i += 4) pass[i].wall_ns *= 10;
  const PassStatistics a = pass_statistics(alike, frames_of(contact.size())),
                       u = pass_statistics(unlike, frames_of(contact.size()));
  EXPECT_DOUBLE_EQ(a.contact.mean_interval_us->low, 0.2);
  EXPECT_DOUBLE_EQ(a.contact.mean_interval_us->high, 0.2);
  // Half of them 0.2, half 2.0: mean 1.1, standard error 0.9 / sqrt(200) = 0.064; 95 % are 1.96 of those.
  EXPECT_NEAR(u.contact.mean_interval_us->low, 1.1 - 1.96 * 0.064, 0.03);
  EXPECT_NEAR(u.contact.mean_interval_us->high, 1.1 + 1.96 * 0.064, 0.03);
}

TEST(PassStatistics, ASlowThousandthStandsInItsInterval) {
  const std::vector<std::uint8_t> contact = episodes(100, 50);
  PassTimes times = even(contact, 1, 200, 100);
  // One frame of 5 us in every tenth episode: 10 of 5,000 are 0.2 %.
  for (std::size_t e = 0; e < 100; e += 10) times.by_frame[0][e * 51 + 3] = 5'000;
  const PassStatistics s = pass_statistics(times, frames_of(contact.size()));
  EXPECT_DOUBLE_EQ(*s.contact.p999_us, 5.0);
  EXPECT_LE(s.contact.p999_interval_us->low, 5.0);
  EXPECT_DOUBLE_EQ(s.contact.p999_interval_us->high, 5.0);
}

TEST(PassStatistics, WithoutContactThereIsNoTimeOfIt) {
  const PassStatistics s = pass_statistics(even({0, 0, 0}, 2, 1, 100), frames_of(3));
  EXPECT_FALSE(s.contact.mean_us || s.contact.mean_interval_us || s.contact.p999_us);
  EXPECT_EQ(s.contact.episodes, 0u);
  EXPECT_DOUBLE_EQ(*s.all.mean_us, 0.1);
}

TEST(Bootstrap, IsTheSameEveryTimeAndNothingWithoutClusters) {
  const auto mean = [](std::span<const std::uint32_t> counts, Random&) {
    double sum = 0.0;
    for (std::size_t i = 0; i < counts.size(); ++i) sum += static_cast<double>(i * counts[i]);
    return std::optional<double>(sum / static_cast<double>(counts.size()));
  };
  const std::optional<Interval> once = bootstrap(40, mean), again = bootstrap(40, mean);
  ASSERT_TRUE(once && again);
  EXPECT_EQ(once->low, again->low);
  EXPECT_EQ(once->high, again->high);
  EXPECT_LT(once->low, 19.5);
  EXPECT_GT(once->high, 19.5);
  EXPECT_FALSE(bootstrap(0, mean).has_value());
}

}  // namespace
}  // namespace palpate::trace
