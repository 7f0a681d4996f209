#include "toolkit/metrics/stream_scores.h"

#include <algorithm>
#include <vector>

#include "toolkit/core/statistics.h"

namespace palpate::metrics {
namespace {

constexpr double kStreamMsPerS = 1e3;

void raise(std::optional<double>& most, double value) {
  most = std::max(most.value_or(0.0), value);
}

}  // namespace

StreamScores score_stream(const trace::ProbePath& path, const trace::ForceTrace& trace,
                          std::span<const StreamDelivery> deliveries, double stiffness_n_per_mm) {
  using stream::FrameFate;
  StreamScores scores;
  std::vector<double> window, whole, light, steps;
  std::size_t next = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    bool swapped = false;
    for (; next < deliveries.size() && deliveries[next].due_s <= path.t_s[i]; ++next) {
      const StreamDelivery& one = deliveries[next];
      ++scores.frames;
      scores.repeated += one.report.fate == FrameFate::kRepeated ? 1u : 0u;
      scores.late += one.report.fate == FrameFate::kLate ? 1u : 0u;
      scores.truncated += one.report.fate == FrameFate::kTruncated ? 1u : 0u;
      scores.failed += one.report.fate == FrameFate::kFailed ? 1u : 0u;
      if (one.report.fate != FrameFate::kTaken) continue;
      ++scores.taken;
      swapped = true;
      window.push_back(one.report.window_ms);
      whole.push_back(one.report.whole_ms);
      light.push_back((path.t_s[i] - one.captured_s) * kStreamMsPerS);
    }
    if (swapped && scores.swaps_s.size() < kMostSwapTimes) scores.swaps_s.push_back(path.t_s[i]);
    if (i == 0 || (!trace.frames[i].contact && !trace.frames[i - 1].contact)) continue;
    scores.releases += trace.frames[i].contact ? 0u : 1u;
    const double excess_n =
        std::max(0.0, (trace.frames[i].force_n - trace.frames[i - 1].force_n).norm() -
                          stiffness_n_per_mm * (path.hip_mm[i] - path.hip_mm[i - 1]).norm());
    raise(scores.rate_max_n_per_ms, excess_n / ((path.t_s[i] - path.t_s[i - 1]) * kStreamMsPerS));
    if (!swapped) continue;
    ++scores.swaps_in_contact;
    steps.push_back(excess_n);
  }
  median_and_tail(std::move(window), scores.window_p50_ms, scores.window_p99_ms);
  median_and_tail(std::move(whole), scores.whole_p50_ms, scores.whole_p99_ms);
  median_and_tail(std::move(light), scores.light_to_tick_p50_ms, scores.light_to_tick_p99_ms);
  if (!steps.empty()) {
    scores.swap_step_max_n = *std::max_element(steps.begin(), steps.end());
    std::optional<double> median;
    median_and_tail(std::move(steps), median, scores.swap_step_p99_n);
  }
  return scores;
}

}  // namespace palpate::metrics
