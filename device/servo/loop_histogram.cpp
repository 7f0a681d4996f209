#include "device/servo/loop_histogram.h"

#include <algorithm>
#include <cmath>

namespace palpate::device {
namespace {

constexpr std::size_t kBinsAStretch = DurationHistogram::kPerOctave / 4;

}  // namespace

std::uint64_t DurationHistogram::copy(Counts& counts) const noexcept {
  std::uint64_t total = 0;
  for (std::size_t i = 0; i < kBins; ++i) {
    counts[i] = bins_[i].load(std::memory_order_acquire);
    total += counts[i];
  }
  return total;
}

std::int64_t DurationHistogram::percentile_of(const Counts& counts, std::uint64_t total,
                                              double share) const noexcept {
  if (total == 0) return 0;
  const double wanted = std::ceil(std::clamp(share, 0.0, 1.0) * static_cast<double>(total));
  const std::uint64_t rank = std::clamp<std::uint64_t>(static_cast<std::uint64_t>(wanted), 1, total);
  const std::uint64_t most = max_.load(std::memory_order_relaxed);
  std::uint64_t below = 0;
  for (std::size_t i = 0; i < kBins; ++i) {
    below += counts[i];
    // The last bin has no end of its own.
    if (below >= rank) return static_cast<std::int64_t>(i + 1 == kBins ? most : std::min(top_of(i), most));
  }
  return static_cast<std::int64_t>(most);
}

std::int64_t DurationHistogram::percentile_ns(double share) const noexcept {
  Counts counts;
  const std::uint64_t total = copy(counts);
  return percentile_of(counts, total, share);
}

std::vector<DurationBin> DurationHistogram::bins() const {
  Counts counts;
  if (copy(counts) == 0) return {};
  std::vector<DurationBin> all;
  std::size_t used = 0;
  for (std::size_t first = 0; first < kBins; first += kBinsAStretch) {
    const std::size_t last = std::min(first + kBinsAStretch, kBins) - 1;
    DurationBin bin{first == 0 ? 0 : static_cast<std::int64_t>(top_of(first - 1)) + 1,
                    static_cast<std::int64_t>(top_of(last)), 0};
    for (std::size_t i = first; i <= last; ++i) bin.count += counts[i];
    if (bin.count == 0 && all.empty()) continue;
    all.push_back(bin);
    if (bin.count > 0) used = all.size();
  }
  all.resize(used);
  return all;
}

DurationStatistics DurationHistogram::statistics() const noexcept {
  Counts counts;
  DurationStatistics found;
  found.count = copy(counts);
  if (found.count == 0) return found;
  found.min_ns = static_cast<std::int64_t>(min_.load(std::memory_order_relaxed));
  found.p50_ns = percentile_of(counts, found.count, 0.5);
  found.p99_ns = percentile_of(counts, found.count, 0.99);
  found.p999_ns = percentile_of(counts, found.count, 0.999);
  found.max_ns = static_cast<std::int64_t>(max_.load(std::memory_order_relaxed));
  found.mean_ns =
      static_cast<double>(sum_.load(std::memory_order_relaxed)) / static_cast<double>(found.count);
  return found;
}

LoopStatistics LoopHistograms::statistics() const noexcept {
  LoopStatistics found;
  found.missed = missed();
  found.overruns = overruns();
  found.lateness = lateness.statistics();
  found.step = step.statistics();
  found.exchange = exchange.statistics();
  found.period = period.statistics();
  found.ticks = found.lateness.count;
  return found;
}

}  // namespace palpate::device
