// The printed eight-point and four-point tests: what they find, and that what they miss is counted.
#include "toolkit/partition/corner_test.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/toolkit/partition/clouds.h"

namespace palpate::partition {
namespace {

/// The printed test in other words: the set of leaves that hold corners, found by asking every leaf.
template <int kAxes>
std::set<std::uint32_t> corner_ranges(const SpaceTree<kAxes>& tree, const Vec3& low, const Vec3& high) {
  std::set<std::uint32_t> begins;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 at((corner & 1) != 0 ? high.x() : low.x(), (corner & 2) != 0 ? high.y() : low.y(),
                  (corner & 4) != 0 ? high.z() : low.z());
    visit_at(tree, at, [&](PlaceRange range) {
      if (!range.empty()) begins.insert(range.begin);
      return true;
    });
  }
  return begins;
}

template <class Tree>
void expect_corners() {
  const cloud::Cloud cloud = cloud_of(sheet(60, 60, 0.1, 3));
  const Tree tree = Tree::build(cloud, {}, 1);
  Random random(5);
  for (int k = 0; k < 500; ++k) {
    const Query q = query_near(cloud, 0.1, random);
    std::set<std::uint32_t> found;
    visit_ranges_by_corners(tree, q.a_mm, q.b_mm, q.reach_mm, [&](PlaceRange range) {
      if (!range.empty() && !found.insert(range.begin).second) ADD_FAILURE() << "a leaf came twice";
      return true;
    });
    EXPECT_EQ(found, corner_ranges(tree, q.a_mm.cwiseMin(q.b_mm) - q.reach_mm,
                                   q.a_mm.cwiseMax(q.b_mm) + q.reach_mm));
  }
}

TEST(CornerTest, LooksIntoTheLeavesOfTheCorners) {
  expect_corners<Octree>();
  expect_corners<Quadtree3d>();
}

template <class Tree>
void expect_counts() {
  const cloud::Cloud cloud = cloud_of(sheet(60, 60, 0.1, 3));
  const Tree tree = Tree::build(cloud, {}, 1);
  for (const double cutoff : {0.05, 0.2, 0.8}) {
    std::uint64_t within = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i)
      for (std::size_t j = 0; j < cloud.size(); ++j)
        within += i != j && (cloud.local_mm(i) - cloud.local_mm(j)).squaredNorm() <= cutoff * cutoff;
    const CornerTestCount count = count_corner_test(tree, cloud, cutoff, 1);
    EXPECT_EQ(count.within, within);
    EXPECT_LE(count.missed, count.within);
    EXPECT_LE(count.looked_at_corners, count.looked_at_exact);
    // Leaves are some three spacings wide; a cube of eight has most of its leaves between the corners.
    if (cutoff == 0.8) {
      EXPECT_GT(count.missed, count.within / 2);
    }
  }
}

TEST(CornerTest, CountsWhatThePrintedTestMisses) {
  expect_counts<Octree>();
  expect_counts<Quadtree3d>();
}

// One leaf holds all: nothing can be missed while a corner is inside.
TEST(CornerTest, MissesNothingInOneLeaf) {
  PartitionOptions options;
  options.max_depth = 0;
  const cloud::Cloud cloud = cloud_of(sheet(20, 20, 0.1, 3));
  EXPECT_EQ(count_corner_test(Octree::build(cloud, options, 1), cloud, 0.2, 1).missed, 0u);
  EXPECT_EQ(count_corner_test(Quadtree3d::build(cloud, options, 1), cloud, 0.2, 1).missed, 0u);
}

}  // namespace
}  // namespace palpate::partition
