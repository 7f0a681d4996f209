// Histograms of a loop's durations, in fixed memory. The loop writes them and any thread reads them.
//
// First:
//   const palpate::device::LoopStatistics loop = thread.histograms().statistics();  // while it runs too
//   std::printf("late by %lld ns at most\n", static_cast<long long>(loop.lateness.max_ns));
#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <palpate/clock.h>

namespace palpate::device {

/// A snapshot, ns.
struct DurationStatistics {
  std::uint64_t count = 0;
  std::int64_t min_ns = 0, p50_ns = 0, p99_ns = 0, p999_ns = 0,
               max_ns = 0;  ///< all 0 if nothing was counted
  double mean_ns = 0.0;
};

/// A range of durations and its count.
struct DurationBin {
  std::int64_t from_ns = 0, to_ns = 0;  ///< both inclusive
  std::uint64_t count = 0;
};

/// Log-linear bins, kPerOctave per doubling: a percentile is never below the true one and at most 1 /
/// kPerOctave above it (nor above the largest value); exact below kPerOctave ns. Minimum, maximum and mean
/// are exact.
/// One thread counts, any number read. Counting is a few loads and stores, without locks, exchanges or
/// allocation; reading never waits. A read includes everything counted before it and only whole ticks after:
/// the count is the sum of the bins, so percentiles fit it, and the maximum covers all of them. About 9 KB.
class DurationHistogram {
 public:
  static constexpr int kOctaveBits = 5;
  static constexpr std::size_t kPerOctave = std::size_t{1} << kOctaveBits;
  static constexpr int kMaxBits = 40;  ///< 18 minutes; longer durations count in the last bin
  static constexpr std::size_t kBins = kPerOctave * static_cast<std::size_t>(kMaxBits - kOctaveBits + 1);

  DurationHistogram() = default;
  DurationHistogram(const DurationHistogram&) = delete;
  DurationHistogram& operator=(const DurationHistogram&) = delete;
  ~DurationHistogram() = default;

  /// For the loop. Negative values count as 0.
  void count(std::int64_t duration_ns) noexcept {
    const std::uint64_t value = duration_ns > 0 ? static_cast<std::uint64_t>(duration_ns) : 0;
    // Extremes before the bin, so a reader of the bin sees them too.
    if (value > max_.load(std::memory_order_relaxed)) max_.store(value, std::memory_order_relaxed);
    if (value < min_.load(std::memory_order_relaxed)) min_.store(value, std::memory_order_relaxed);
    sum_.store(sum_.load(std::memory_order_relaxed) + value, std::memory_order_relaxed);
    std::atomic<std::uint64_t>& bin = bins_[bin_of(value)];
    bin.store(bin.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }

  /// Any thread. O(kBins).
  [[nodiscard]] DurationStatistics statistics() const noexcept;

  /// Counts in ranges of a quarter octave (8 ns below 32 ns), from the first non-empty to the last; for
  /// pictures. Any thread. Allocates.
  [[nodiscard]] std::vector<DurationBin> bins() const;

  /// A value's bin, and a bin's largest value.
  [[nodiscard]] static constexpr std::size_t bin_of(std::uint64_t value) noexcept {
    constexpr std::uint64_t kMost = (std::uint64_t{1} << kMaxBits) - 1;
    if (value > kMost) value = kMost;
    if (value < kPerOctave) return static_cast<std::size_t>(value);
    const int shift = static_cast<int>(std::bit_width(value)) - 1 - kOctaveBits;
    return kPerOctave * static_cast<std::size_t>(shift + 1) +
           static_cast<std::size_t>((value >> shift) - kPerOctave);
  }
  [[nodiscard]] static constexpr std::uint64_t top_of(std::size_t bin) noexcept {
    if (bin < kPerOctave) return bin;
    const auto shift = static_cast<int>(bin / kPerOctave) - 1;
    return ((std::uint64_t{kPerOctave} + bin % kPerOctave + 1) << shift) - 1;
  }

 private:
  using Counts = std::array<std::uint64_t, kBins>;
  [[nodiscard]] std::uint64_t copy(Counts& counts) const noexcept;
  /// The smallest value that a share (0 to 1) of the counts does not exceed, by bins: nearest rank.
  [[nodiscard]] std::int64_t percentile_of(const Counts& counts, std::uint64_t total,
                                           double share) const noexcept;

  std::array<std::atomic<std::uint64_t>, kBins> bins_{};
  std::atomic<std::uint64_t> max_{0};
  std::atomic<std::uint64_t> min_{~std::uint64_t{0}};
  std::atomic<std::uint64_t> sum_{0};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
};

/// A snapshot of a loop.
struct LoopStatistics {
  std::uint64_t ticks = 0;
  std::uint64_t missed = 0;    ///< whole periods without a tick
  std::uint64_t overruns = 0;  ///< ticks whose own work exceeded the period
  PageFaults page_faults;      ///< of the thread, between the loop's begin and end
  DurationStatistics lateness, step, exchange, period;
};

/// The loop's counters; see DurationHistogram for concurrent reading.
class LoopHistograms {
 public:
  /// From due to begin; includes all missed periods of a late tick.
  DurationHistogram lateness;
  DurationHistogram step;      ///< the renderer; ticks without a step are not counted
  DurationHistogram exchange;  ///< reading and sending
  DurationHistogram period;    ///< from begin to begin of successive ticks

  /// For the loop.
  void miss(std::uint64_t periods) noexcept { add(missed_, periods); }
  void overrun() noexcept { add(overruns_, 1); }
  void fault(const PageFaults& pages) noexcept {
    add(minor_faults_, pages.minor);
    add(major_faults_, pages.major);
  }

  /// Any thread.
  [[nodiscard]] LoopStatistics statistics() const noexcept;
  [[nodiscard]] std::uint64_t missed() const noexcept { return missed_.load(std::memory_order_acquire); }
  [[nodiscard]] std::uint64_t overruns() const noexcept { return overruns_.load(std::memory_order_acquire); }

 private:
  static void add(std::atomic<std::uint64_t>& to, std::uint64_t by) noexcept {
    to.store(to.load(std::memory_order_relaxed) + by, std::memory_order_release);
  }
  std::atomic<std::uint64_t> missed_{0}, overruns_{0}, minor_faults_{0}, major_faults_{0};
};

}  // namespace palpate::device
