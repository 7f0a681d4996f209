// Nearest rank against its definition.
#include "toolkit/core/nearest_rank.h"

#include <gtest/gtest.h>

#include <cstdint>

namespace palpate {
namespace {

TEST(Percentile, IsTheNearestRank) {
  const std::vector<std::int64_t> nine{1, 2, 3, 4, 5, 6, 7, 8, 9};
  EXPECT_EQ(nearest_rank(nine, 0.0), 1);
  EXPECT_EQ(nearest_rank(nine, 50.0), 5);  // rank ceil(4.5) = 5
  EXPECT_EQ(nearest_rank(nine, 99.0), 9);  // rank ceil(8.91) = 9
  EXPECT_EQ(nearest_rank(nine, 100.0), 9);
  const std::vector<std::int64_t> four{10, 20, 30, 40};
  EXPECT_EQ(nearest_rank(four, 25.0), 10);  // rank exactly 1
  EXPECT_EQ(nearest_rank(four, 25.1), 20);
  EXPECT_EQ(nearest_rank(four, 50.0), 20);
  const std::vector<std::int64_t> one{7};
  for (const double p : {0.0, 50.0, 99.9, 100.0}) EXPECT_EQ(nearest_rank(one, p), 7);
}

/// The definition in whole numbers: the first of the ranks that `per_mille` of all samples do not exceed.
std::size_t rank_by_counting(std::size_t n, std::size_t per_mille) {
  std::size_t rank = 1;
  while (1000 * rank < per_mille * n) ++rank;
  return rank;
}

TEST(Percentile, AgreesWithTheDefinitionForEveryCount) {
  for (std::size_t n = 1; n <= 4000; ++n)
    for (const std::size_t per_mille : {0u, 1u, 22u, 70u, 290u, 500u, 570u, 990u, 999u, 1000u})
      ASSERT_EQ(nearest_rank_index(n, static_cast<double>(per_mille) / 10.0) + 1,
                rank_by_counting(n, per_mille))
          << per_mille << " per mille of " << n;
}

TEST(Percentile, ExactRanksOfManyAreNotRoundedUp) {
  for (const std::size_t n : {10'000u, 41'000u, 82'000u, 164'000u, 100'000'000u})
    EXPECT_EQ(nearest_rank_index(n, 99.9) + 1, n / 1000 * 999) << n;
}

TEST(UpperMedian, IsTheUpperOfTwo) {
  EXPECT_EQ(upper_median(std::vector{3.0, 1.0, 2.0}), 2.0);
  EXPECT_EQ(upper_median(std::vector{4, 1, 3, 2}), 3);
  EXPECT_EQ(upper_median(std::vector{7}), 7);
}

}  // namespace
}  // namespace palpate
