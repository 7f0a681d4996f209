// How late, how long: durations of a loop counted in bins of fixed memory, by the loop itself, read by any
// other thread while it runs.
#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace palpate::device {

/// What was counted, at one moment. In ns.
struct DurationStatistics {
  std::uint64_t count = 0;
  std::int64_t min_ns = 0, p50_ns = 0, p99_ns = 0, p999_ns = 0,
               max_ns = 0;  ///< all 0 where nothing was counted
  double mean_ns = 0.0;
};

/// A stretch of durations, and how many fell into it.
struct DurationBin {
  std::int64_t from_ns = 0, to_ns = 0;  ///< both belong to it
  std::uint64_t count = 0;
};

/// Log-linear bins: kPerOctave to each doubling, so that a percentile is never below the true one and at most
/// 1 / kPerOctave above it (nor above the largest value); below kPerOctave ns exact. Least, largest and mean
/// are exact.
///
/// One thread counts, any number read. Counting takes a handful of loads and stores: no lock, no exchange, no
/// allocation. Reading never waits. What is read holds everything counted before the reading began, and of
/// what is counted meanwhile each tick in whole numbers: the count is the sum of the bins, so the percentiles
/// fit it, and the largest value is no smaller than any that they hold. Some 9 KB.
class DurationHistogram {
 public:
  static constexpr int kOctaveBits = 5;
  static constexpr std::size_t kPerOctave = std::size_t{1} << kOctaveBits;
  static constexpr int kMostBits = 40;  ///< 18 minutes; what is longer counts in the last bin
  static constexpr std::size_t kBins = kPerOctave * static_cast<std::size_t>(kMostBits - kOctaveBits + 1);

  DurationHistogram() = default;
  DurationHistogram(const DurationHistogram&) = delete;
  DurationHistogram& operator=(const DurationHistogram&) = delete;
  ~DurationHistogram() = default;

  /// The loop. Below 0 counts as 0.
  void count(std::int64_t duration_ns) noexcept {
    const std::uint64_t value = duration_ns > 0 ? static_cast<std::uint64_t>(duration_ns) : 0;
    // Extremes before the bin: who sees the bin sees them too.
    if (value > max_.load(std::memory_order_relaxed)) max_.store(value, std::memory_order_relaxed);
    if (value < min_.load(std::memory_order_relaxed)) min_.store(value, std::memory_order_relaxed);
    sum_.store(sum_.load(std::memory_order_relaxed) + value, std::memory_order_relaxed);
    std::atomic<std::uint64_t>& bin = bins_[bin_of(value)];
    bin.store(bin.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }

  /// Any thread. O(kBins).
  [[nodiscard]] DurationStatistics statistics() const noexcept;
  /// The least value that a share `share`, 0 to 1, of what was counted does not exceed, by the bins: nearest
  /// rank. Any thread.
  [[nodiscard]] std::int64_t percentile_ns(double share) const noexcept;

  /// What was counted, in stretches of a quarter of an octave (below 32 ns: of 8 ns), from the first with
  /// anything in it to the last; for pictures. Any thread. Allocates.
  [[nodiscard]] std::vector<DurationBin> bins() const;

  /// The bin of a value, and the largest value of a bin.
  [[nodiscard]] static constexpr std::size_t bin_of(std::uint64_t value) noexcept {
    constexpr std::uint64_t kMost = (std::uint64_t{1} << kMostBits) - 1;
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
  [[nodiscard]] std::int64_t percentile_of(const Counts& counts, std::uint64_t total,
                                           double share) const noexcept;

  std::array<std::atomic<std::uint64_t>, kBins> bins_{};
  std::atomic<std::uint64_t> max_{0};
  std::atomic<std::uint64_t> min_{~std::uint64_t{0}};
  std::atomic<std::uint64_t> sum_{0};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
};

/// What a loop did, at one moment.
struct LoopStatistics {
  std::uint64_t ticks = 0;
  std::uint64_t missed = 0;    ///< whole periods without a tick
  std::uint64_t overruns = 0;  ///< ticks whose own work outlasted the period
  DurationStatistics lateness, step, exchange, period;
};

/// The loop's own book: see DurationHistogram for what reading it meanwhile gives.
class LoopHistograms {
 public:
  /// From due to begun; a tick that came late by several periods counts with all of it.
  DurationHistogram lateness;
  DurationHistogram step;      ///< the renderer; ticks without one are not counted
  DurationHistogram exchange;  ///< reading and sending
  DurationHistogram period;    ///< from the begin of a tick to the begin of the next

  /// The loop.
  void miss(std::uint64_t periods) noexcept { add(missed_, periods); }
  void overrun() noexcept { add(overruns_, 1); }

  /// Any thread.
  [[nodiscard]] LoopStatistics statistics() const noexcept;
  [[nodiscard]] std::uint64_t missed() const noexcept { return missed_.load(std::memory_order_acquire); }
  [[nodiscard]] std::uint64_t overruns() const noexcept { return overruns_.load(std::memory_order_acquire); }

 private:
  static void add(std::atomic<std::uint64_t>& to, std::uint64_t by) noexcept {
    to.store(to.load(std::memory_order_relaxed) + by, std::memory_order_release);
  }
  std::atomic<std::uint64_t> missed_{0}, overruns_{0};
};

}  // namespace palpate::device
