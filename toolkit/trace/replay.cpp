#include <palpate/replay.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "toolkit/core/statistics.h"
#include "toolkit/trace/timed_passes.h"

namespace palpate::trace {
namespace {

using render::Frame;
using render::HapticRenderer;

constexpr std::int64_t kFirstPathLine = 2;  // line 1 of a path file is its header
constexpr std::size_t kClockPairs = 4096;   // enough for a stable median, well under a millisecond
constexpr double kUsPerNs = 1e-3;

double mean_us_of(std::int64_t total_ns, std::uint64_t frames) {
  return static_cast<double>(total_ns) * kUsPerNs / static_cast<double>(frames);
}

// One pass of each kind over the frames that the renderer reports in contact.
Status time_once(TimedPasses& passes, ReplayReport& report) {
  const std::vector<std::uint8_t> contact = contact_of(report.trace.frames);
  PassTimes times;
  times.stretches = frame_spans_of(contact);
  PALPATE_TRY(passes.time_spans(times.stretches, times.by_span.emplace_back(times.stretches.size())));
  PALPATE_TRY(passes.time_frames(times.by_frame.emplace_back(report.trace.frames.size())));
  times.clock_overhead_ns = measure_clock_overhead_ns();
  PassStatistics statistics = pass_statistics(times, report.trace.frames);
  report.contact = statistics.contact;
  report.free = statistics.free;
  report.all = statistics.all;
  report.trace.frame_ns = std::move(statistics.frame_ns);
  return Done{};
}

}  // namespace

Status check_path(const PathView& path) {
  const auto wrong = [&](std::size_t sample, std::string what, std::string remedy) {
    return Error{std::move(what), std::move(remedy), std::string(path.name),
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
  const auto longer_than = [&](std::int64_t ns) {
    return static_cast<std::uint64_t>(times.end() - std::upper_bound(times.begin(), times.end(), ns));
  };
  s.deadline_misses_1khz = longer_than(kDeadline1KhzNs);
  s.deadline_misses_5khz = longer_than(kDeadline5KhzNs);
  s.deadline_misses_10khz = longer_than(kDeadline10KhzNs);
  const std::int64_t total_ns = std::accumulate(times.begin(), times.end(), std::int64_t{0});
  // A mean of equal numbers may round beyond them; the clamps only undo that.
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

std::size_t densest_contact_stretch(std::span<const std::uint8_t> contact, std::size_t frames) {
  if (frames == 0 || frames >= contact.size()) return 0;
  std::size_t inside = 0;
  for (std::size_t i = 0; i < frames; ++i) inside += contact[i] != 0 ? 1u : 0u;
  std::size_t best = inside, best_start = 0;
  for (std::size_t start = 1; start + frames <= contact.size(); ++start) {
    inside += contact[start + frames - 1] != 0 ? 1u : 0u;
    inside -= contact[start - 1] != 0 ? 1u : 0u;
    if (inside > best) {
      best = inside;
      best_start = start;
    }
  }
  return best_start;
}

Result<ForceTrace> replay(HapticRenderer& renderer, const PathView& path, render::Simulation* simulation) {
  PALPATE_TRY(check_path(path));
  ForceTrace trace;
  trace.label = renderer.describe().name;
  trace.frames.reserve(path.size());
  PathRun run(renderer, path, simulation);
  run.restart();
  for (std::size_t i = 0; i < path.size(); ++i) {
    run.advance(i);
    trace.frames.push_back(run.step(i));
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
  TimedPasses passes(renderer, path, options.simulation, report.trace.frames);
  PALPATE_TRY(time_once(passes, report));
  const std::vector<std::uint8_t> contact = contact_of(report.trace.frames);
  struct Wanted {
    std::uint64_t frames;
    bool evict;
    std::optional<PacedStatistics>& out;
  };
  for (const Wanted& wanted : {Wanted{options.paced_frames, false, report.paced},
                               Wanted{options.paced_evicted_frames, true, report.paced_evicted}}) {
    if (wanted.frames == 0) continue;
    PALPATE_ASSIGN(const PacedStatistics paced,
                   passes.paced(wanted.frames, wanted.evict, contact, options.progress));
    wanted.out = paced;
  }
  return report;
}

}  // namespace palpate::trace
