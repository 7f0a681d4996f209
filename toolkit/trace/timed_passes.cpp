#include "toolkit/trace/timed_passes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <ctime>
#include <limits>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "toolkit/core/statistics.h"

namespace palpate::trace {
namespace {

using render::Frame;

constexpr std::size_t kEvictedBytes = std::size_t{64} * 1024 * 1024;
constexpr std::size_t kCacheLineBytes = 64;         // x86-64 and most ARM cores
constexpr std::int64_t kPacedPeriodNs = 1'000'000;  // the 1 kHz tick
constexpr std::size_t kProgressEveryFrames = 256;   // about 4 reports a second
constexpr std::size_t kClockEveryFrames = 256;      // during warm-up: some tens of microseconds

Error differs(const ProbePath& path, const char* pass) {
  Error error;
  error.what = std::string("the renderer answered differently in the ") + pass + " than in the untimed pass";
  error.remedy =
      "a renderer must give the same trace after every restart: check what restart() leaves behind";
  error.file = path.name;
  return error;
}

void step_range(PathRun& run, std::size_t begin, std::size_t end, FrameDigest& digest) noexcept {
  for (std::size_t i = begin; i < end; ++i) {
    run.advance(i);
    digest.add(run.step(i));
  }
}

// Times one stretch, in pieces between the models' moves.
FrameSpanTime time_stretch(PathRun& run, const FrameSpan& stretch, FrameDigest& digest) noexcept {
  FrameSpanTime time;
  for (std::size_t next = stretch.begin; next < stretch.end;) {
    run.advance(next);
    const std::size_t end = std::min(stretch.end, run.static_until(next));
    // System calls, outside the other clock's interval.
    const PageFaults faults = thread_page_faults();
    const std::int64_t cpu_ns = thread_cpu_ns();
    const std::int64_t start_ns = monotonic_ns();
    for (; next < end; ++next) digest.add(run.step(next));
    time.wall_ns += monotonic_ns() - start_ns;
    time.cpu_ns += thread_cpu_ns() - cpu_ns;
    time.page_faults += thread_page_faults() - faults;
  }
  return time;
}

// Memory walked through to evict the caches.
class Evictor {
 public:
  explicit Evictor(std::size_t bytes)
      : words_(bytes / sizeof(std::uint64_t), 1) {}  // written, so that pages exist
  void evict() noexcept {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < words_.size(); i += kCacheLineBytes / sizeof(std::uint64_t)) sum += words_[i];
    sink_ = sum;
  }

 private:
  std::vector<std::uint64_t> words_;
  volatile std::uint64_t sink_ = 0;  // prevents optimising the walk away
};

// Sleeps to the next future tick and counts the missed ones.
void sleep_to_tick(std::int64_t& next_ns, std::uint64_t& skipped) noexcept {
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

}  // namespace

std::vector<FrameSpan> frame_spans_of(std::span<const std::uint8_t> contact) {
  std::vector<FrameSpan> stretches;
  for (std::size_t i = 0; i < contact.size(); ++i) {
    const bool touches = contact[i] != 0;
    if (!stretches.empty() && stretches.back().contact == touches)
      stretches.back().end = i + 1;
    else
      stretches.push_back({i, i + 1, touches});
  }
  return stretches;
}

std::vector<std::uint8_t> contact_of(std::span<const Frame> frames) {
  std::vector<std::uint8_t> contact;
  contact.reserve(frames.size());
  for (const Frame& frame : frames) contact.push_back(frame.contact ? 1 : 0);
  return contact;
}

TimedPasses::TimedPasses(render::HapticRenderer& renderer, const ProbePath& path,
                         render::Simulation* simulation, std::span<const Frame> frames)
    : renderer_(renderer),
      path_(path),
      simulation_(simulation),
      frames_(frames),
      expected_(digest_of(frames)) {}

void TimedPasses::warm_up(double most_s) noexcept {
  PathRun run(renderer_, path_, simulation_);
  FrameDigest digest;
  run.restart();
  const std::int64_t until_ns = monotonic_ns() + static_cast<std::int64_t>(most_s * kNsPerS);
  for (std::size_t i = 0; i < run.size() && monotonic_ns() < until_ns; i += kClockEveryFrames)
    step_range(run, i, std::min(i + kClockEveryFrames, run.size()), digest);
}

Status TimedPasses::time_spans(std::span<const FrameSpan> stretches, std::span<FrameSpanTime> times) {
  PathRun run(renderer_, path_, simulation_);
  FrameDigest digest;
  run.restart();
  for (std::size_t i = 0; i < stretches.size(); ++i) times[i] = time_stretch(run, stretches[i], digest);
  if (digest.value() != expected_) return differs(path_, "pass timed by stretches");
  return Done{};
}

Status TimedPasses::time_frames(std::span<std::uint32_t> frame_ns) {
  PathRun run(renderer_, path_, simulation_);
  FrameDigest digest;
  run.restart();
  constexpr std::int64_t kMost = std::numeric_limits<std::uint32_t>::max();
  for (std::size_t i = 0; i < frame_ns.size(); ++i) {
    run.advance(i);
    const std::int64_t start_ns = monotonic_ns();
    const Frame frame = run.step(i);
    frame_ns[i] = static_cast<std::uint32_t>(std::min(monotonic_ns() - start_ns, kMost));
    digest.add(frame);
  }
  if (digest.value() != expected_) return differs(path_, "pass timed frame by frame");
  return Done{};
}

Result<PacedStatistics> TimedPasses::paced(std::size_t frames, bool evict,
                                           std::span<const std::uint8_t> contact, Progress* progress) {
  const char* const what = evict ? "paced pass with eviction" : "paced pass";
  frames = std::min(frames, path_.size());
  PathRun run(renderer_, path_, simulation_);
  PacedStatistics paced;
  const std::size_t first = densest_contact_stretch(contact, frames);
  std::vector<std::int64_t> times;
  times.reserve(frames);
  paced.evicted_bytes = evict ? kEvictedBytes : 0;
  Evictor evictor(paced.evicted_bytes);
  FrameDigest ahead, digest;
  run.restart();
  step_range(run, 0, first, ahead);
  std::uint64_t own_contact = 0, bound_hits = 0;
  std::int64_t next_ns = monotonic_ns();
  for (std::size_t i = first; i < first + frames; ++i) {
    if (progress != nullptr && (i - first) % kProgressEveryFrames == 0) {
      progress->report(what, static_cast<double>(i - first) / static_cast<double>(frames));
      if (progress->cancelled()) return Error{"stopped by the user"};
    }
    evictor.evict();
    sleep_to_tick(next_ns, paced.skipped_ticks);
    run.advance(i);
    const std::int64_t start_ns = monotonic_ns();
    const Frame frame = run.step(i);
    const std::int64_t ns = monotonic_ns() - start_ns;
    digest.add(frame);
    own_contact += frame.contact ? 1u : 0u;
    if (contact[i] == 0) continue;
    times.push_back(ns);
    bound_hits += frame.status == render::FrameStatus::kBoundHit ? 1u : 0u;
  }
  if (digest.value() != digest_of(frames_.subspan(first, frames))) return differs(path_, what);
  paced.frame = frame_statistics(std::move(times), {}, measure_clock_overhead_ns());
  paced.frame.bound_hits = bound_hits;
  paced.frame.frames = frames;
  paced.frame.contact_frames = own_contact;
  paced.first_frame = first;
  return paced;
}

namespace {

constexpr double kMicrosecondsPerNs = 1e-3;

/// The stretches of a set, and their episodes.
struct Set {
  std::vector<std::size_t> stretches;
  std::vector<std::size_t> episode;  ///< per stretch
  std::size_t episodes = 0;
};

enum class Kind { kContact, kFree, kAll };

Set set_of(const std::vector<FrameSpan>& stretches, Kind kind) {
  Set set;
  bool touched = false;
  for (std::size_t i = 0; i < stretches.size(); ++i) {
    const bool contact = stretches[i].contact;
    if (kind != Kind::kAll && contact != (kind == Kind::kContact)) continue;
    // Over all frames, a free stretch belongs to the preceding contact stretch, the first one to the
    // following.
    if (kind != Kind::kAll || set.episodes == 0 || (contact && touched)) ++set.episodes;
    touched = touched || contact;
    set.stretches.push_back(i);
    set.episode.push_back(set.episodes - 1);
  }
  return set;
}

/// Time per pass and episode, ns, and frames per episode.
struct Sums {
  std::vector<std::vector<double>> ns;
  std::vector<double> frames;
};

Sums sums_of(const PassTimes& times, const Set& set, std::int64_t FrameSpanTime::*clock) {
  Sums sums;
  sums.frames.assign(set.episodes, 0.0);
  sums.ns.assign(times.by_span.size(), std::vector<double>(set.episodes, 0.0));
  for (std::size_t k = 0; k < set.stretches.size(); ++k) {
    const FrameSpan& stretch = times.stretches[set.stretches[k]];
    sums.frames[set.episode[k]] += static_cast<double>(stretch.end - stretch.begin);
    for (std::size_t pass = 0; pass < sums.ns.size(); ++pass)
      sums.ns[pass][set.episode[k]] += static_cast<double>(times.by_span[pass][set.stretches[k]].*clock);
  }
  return sums;
}

double mean_ns(const std::vector<double>& ns, const std::vector<double>& frames,
               std::span<const std::uint32_t> counts) {
  double total_ns = 0.0, total = 0.0;
  for (std::size_t e = 0; e < ns.size(); ++e) {
    const double times = counts.empty() ? 1.0 : static_cast<double>(counts[e]);
    total_ns += times * ns[e];
    total += times * frames[e];
  }
  return total_ns / total;
}

double median_mean_ns(const Sums& sums) {
  std::vector<double> means;
  for (const std::vector<double>& pass : sums.ns) means.push_back(mean_ns(pass, sums.frames, {}));
  return upper_median(std::move(means));
}

std::optional<Interval> mean_interval(const Sums& sums) {
  std::vector<double> means(sums.ns.size()), drawn(sums.ns.size());
  std::optional<Interval> ns =
      bootstrap(sums.frames.size(), [&](std::span<const std::uint32_t> counts, Random& random) {
        for (std::size_t p = 0; p < means.size(); ++p) means[p] = mean_ns(sums.ns[p], sums.frames, counts);
        for (double& one : drawn) one = means[random.below(means.size())];
        return std::optional<double>(upper_median(drawn));
      });
  if (ns) ns = Interval{ns->low * kMicrosecondsPerNs, ns->high * kMicrosecondsPerNs};
  return ns;
}

/// A percentile of frames over draws of episodes.
std::optional<Interval> percentile_interval(const std::vector<std::int64_t>& frame_ns, const PassTimes& times,
                                            const Set& set, double percent) {
  struct Timed {
    std::int64_t ns;
    std::size_t episode;
  };
  std::vector<Timed> sorted;
  std::vector<std::uint64_t> frames(set.episodes);
  for (std::size_t k = 0; k < set.stretches.size(); ++k) {
    const FrameSpan& stretch = times.stretches[set.stretches[k]];
    frames[set.episode[k]] += stretch.end - stretch.begin;
    for (std::size_t i = stretch.begin; i < stretch.end; ++i) sorted.push_back({frame_ns[i], set.episode[k]});
  }
  // Descending: upper percentiles are reached early.
  std::sort(sorted.begin(), sorted.end(), [](const Timed& a, const Timed& b) {
    return a.ns != b.ns ? a.ns > b.ns : a.episode < b.episode;
  });
  return bootstrap(set.episodes, [&](std::span<const std::uint32_t> counts, Random&) {
    std::uint64_t all = 0;
    for (std::size_t e = 0; e < counts.size(); ++e) all += counts[e] * frames[e];
    const std::uint64_t above = all - 1 - nearest_rank_index(all, percent);
    std::uint64_t passed = 0;
    for (const Timed& one : sorted) {
      passed += counts[one.episode];
      if (passed > above) return std::optional<double>(static_cast<double>(one.ns) * kMicrosecondsPerNs);
    }
    return std::optional<double>();
  });
}

FrameStatistics statistics_of(const PassTimes& times, const Set& set,
                              const std::vector<std::int64_t>& frame_ns) {
  std::vector<std::int64_t> own;
  std::uint64_t frames = 0;
  std::uint32_t worst_ns = 0;
  for (const std::size_t s : set.stretches) {
    const FrameSpan& stretch = times.stretches[s];
    frames += stretch.end - stretch.begin;
    const auto begin = static_cast<std::ptrdiff_t>(stretch.begin),
               end = static_cast<std::ptrdiff_t>(stretch.end);
    own.insert(own.end(), frame_ns.begin() + begin, frame_ns.begin() + end);
    for (const std::vector<std::uint32_t>& pass : times.by_frame)
      worst_ns = std::max(worst_ns, *std::max_element(pass.begin() + begin, pass.begin() + end));
  }
  FrameStatistics s;
  if (frames == 0) {
    s.clock_overhead_ns = times.clock_overhead_ns;
  } else {
    const Sums wall = sums_of(times, set, &FrameSpanTime::wall_ns);
    const double mean = median_mean_ns(wall);
    const RunTime run{std::llround(mean * static_cast<double>(frames)), frames};
    s = frame_statistics(std::move(own), std::span(&run, 1), times.clock_overhead_ns);
    s.mean_interval_us = mean_interval(wall);
    constexpr double kMedian = 50.0, kTail = 99.9;
    s.p50_interval_us = percentile_interval(frame_ns, times, set, kMedian);
    s.p999_interval_us = percentile_interval(frame_ns, times, set, kTail);
    s.cpu_mean_us = median_mean_ns(sums_of(times, set, &FrameSpanTime::cpu_ns)) * kMicrosecondsPerNs;
    s.worst_us = std::max(static_cast<double>(worst_ns) * kMicrosecondsPerNs, *s.max_us);
  }
  s.passes = times.by_span.size();
  s.clocked_passes = times.by_frame.size();
  s.episodes = set.episodes;
  return s;
}

}  // namespace

PassStatistics pass_statistics(const PassTimes& times, std::span<const render::Frame> frames) {
  PassStatistics all;
  all.frame_ns.resize(frames.size());
  std::vector<std::uint32_t> of_frame(times.by_frame.size());
  for (std::size_t i = 0; i < frames.size(); ++i) {
    for (std::size_t pass = 0; pass < of_frame.size(); ++pass) of_frame[pass] = times.by_frame[pass][i];
    all.frame_ns[i] = upper_median(of_frame);
  }
  std::uint64_t own_contact = 0;
  for (const render::Frame& frame : frames) own_contact += frame.contact ? 1u : 0u;
  for (const auto& [kind, into] : {std::pair{Kind::kContact, &all.contact}, std::pair{Kind::kFree, &all.free},
                                   std::pair{Kind::kAll, &all.all}}) {
    const Set set = set_of(times.stretches, kind);
    *into = statistics_of(times, set, all.frame_ns);
    into->frames = frames.size();
    into->contact_frames = own_contact;
    for (const std::size_t s : set.stretches)
      for (std::size_t i = times.stretches[s].begin; i < times.stretches[s].end; ++i)
        into->bound_hits += frames[i].status == render::FrameStatus::kBoundHit ? 1u : 0u;
  }
  return all;
}

}  // namespace palpate::trace
