// Durations in bins against the durations themselves.
#include <palpate/device/loop_histogram.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <thread>
#include <utility>
#include <vector>

#include "toolkit/core/random.h"

namespace palpate::device {
namespace {

using Histogram = DurationHistogram;

std::int64_t nearest_rank_of(std::vector<std::int64_t> values, double share) {
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(values.size())));
  return values[std::max<std::size_t>(rank, 1) - 1];
}

TEST(DurationHistogram, BinsFollowEachOtherWithoutGapAndStayNarrow) {
  for (std::size_t bin = 0; bin + 1 < Histogram::kBins; ++bin) {
    const std::uint64_t top = Histogram::top_of(bin);
    ASSERT_EQ(Histogram::bin_of(top), bin);
    ASSERT_EQ(Histogram::bin_of(top + 1), bin + 1);
    const std::uint64_t least = bin == 0 ? 0 : Histogram::top_of(bin - 1) + 1;
    ASSERT_LE((top - least) * Histogram::kPerOctave, least) << "wider than the stated error";
  }
  EXPECT_EQ(Histogram::bin_of(~std::uint64_t{0}), Histogram::kBins - 1);
}

TEST(DurationHistogram, PercentilesAreThoseOfTheSortedSamplesWithinTheStatedError) {
  constexpr std::uint64_t kSeed = 7;
  SCOPED_TRACE(kSeed);
  Random random(kSeed);
  for (const double spread : {0.0, 0.3, 1.0, 3.0}) {
    Histogram histogram;
    std::vector<std::int64_t> samples;
    for (int i = 0; i < 20'001; ++i) {
      samples.push_back(static_cast<std::int64_t>(std::exp(std::log(5e4) + spread * random.normal())));
      histogram.count(samples.back());
    }
    const DurationStatistics all = histogram.statistics();
    for (const auto& [share, found] :
         {std::pair{0.5, all.p50_ns}, std::pair{0.99, all.p99_ns}, std::pair{0.999, all.p999_ns}}) {
      const std::int64_t truth = nearest_rank_of(samples, share);
      ASSERT_GE(found, truth) << share << " spread " << spread;
      ASSERT_LE(static_cast<double>(found - truth),
                static_cast<double>(truth) / static_cast<double>(Histogram::kPerOctave))
          << share << " spread " << spread;
    }
    EXPECT_EQ(all.count, samples.size());
    EXPECT_EQ(all.min_ns, *std::min_element(samples.begin(), samples.end()));
    EXPECT_EQ(all.max_ns, *std::max_element(samples.begin(), samples.end()));
    const std::int64_t sum = std::accumulate(samples.begin(), samples.end(), std::int64_t{0});
    EXPECT_DOUBLE_EQ(all.mean_ns, static_cast<double>(sum) / static_cast<double>(samples.size()));
  }
}

TEST(DurationHistogram, NothingNegativeAndTooLongAllHaveTheirPlace) {
  Histogram histogram;
  EXPECT_EQ(histogram.statistics().count, 0u);
  EXPECT_EQ(histogram.statistics().max_ns, 0);
  EXPECT_EQ(histogram.statistics().p50_ns, 0);
  histogram.count(-5);
  EXPECT_EQ(histogram.statistics().p50_ns, 0);
  constexpr std::int64_t kHourNs = 3'600'000'000'000;
  histogram.count(kHourNs);
  histogram.count(2 * kHourNs);
  const DurationStatistics all = histogram.statistics();
  EXPECT_EQ(all.count, 3u);
  EXPECT_EQ(all.min_ns, 0);
  EXPECT_EQ(all.max_ns, 2 * kHourNs);
  EXPECT_EQ(all.p999_ns, 2 * kHourNs) << "the last bin has no end: the largest is told";
}

TEST(LoopHistograms, CountsAreReadAsTheyWereCounted) {
  LoopHistograms book;
  for (int i = 0; i < 10; ++i) book.lateness.count(i);
  for (int i = 0; i < 9; ++i) book.period.count(1000);
  book.step.count(7);
  book.exchange.count(3);
  book.miss(4);
  book.miss(1);
  book.overrun();
  const LoopStatistics all = book.statistics();
  EXPECT_EQ(all.ticks, 10u);
  EXPECT_EQ(all.missed, 5u);
  EXPECT_EQ(all.overruns, 1u);
  EXPECT_EQ(all.period.count, 9u);
  EXPECT_EQ(all.step.max_ns, 7);
  EXPECT_EQ(all.exchange.p50_ns, 3);
}

/// What ThreadSanitizer watches: a reader beside the loop that counts at full speed.
TEST(DurationHistogram, AReaderBesideTheLoopSeesWholeNumbersThatFitEachOther) {
  constexpr std::uint64_t kCounts = 100'000;
  Histogram histogram;
  std::atomic<bool> done{false};
  std::uint64_t wrong = 0, back = 0, reads = 0, last = 0;
  std::thread reader([&] {
    while (!done.load() || reads == 0) {
      const DurationStatistics seen = histogram.statistics();
      ++reads;
      back += seen.count < last ? 1u : 0u;
      last = seen.count;
      if (seen.count == 0) continue;
      const bool fits = seen.count <= kCounts && seen.p50_ns <= seen.p99_ns && seen.p99_ns <= seen.p999_ns &&
                        seen.p999_ns <= seen.max_ns && seen.max_ns <= 1'000'000 && seen.min_ns <= seen.p50_ns;
      wrong += fits ? 0u : 1u;
    }
  });
  for (std::uint64_t i = 0; i < kCounts; ++i)
    histogram.count(static_cast<std::int64_t>(i * 7919 % 1'000'001));
  done.store(true);
  reader.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_EQ(back, 0u);
  EXPECT_EQ(histogram.statistics().count, kCounts);
}

TEST(DurationHistogram, StretchesForAPictureHoldEverythingOnce) {
  DurationHistogram histogram;
  EXPECT_TRUE(histogram.bins().empty());
  const std::vector<std::int64_t> counted = {0, 7, 8, 31, 32, 39, 40, 1000, 1'000'000, 123'456'789};
  for (const std::int64_t ns : counted) histogram.count(ns);
  const std::vector<DurationBin> bins = histogram.bins();
  std::uint64_t all = 0;
  for (std::size_t i = 0; i < bins.size(); ++i) {
    all += bins[i].count;
    if (i > 0) {
      EXPECT_EQ(bins[i].from_ns, bins[i - 1].to_ns + 1);
    }
    std::uint64_t within = 0;
    for (const std::int64_t ns : counted)
      if (ns >= bins[i].from_ns && ns <= bins[i].to_ns) ++within;
    EXPECT_EQ(bins[i].count, within) << bins[i].from_ns;
    EXPECT_LE(bins[i].to_ns + 1 - bins[i].from_ns, std::max<std::int64_t>(8, bins[i].from_ns / 4));
  }
  EXPECT_EQ(all, counted.size());
  EXPECT_EQ(bins.front().from_ns, 0);
  EXPECT_GT(bins.back().count, 0u);
}

}  // namespace
}  // namespace palpate::device
