#include <algorithm>
#include <cmath>
#include <cstddef>

#include "toolkit/core/bootstrap_interval.h"
#include "toolkit/core/percentiles.h"
#include "toolkit/trace/timed_passes.h"

namespace palpate::trace {
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
