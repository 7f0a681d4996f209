#include "toolkit/trace/replay.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <ctime>
#include <limits>
#include <numeric>

#include "toolkit/core/clock.h"
#include "toolkit/core/nearest_rank.h"
#include "toolkit/core/try.h"

namespace palpate::trace {
namespace {

using render::Frame;
using render::HapticRenderer;

constexpr double kNominalDtS = 1e-3;        // a lone sample has no neighbour to take its dt from
constexpr std::int64_t kFirstPathLine = 2;  // line 1 of a path file is its header
constexpr std::size_t kEvictedBytes = std::size_t{64} * 1024 * 1024;  // design.md section 4
constexpr std::size_t kCacheLineBytes = 64;                           // x86-64 and most ARM cores
constexpr std::int64_t kPacedPeriodNs = 1'000'000;                    // the 1 kHz tick
constexpr std::size_t kClockPairs = 4096;  // enough for a stable median, well under a millisecond
constexpr double kUsPerNs = 1e-3;
constexpr std::size_t kProgressEveryFrames = 256;  // paced frames are long: a report about 4 times a second

/// A renderer along a path, with what moves its scene: who owns both advances the models first.
class Course {
 public:
  Course(HapticRenderer& renderer, const ProbePath& path, render::Simulation* simulation)
      : renderer_(renderer), path_(path), simulation_(simulation) {}

  /// Back to the first sample, one step before its time.
  void restart() noexcept {
    const double step_s = path_.size() > 1 ? path_.t_s[1] - path_.t_s[0] : kNominalDtS;
    const double start_s = path_.t_s[0] - step_s;
    if (simulation_ != nullptr) {
      simulation_->reset();
      simulation_->advance(start_s);
    }
    renderer_.restart(path_.hip_mm[0], start_s);
  }
  /// Whatever moves is where it is at sample i. Before each frame, never timed.
  void advance(std::size_t i) noexcept {
    if (simulation_ != nullptr) simulation_->advance(path_.t_s[i]);
  }
  Frame step(std::size_t i) noexcept { return renderer_.step(path_.hip_mm[i], path_.t_s[i]); }
  /// The first sample after `i` before which something moves; the path's end where nothing does.
  [[nodiscard]] std::size_t still_until(std::size_t i) const noexcept {
    if (simulation_ == nullptr) return path_.size();
    const double next_s = simulation_->next_s();
    std::size_t end = i + 1;
    while (end < path_.size() && path_.t_s[end] < next_s) ++end;
    return end;
  }

 private:
  HapticRenderer& renderer_;
  const ProbePath& path_;
  render::Simulation* simulation_;
};

// A cheap order-dependent sum of the bits that trace_hash covers: timed passes prove with it that they
// answered what the untimed pass did, for some 2 ns a frame and without writing a second trace through the
// caches.
class Digest {
 public:
  void add(const Frame& frame) noexcept {
    // Odd constants from the fractional parts of square roots of primes (SHA-512's initial words, made odd).
    const std::uint64_t sum =
        bits(frame.force_n.x()) * 0x6A09E667F3BCC909u + bits(frame.force_n.y()) * 0xBB67AE8584CAA73Bu +
        bits(frame.force_n.z()) * 0x3C6EF372FE94F82Bu + bits(frame.god_object_mm.x()) * 0xA54FF53A5F1D36F1u +
        bits(frame.god_object_mm.y()) * 0x510E527FADE682D1u +
        bits(frame.god_object_mm.z()) * 0x9B05688C2B3E6C1Fu + (frame.contact ? 0x1F83D9ABFB41BD6Bu : 0u);
    state_ = std::rotl(state_, 1) + sum;
  }
  [[nodiscard]] std::uint64_t value() const noexcept { return state_; }

 private:
  static std::uint64_t bits(double v) noexcept { return std::bit_cast<std::uint64_t>(v); }
  std::uint64_t state_ = 0;
};

std::uint64_t digest_of(std::span<const Frame> frames) noexcept {
  Digest digest;
  for (const Frame& frame : frames) digest.add(frame);
  return digest.value();
}

Error differs(const ProbePath& path, const char* pass) {
  Error error;
  error.what = std::string("the renderer answered differently in the ") + pass + " than in the untimed pass";
  error.remedy =
      "a renderer must give the same trace after every restart: check what restart() leaves behind";
  error.file = path.name;
  return error;
}

Status check_path(const ProbePath& path) {
  const auto wrong = [&](std::size_t sample, std::string what, std::string remedy) {
    return Error{std::move(what), std::move(remedy), path.name,
                 kFirstPathLine + static_cast<std::int64_t>(sample)};
  };
  if (path.t_s.empty() || path.t_s.size() != path.hip_mm.size())
    return wrong(0, "the path has no samples, or not as many times as positions", "give a path with samples");
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (!std::isfinite(path.t_s[i])) return wrong(i, "the time is not finite", "remove or mend the sample");
    if (i > 0 && !(path.t_s[i] > path.t_s[i - 1]))
      return wrong(i, "time does not increase", "sort the samples and remove doubled times");
  }
  return Done{};
}

// One stretch of consecutive contact frames, [begin, end).
struct Run {
  std::size_t begin, end;
};

std::vector<Run> contact_runs(const ForceTrace& trace) {
  std::vector<Run> runs;
  for (std::size_t i = 0; i < trace.frames.size(); ++i) {
    if (!trace.frames[i].contact) continue;
    if (!runs.empty() && runs.back().end == i) {
      runs.back().end = i + 1;
    } else {
      runs.push_back({i, i + 1});
    }
  }
  return runs;
}

void step_range(Course& course, std::size_t begin, std::size_t end, Digest& digest) noexcept {
  for (std::size_t i = begin; i < end; ++i) {
    course.advance(i);
    digest.add(course.step(i));
  }
}

// Pass A: the time of every run. `times` has room for them. Where models move, a run is timed in pieces
// between their moves.
void time_runs(Course& course, std::size_t frames, std::span<const Run> runs, std::span<RunTime> times,
               Digest& digest) noexcept {
  course.restart();
  std::size_t next = 0;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const Run& run = runs[i];
    step_range(course, next, run.begin, digest);
    times[i] = {0, run.end - run.begin};
    for (next = run.begin; next < run.end;) {
      course.advance(next);
      const std::size_t end = std::min(run.end, course.still_until(next));
      const std::int64_t start_ns = monotonic_ns();
      for (; next < end; ++next) digest.add(course.step(next));
      times[i].ns += monotonic_ns() - start_ns;
    }
  }
  step_range(course, next, frames, digest);
}

// Pass B: the time of every frame.
void time_frames(Course& course, std::span<std::int64_t> frame_ns, Digest& digest) noexcept {
  course.restart();
  for (std::size_t i = 0; i < frame_ns.size(); ++i) {
    course.advance(i);
    const std::int64_t start_ns = monotonic_ns();
    const Frame frame = course.step(i);
    frame_ns[i] = monotonic_ns() - start_ns;
    digest.add(frame);
  }
}

double mean_us_of(std::int64_t total_ns, std::uint64_t frames) {
  return static_cast<double>(total_ns) * kUsPerNs / static_cast<double>(frames);
}

// Memory that is walked through to evict the caches.
class Evictor {
 public:
  explicit Evictor(std::size_t bytes)
      : words_(bytes / sizeof(std::uint64_t), 1) {}  // written, so that pages are real
  void evict() noexcept {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < words_.size(); i += kCacheLineBytes / sizeof(std::uint64_t)) sum += words_[i];
    sink_ = sum;
  }

 private:
  std::vector<std::uint64_t> words_;
  volatile std::uint64_t sink_ = 0;  // keeps the walk from being optimised away
};

// Sleeps to the next tick that is not over yet; counts those that are.
void sleep_to_tick(std::int64_t& next_ns, std::uint64_t& skipped) noexcept {
  constexpr std::int64_t kNsPerS = 1'000'000'000;
  next_ns += kPacedPeriodNs;
  const std::int64_t late_ns = monotonic_ns() - next_ns;
  if (late_ns > 0) {
    const std::int64_t over = late_ns / kPacedPeriodNs + 1;
    skipped += static_cast<std::uint64_t>(over);
    next_ns += over * kPacedPeriodNs;
  }
  timespec until{};
  until.tv_sec = static_cast<time_t>(next_ns / kNsPerS);
  until.tv_nsec = static_cast<long>(next_ns % kNsPerS);
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) != 0) {
  }  // a signal woke us early: sleep on
}

Result<PacedStatistics> paced_pass(Course& course, const ProbePath& path, const ForceTrace& trace,
                                   std::size_t frames, std::size_t evicted_bytes, const ReplayReport& report,
                                   Progress* progress) {
  const char* const what = evicted_bytes > 0 ? "paced pass with eviction" : "paced pass";
  frames = std::min(frames, path.size());
  PacedStatistics paced;
  const std::size_t first = densest_contact_stretch(trace, frames);
  std::vector<std::int64_t> times;
  times.reserve(frames);
  Evictor evictor(evicted_bytes);
  Digest ahead, digest;
  course.restart();
  step_range(course, 0, first, ahead);
  std::int64_t next_ns = monotonic_ns();
  for (std::size_t i = first; i < first + frames; ++i) {
    if (progress != nullptr && (i - first) % kProgressEveryFrames == 0) {
      progress->report(what, static_cast<double>(i - first) / static_cast<double>(frames));
      if (progress->cancelled()) return Error{"stopped by the user", "", "", 0};
    }
    evictor.evict();
    sleep_to_tick(next_ns, paced.skipped_ticks);
    course.advance(i);
    const std::int64_t start_ns = monotonic_ns();
    const Frame frame = course.step(i);
    const std::int64_t ns = monotonic_ns() - start_ns;
    digest.add(frame);
    if (!frame.contact) continue;
    times.push_back(ns);
    if (frame.status == render::FrameStatus::kBoundHit) ++paced.frame.bound_hits;
  }
  if (digest.value() != digest_of(std::span(trace.frames).subspan(first, frames))) return differs(path, what);
  const std::uint64_t bound_hits = paced.frame.bound_hits;
  paced.frame =
      frame_statistics(std::move(times), {}, report.contact ? report.contact->clock_overhead_ns : 0.0);
  paced.frame.bound_hits = bound_hits;
  paced.frame.frames = frames;
  paced.frame.contact_frames = paced.frame.timed_frames;
  paced.first_frame = first;
  paced.evicted_bytes = evicted_bytes;
  return paced;
}

// Passes A and B.
Status time_passes(Course& course, const ProbePath& path, ReplayReport& report) {
  const std::vector<Frame>& frames = report.trace.frames;
  const std::uint64_t expected = digest_of(frames);
  const std::vector<Run> runs = contact_runs(report.trace);
  std::size_t contact_frames = 0;
  for (const Run& run : runs) contact_frames += run.end - run.begin;

  Digest in_runs, whole, single;
  std::vector<RunTime> run_times(runs.size());
  time_runs(course, path.size(), runs, run_times, in_runs);
  if (in_runs.value() != expected) return differs(path, "pass timed by contact runs");
  const Run everything[] = {{0, path.size()}};
  RunTime whole_time;
  time_runs(course, path.size(), everything, std::span(&whole_time, 1), whole);
  if (whole.value() != expected) return differs(path, "pass timed as a whole");
  report.trace.frame_ns.assign(path.size(), 0);
  time_frames(course, report.trace.frame_ns, single);
  if (single.value() != expected) return differs(path, "pass timed frame by frame");

  const double overhead_ns = measure_clock_overhead_ns();
  std::vector<std::int64_t> contact_times;
  contact_times.reserve(contact_frames);
  std::uint64_t hits = 0, contact_hits = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const bool hit = frames[i].status == render::FrameStatus::kBoundHit;
    hits += hit ? 1u : 0u;
    if (!frames[i].contact) continue;
    contact_hits += hit ? 1u : 0u;
    contact_times.push_back(report.trace.frame_ns[i]);
  }
  FrameStatistics contact = frame_statistics(std::move(contact_times), run_times, overhead_ns);
  FrameStatistics all =
      frame_statistics(report.trace.frame_ns, std::span<const RunTime>(&whole_time, 1), overhead_ns);
  contact.bound_hits = contact_hits;
  all.bound_hits = hits;
  contact.frames = all.frames = frames.size();
  contact.contact_frames = all.contact_frames = contact_frames;
  report.contact = contact;
  report.all = all;
  return Done{};
}

}  // namespace

FrameStatistics frame_statistics(std::vector<std::int64_t> times, std::span<const RunTime> runs,
                                 double clock_overhead_ns) {
  FrameStatistics s;
  s.timed_frames = times.size();
  s.clock_overhead_ns = clock_overhead_ns;
  if (times.empty()) return s;
  std::sort(times.begin(), times.end());
  const auto us = [&](double percent) {
    return static_cast<double>(nearest_rank(times, percent)) * kUsPerNs;
  };
  s.min_us = us(0.0);
  s.p50_us = us(50.0);
  s.p99_us = us(99.0);
  s.p999_us = us(99.9);
  double longest_us = us(100.0);
  s.deadline_misses_1khz =
      static_cast<std::uint64_t>(times.end() - std::upper_bound(times.begin(), times.end(), kDeadline1KhzNs));
  const std::int64_t total_ns = std::accumulate(times.begin(), times.end(), std::int64_t{0});
  // A mean of equal numbers may round to the next one beyond them: the clamps take that back, no more.
  s.mean_clocked_us = std::clamp(mean_us_of(total_ns, times.size()), *s.min_us, longest_us);
  RunTime all;
  for (const RunTime& run : runs) {
    if (run.frames == 0) continue;
    all.ns += run.ns;
    all.frames += run.frames;
    longest_us = std::max(longest_us, mean_us_of(run.ns, run.frames));
  }
  s.max_us = longest_us;
  s.mean_us = all.frames > 0 ? std::min(mean_us_of(all.ns, all.frames), longest_us) : *s.mean_clocked_us;
  return s;
}

double measure_clock_overhead_ns() {
  std::vector<std::int64_t> pairs(kClockPairs);
  for (std::int64_t& pair : pairs) {
    const std::int64_t start_ns = monotonic_ns();
    pair = monotonic_ns() - start_ns;
  }
  std::sort(pairs.begin(), pairs.end());
  return static_cast<double>(nearest_rank(pairs, 50.0));
}

std::size_t densest_contact_stretch(const ForceTrace& trace, std::size_t frames) {
  const std::vector<Frame>& all = trace.frames;
  if (frames == 0 || frames >= all.size()) return 0;
  std::size_t inside = 0;
  for (std::size_t i = 0; i < frames; ++i) inside += all[i].contact ? 1u : 0u;
  std::size_t best = inside, best_start = 0;
  for (std::size_t start = 1; start + frames <= all.size(); ++start) {
    inside += all[start + frames - 1].contact ? 1u : 0u;
    inside -= all[start - 1].contact ? 1u : 0u;
    if (inside > best) {
      best = inside;
      best_start = start;
    }
  }
  return best_start;
}

Result<ForceTrace> replay(HapticRenderer& renderer, const ProbePath& path, render::Simulation* simulation) {
  PALPATE_TRY(check_path(path));
  ForceTrace trace;
  trace.label = renderer.describe().name;
  trace.frames.reserve(path.size());
  Course course(renderer, path, simulation);
  course.restart();
  for (std::size_t i = 0; i < path.size(); ++i) {
    course.advance(i);
    trace.frames.push_back(course.step(i));
  }
  return trace;
}

Result<ReplayReport> measure(HapticRenderer& renderer, const ProbePath& path, const ReplayOptions& options) {
  PALPATE_ASSIGN(ForceTrace trace, replay(renderer, path, options.simulation));
  ReplayReport report;
  report.trace = std::move(trace);
  report.trace_hash = trace_hash(report.trace);
  report.counters = renderer.counters();
  if (!options.timed) return report;
  Course course(renderer, path, options.simulation);
  PALPATE_TRY(time_passes(course, path, report));
  struct Wanted {
    std::uint64_t frames;
    std::size_t evicted_bytes;
    std::optional<PacedStatistics>& out;
  };
  for (const Wanted& wanted : {Wanted{options.paced_frames, 0, report.paced},
                               Wanted{options.paced_evicted_frames, kEvictedBytes, report.paced_evicted}}) {
    if (wanted.frames == 0) continue;
    PALPATE_ASSIGN(const PacedStatistics paced, paced_pass(course, path, report.trace, wanted.frames,
                                                           wanted.evicted_bytes, report, options.progress));
    wanted.out = paced;
  }
  return report;
}

}  // namespace palpate::trace
