// The search for points around any place, against looking at every point.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <set>
#include <vector>

#include "tests/toolkit/search/cases.h"
#include "toolkit/search/point_search.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::search {
namespace {

std::size_t nearest_of_all(const cloud::Cloud& cloud, const Vec3& p) {
  std::size_t best = 0;
  for (std::size_t i = 1; i < cloud.size(); ++i) {
    const Vec3 local = p - cloud.origin_mm;
    if ((cloud.local_mm(i) - local).squaredNorm() < (cloud.local_mm(best) - local).squaredNorm()) best = i;
  }
  return best;
}

/// Near the points, outside their box, and far away.
Vec3 some_place(const cloud::Cloud& cloud, double step, int i, Random& random) {
  const double reach = i % 4 == 0 ? 1e5 : i % 4 == 1 ? 30.0 : 2.0;
  return cloud.point_mm(random.below(cloud.size())) +
         reach * step * Vec3(random.normal(), random.normal(), random.normal());
}

TEST(PointSearch, NearestAgreesWithLookingAtAll) {
  constexpr std::uint64_t kSeed = 11;
  SCOPED_TRACE(kSeed);
  Random random(kSeed);
  for (const PartitionCase& one : partition_cases()) {
    const cloud::Cloud cloud = cloud_of(one.points);
    const PointSearch usual(cloud), fine(cloud, 0.1 * one.step_mm), coarse(cloud, 20.0 * one.step_mm, 2);
    for (int i = 0; i < 200; ++i) {
      const Vec3 p = some_place(cloud, one.step_mm, i, random);
      const std::size_t wanted = nearest_of_all(cloud, p);
      ASSERT_EQ(usual.nearest(p), wanted) << one.name << " query " << i;
      if (i % 8 < 2) {  // far places cost it many rings
        ASSERT_EQ(fine.nearest(p), wanted) << one.name << " query " << i;
      }
      ASSERT_EQ(coarse.nearest(p), wanted) << one.name << " query " << i;
    }
  }
}

TEST(PointSearch, OfEquallyNearPointsTheFirst) {
  std::vector<Vec3> points;
  for (const Vec3& at : {Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, -1), Vec3(-1, 0, 0)})
    points.push_back(8.0 * at);
  const cloud::Cloud cloud = cloud_of(points);
  const PointSearch search(cloud);
  EXPECT_EQ(search.nearest({0, 0, 0}), 0u);
  EXPECT_EQ(search.nearest({-3, 0, 0}), 1u);
  EXPECT_EQ(search.nearest({-3, 3, 0}), 1u);
}

TEST(PointSearch, AroundGivesTheBallInTheOrderOfCells) {
  Random random(12);
  for (const PartitionCase& one : partition_cases()) {
    const cloud::Cloud cloud = cloud_of(one.points);
    const double cell = 4.0 * one.step_mm;
    const PointSearch search(cloud, cell);
    const UniformGrid grid = UniformGrid::build(cloud, cell, 1);
    const auto cell_of = [&](const Vec3& p) {
      const Cell c = grid.cell_of(p);
      return std::array{c.z, c.y, c.x};
    };
    for (int i = 0; i < 50; ++i) {
      const Vec3 p = some_place(cloud, one.step_mm, i, random) - cloud.origin_mm;
      std::vector<Vec3> seen;
      search.around(p, cloud.size(), [&](const Vec3& q) { seen.push_back(q); });
      std::size_t in_ball = 0, in_ball_of_all = 0;
      for (const Vec3& q : seen) in_ball += (q - p).squaredNorm() < cell * cell;
      for (std::size_t k = 0; k < cloud.size(); ++k)
        in_ball_of_all += (cloud.local_mm(k) - p).squaredNorm() < cell * cell;
      ASSERT_EQ(in_ball, in_ball_of_all) << one.name << " query " << i;
      for (std::size_t k = 1; k < seen.size(); ++k) ASSERT_LE(cell_of(seen[k - 1]), cell_of(seen[k]));
      std::size_t few = 0;
      search.around(p, 3, [&](const Vec3&) { ++few; });
      ASSERT_EQ(few, std::min<std::size_t>(3, seen.size()));
    }
  }
}

TEST(PointSearch, APileComesInTheOrderOfTheCloud) {
  // Eight points of one cell, stored against the order of the Morton curve.
  std::vector<Vec3> points;
  for (int i = 7; i >= 0; --i) points.emplace_back(0.3 * (i & 1), 0.3 * (i >> 1 & 1), 0.3 * (i >> 2));
  const cloud::Cloud cloud = cloud_of(points);
  const PointSearch search(cloud, 1.0);
  std::size_t next = 0;
  search.around(cloud.local_mm(0), cloud.size(),
                [&](const Vec3& q) { EXPECT_EQ(q, cloud.local_mm(next++)); });
  EXPECT_EQ(next, 8u);
}

TEST(PointSearch, WithinIsTheBall) {
  Random random(13);
  for (const PartitionCase& one : partition_cases()) {
    const cloud::Cloud cloud = cloud_of(one.points);
    const UniformGrid grid = UniformGrid::build(cloud, 5.0 * one.step_mm, 1);
    for (int i = 0; i < 50; ++i) {
      const Vec3 p = some_place(cloud, one.step_mm, i, random) - cloud.origin_mm;
      const double radius = one.step_mm * random.uniform(0.0, 8.0);
      std::set<std::uint32_t> found, wanted;
      visit_within(
          grid, [&](std::uint32_t place) { return cloud.local_mm(grid.order()[place]); }, p, radius,
          [&](std::uint32_t place, double sq) {
            EXPECT_LE(sq, radius * radius);
            EXPECT_TRUE(found.insert(grid.order()[place]).second);
          });
      for (std::size_t k = 0; k < cloud.size(); ++k)
        if ((cloud.local_mm(k) - p).squaredNorm() <= radius * radius)
          wanted.insert(static_cast<std::uint32_t>(k));
      ASSERT_EQ(found, wanted) << one.name << " query " << i;
    }
  }
}

}  // namespace
}  // namespace palpate::search
