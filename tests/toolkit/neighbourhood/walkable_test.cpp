// Tables that a walk can follow: scan lines far apart, clumps, and no change where points lie evenly.
#include "toolkit/neighbourhood/walkable.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/neighbourhood/knn.h"

namespace palpate::neighbourhood {
namespace {

/// Share of walks from a random point to another that come to it.
double arrivals(const cloud::Cloud& cloud, const NeighbourTable& table, std::uint64_t seed) {
  Random random(seed);
  constexpr int kWalks = 2000;
  int arrived = 0;
  for (int w = 0; w < kWalks; ++w) {
    const auto pick = [&] {
      const double at = random.uniform() * static_cast<double>(cloud.size());
      return std::min(static_cast<std::uint32_t>(at), static_cast<std::uint32_t>(cloud.size() - 1));
    };
    std::uint32_t at = pick();
    const Vec3 goal = cloud.local_mm(pick());
    for (bool moved = true; moved;) {
      moved = false;
      std::uint32_t best = at;
      for (const std::uint32_t n : table.of[at])
        if ((cloud.local_mm(n) - goal).squaredNorm() < (cloud.local_mm(best) - goal).squaredNorm()) best = n;
      moved = best != at;
      at = best;
    }
    arrived += cloud.local_mm(at) == goal;
  }
  return static_cast<double>(arrived) / kWalks;
}

std::vector<Vec3> lines(double apart) {
  Random random(2);
  std::vector<Vec3> points;
  for (int r = 0; r < 30; ++r)
    for (int c = 0; c < 200; ++c)
      points.emplace_back(0.1 * (c + 0.2 * random.uniform()), apart * r, 0.01 * random.uniform());
  return points;
}

TEST(Walkable, ScanLinesFarApartAreJoined) {
  const cloud::Cloud cloud = cloud::build_cloud(lines(0.6), cloud::NonFinite::kRefuse).value();
  NeighbourTable table = exact_knn(cloud, 0);
  EXPECT_LT(arrivals(cloud, table, 1), 0.1);  // the eight nearest stay in their line
  const WalkableReport report = make_walkable(cloud, table, 0);
  EXPECT_GT(report.spread, cloud.size() / 2);
  EXPECT_GT(arrivals(cloud, table, 1), 0.99);
}

TEST(Walkable, AClumpIsLeftAgain) {
  Random random(3);
  std::vector<Vec3> points;
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 40; ++c) points.emplace_back(c, r, 0.0);
  for (int k = 0; k < 20; ++k) {
    const Vec3 middle(5.3 + (k % 5) * 7.0, 4.6 + (k / 5) * 9.0, 0.0);
    for (int i = 0; i < 12; ++i)
      points.push_back(middle + 0.01 * Vec3(random.normal(), random.normal(), random.normal()));
  }
  const cloud::Cloud cloud = cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
  NeighbourTable table = exact_knn(cloud, 0);
  const double before = arrivals(cloud, table, 4);
  const WalkableReport report = make_walkable(cloud, table, 0);
  EXPECT_GT(report.spread + report.returned, 0u);
  const double after = arrivals(cloud, table, 4);
  EXPECT_LT(before, 0.9);
  EXPECT_GT(after, 0.97);
}

TEST(Walkable, AnEvenLatticeStaysInside) {
  std::vector<Vec3> points;
  for (int r = 0; r < 30; ++r)
    for (int c = 0; c < 30; ++c) points.emplace_back(c, r, 0.0);
  const cloud::Cloud cloud = cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
  NeighbourTable table = exact_knn(cloud, 0);
  const NeighbourTable before = table;
  make_walkable(cloud, table, 0);
  for (std::uint32_t r = 2; r < 28; ++r)
    for (std::uint32_t c = 2; c < 28; ++c) EXPECT_EQ(table.of[r * 30 + c], before.of[r * 30 + c]);
}

TEST(Walkable, RowsAreOrderedAndTheSameForAnyNumberOfThreads) {
  std::vector<Vec3> points = lines(0.45);
  for (int i = 0; i < 30; ++i) points.push_back(points[7]);
  const cloud::Cloud cloud = cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
  NeighbourTable one = exact_knn(cloud, 1), all = exact_knn(cloud, 0);
  make_walkable(cloud, one, 1);
  make_walkable(cloud, all, 0);
  EXPECT_EQ(one.of, all.of);
  for (std::uint32_t i = 0; i < one.size(); ++i)
    for (std::size_t k = 1; k < kNeighbours; ++k) {
      if (one.of[i][k] == i) continue;
      const double a = (cloud.local_mm(one.of[i][k - 1]) - cloud.local_mm(i)).squaredNorm(),
                   b = (cloud.local_mm(one.of[i][k]) - cloud.local_mm(i)).squaredNorm();
      ASSERT_TRUE(a < b || (a == b && one.of[i][k - 1] < one.of[i][k]));
    }
}

TEST(Walkable, TinyCloudsAreSurvived) {
  for (std::size_t n = 1; n < 12; ++n) {
    std::vector<Vec3> points;
    for (std::size_t i = 0; i < n; ++i)
      points.emplace_back(static_cast<double>(i % 3), i == 5 ? 1.0 : 0.0, 0.0);
    const cloud::Cloud cloud = cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
    NeighbourTable table = exact_knn(cloud, 0);
    make_walkable(cloud, table, 0);
    EXPECT_EQ(table.size(), n);
  }
}

}  // namespace
}  // namespace palpate::neighbourhood
