// Timed passes: which frames belong together, what many passes say, and intervals that hold what they claim.
// Never how long anything took.
#include "toolkit/trace/passes.h"

#include <gtest/gtest.h>

#include <cmath>

#include "toolkit/core/bootstrap.h"

namespace palpate::trace {
namespace {

std::vector<render::Frame> frames_of(std::size_t n) {
  return std::vector<render::Frame>(n);
}

/// Every frame takes `ns`, in every pass.
PassTimes even(const std::vector<std::uint8_t>& contact, std::size_t passes, std::uint32_t contact_ns,
               std::uint32_t free_ns) {
  PassTimes times;
  times.stretches = stretches_of(contact);
  for (std::size_t p = 0; p < passes; ++p) {
    auto& by_stretch = times.by_stretch.emplace_back();
    for (const Stretch& s : times.stretches) {
      const auto ns = static_cast<std::int64_t>(s.end - s.begin) * (s.contact ? contact_ns : free_ns);
      by_stretch.push_back({ns, ns / 2});
    }
    auto& by_frame = times.by_frame.emplace_back();
    for (const std::uint8_t c : contact) by_frame.push_back(c != 0 ? contact_ns : free_ns);
  }
  return times;
}

TEST(Stretches, CoverThePathInOrder) {
  const std::vector<Stretch> s = stretches_of(std::vector<std::uint8_t>{0, 0, 1, 1, 1, 0, 1});
  ASSERT_EQ(s.size(), 4u);
  EXPECT_EQ(s[1].begin, 2u);
  EXPECT_EQ(s[1].end, 5u);
  EXPECT_TRUE(s[1].contact && s[3].contact && !s[0].contact && !s[2].contact);
  EXPECT_TRUE(stretches_of({}).empty());
}

TEST(PassStatistics, MeansAreTheMedianOfThePasses) {
  const std::vector<std::uint8_t> contact = {0, 1, 1, 0, 1, 0};
  PassTimes times = even(contact, 3, 200, 100);
  for (StretchTime& t : times.by_stretch[2]) t.wall_ns *= 50;  // one pass was disturbed
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
  std::vector<std::uint8_t> contact;
  for (int e = 0; e < 200; ++e) {
    contact.insert(contact.end(), 10, 1);
    contact.push_back(0);
  }
  const PassTimes alike = even(contact, 3, 200, 100);
  PassTimes unlike = alike;
  for (auto& pass : unlike.by_stretch)
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
  std::vector<std::uint8_t> contact;
  for (int e = 0; e < 100; ++e) {
    contact.insert(contact.end(), 50, 1);
    contact.push_back(0);
  }
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
