// Each partition against brute force: no point box that a segment touches is left out.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "tests/toolkit/search/cases.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/search/orthtree.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::search {
namespace {

template <class P>
class EachPartition : public testing::Test {};
using Partitions = testing::Types<UniformGrid, Octree, Quadtree3d>;
TYPED_TEST_SUITE(EachPartition, Partitions, PartitionNames);

template <class P>
P built(const cloud::Cloud& cloud, double step_mm, int threads = 1) {
  PartitionOptions options;
  options.cell_mm = 5.0 * step_mm;
  return P::build(cloud, options, threads);
}

/// Times each place was visited.
template <class P>
std::vector<int> visits(const P& partition, std::size_t n, const Query& q) {
  std::vector<int> times(n, 0);
  EXPECT_TRUE(visit_segment_ranges(partition, q.a_mm, q.b_mm, q.reach_mm, [&](IndexRange range) {
    for (std::uint32_t place = range.begin; place < range.end; ++place) ++times[place];
    return true;
  }));
  return times;
}

TYPED_TEST(EachPartition, OrdersEveryPointOnce) {
  for (const PartitionCase& c : partition_cases()) {
    const cloud::Cloud cloud = cloud_of(c.points);
    const TypeParam partition = built<TypeParam>(cloud, c.step_mm);
    std::vector<std::uint32_t> sorted(partition.order().begin(), partition.order().end());
    std::sort(sorted.begin(), sorted.end());
    ASSERT_EQ(sorted.size(), cloud.size()) << c.name;
    for (std::uint32_t i = 0; i < sorted.size(); ++i) ASSERT_EQ(sorted[i], i) << c.name;
    const LeafStatistics shape = partition.statistics();
    EXPECT_NEAR(shape.mean_points * static_cast<double>(shape.leaves), static_cast<double>(cloud.size()),
                1e-6 * static_cast<double>(cloud.size()))
        << c.name;
    EXPECT_GE(shape.max_points, shape.mean_points) << c.name;
  }
}

TYPED_TEST(EachPartition, MissesNoBoxThatASegmentTouches) {
  for (const PartitionCase& c : partition_cases()) {
    const cloud::Cloud cloud = cloud_of(c.points);
    const TypeParam partition = built<TypeParam>(cloud, c.step_mm);
    const auto order = partition.order();
    Random random(7);
    std::size_t touched = 0, looked_at = 0;
    for (int k = 0; k < 300; ++k) {
      const Query q = query_near(cloud, c.step_mm, random);
      const std::vector<int> times = visits(partition, cloud.size(), q);
      const geometry::SegmentProbe probe(q.a_mm, q.b_mm);
      for (std::size_t place = 0; place < times.size(); ++place) {
        ASSERT_LE(times[place], 1) << c.name;
        looked_at += static_cast<std::size_t>(times[place]);
        if (!geometry::segment_touches_box(probe, cloud.local_mm(order[place]), q.reach_mm)) continue;
        ++touched;
        ASSERT_EQ(times[place], 1) << c.name << " query " << k << " place " << place;
      }
    }
    EXPECT_GT(touched, 0u) << c.name;
    EXPECT_GE(looked_at, touched) << c.name;
  }
}

TYPED_TEST(EachPartition, HoldsAPointInTheLeafThatIsFoundForIt) {
  for (const PartitionCase& c : partition_cases()) {
    const cloud::Cloud cloud = cloud_of(c.points);
    const TypeParam partition = built<TypeParam>(cloud, c.step_mm);
    for (std::uint32_t place = 0; place < cloud.size(); ++place) {
      int calls = 0;
      visit_point_range(partition, cloud.local_mm(partition.order()[place]), [&](IndexRange range) {
        ++calls;
        EXPECT_TRUE(range.begin <= place && place < range.end) << c.name << " place " << place;
        return true;
      });
      ASSERT_EQ(calls, 1);
    }
    visit_point_range(partition, Vec3::Constant(1e9 * c.step_mm), [&](IndexRange range) {
      EXPECT_TRUE(range.empty()) << c.name;
      return true;
    });
  }
}

TYPED_TEST(EachPartition, IsTheSameForAnyNumberOfThreadsAndVisitsInOneOrder) {
  const cloud::Cloud cloud = cloud_of(sheet(400, 400, 0.1, 9));
  const TypeParam one = built<TypeParam>(cloud, 0.1, 1), many = built<TypeParam>(cloud, 0.1, 4);
  ASSERT_TRUE(std::equal(one.order().begin(), one.order().end(), many.order().begin()));
  Random random(3);
  for (int k = 0; k < 50; ++k) {
    const Query q = query_near(cloud, 0.1, random);
    std::vector<std::uint32_t> begins[2];
    for (const bool threaded : {false, true})
      visit_segment_ranges(threaded ? many : one, q.a_mm, q.b_mm, q.reach_mm, [&](IndexRange r) {
        begins[threaded].push_back(r.begin);
        return true;
      });
    ASSERT_EQ(begins[0], begins[1]);
  }
}

TYPED_TEST(EachPartition, StopsWhenToldAndTouchesNothingWithoutANumber) {
  const cloud::Cloud cloud = cloud_of(sheet(40, 40, 0.1, 2));
  const TypeParam partition = built<TypeParam>(cloud, 0.1);
  int calls = 0;
  EXPECT_FALSE(visit_segment_ranges(partition, cloud.local_mm(0), cloud.local_mm(1599), Vec3::Constant(0.1),
                                    [&](IndexRange) { return ++calls < 3; }));
  EXPECT_EQ(calls, 3);
  const Vec3 bad(0.0, std::numeric_limits<double>::quiet_NaN(), 0.0);
  const Vec3 endless = Vec3::Constant(std::numeric_limits<double>::infinity());
  for (const Vec3& b : {bad, endless})
    EXPECT_TRUE(visit_segment_ranges(partition, Vec3(Vec3::Zero()), b, Vec3::Constant(0.1), [&](IndexRange) {
      ADD_FAILURE();
      return true;
    }));
}

template <class Tree>
void expect_full_leaves(std::uint32_t max_points, int max_depth) {
  for (const PartitionCase& c : partition_cases()) {
    const cloud::Cloud cloud = cloud_of(c.points);
    PartitionOptions options;
    options.max_points = max_points;
    options.max_depth = max_depth;
    const Tree tree = Tree::build(cloud, options, 1);
    const LeafStatistics shape = tree.statistics();
    EXPECT_LE(shape.max_depth, max_depth) << c.name;
    if (shape.max_depth < max_depth) {
      EXPECT_LE(shape.max_points, max_points) << c.name;
    }
    // No node was divided that need not be.
    for (const TreeNode& node : tree.nodes())
      EXPECT_TRUE(node.child == 0 || node.end - node.begin > max_points) << c.name;
  }
}

TEST(Orthtree, DividesNodesOfMoreThanItsLeafSizeAndNoOthers) {
  expect_full_leaves<Octree>(10, 21);
  expect_full_leaves<Quadtree3d>(10, 21);
  expect_full_leaves<Octree>(1, 21);
  expect_full_leaves<Octree>(64, 4);
  expect_full_leaves<Quadtree3d>(3, 0);
}

// Section 3.1.2.1's sum: a complete octree of 8^7 points with one point a leaf has 2,396,745 nodes (the text
// prints 2,392,064); here 8^4 of them, 4681.
TEST(Orthtree, NeedsTheNodesOfACompleteOctree) {
  std::vector<Vec3> points;
  for (int i = 0; i < 4096; ++i) points.emplace_back(i % 16, i / 16 % 16, i / 256);
  PartitionOptions options;
  options.max_points = 1;
  const LeafStatistics one = Octree::build(cloud_of(points), options, 1).statistics();
  EXPECT_EQ(one.nodes, 4681u);
  EXPECT_EQ(one.leaves, 4096u);
  EXPECT_EQ(one.max_depth, 4);
  options.max_points = 10;  // eight a leaf
  EXPECT_EQ(Octree::build(cloud_of(points), options, 1).statistics().nodes, 585u);
}

}  // namespace
}  // namespace palpate::search
