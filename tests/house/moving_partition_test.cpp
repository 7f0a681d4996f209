// Moving and finding points within a frame does not allocate.
#include <gtest/gtest.h>

#include <vector>

#include "tests/house/allocation_count.h"
#include "toolkit/core/random.h"
#include "toolkit/search/dynamic_grid.h"
#include "toolkit/search/dynamic_orthtree.h"

namespace palpate::search {
namespace {

template <class P>
std::uint64_t allocated() {
  Random random(41);
  std::vector<Vec3> start;
  for (int i = 0; i < 4000; ++i) start.emplace_back(random.uniform(), random.uniform(), 0.0);
  const cloud::Cloud cloud = cloud::build_cloud(start, cloud::NonFinite::kRefuse).value();
  PartitionOptions options;
  options.cell_mm = 0.05;
  P partition = P::build(cloud, options, 1);
  std::vector<Vec3f> points;
  for (const std::uint32_t i : partition.order())
    points.emplace_back(cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]);
  std::size_t visited = 0;
  const house::AllocationCount count;
  for (int k = 0; k < 20000; ++k) {
    const auto place = static_cast<std::uint32_t>(random.below(points.size()));
    const double far = k % 100 == 0 ? 5.0 : 0.1;
    const Vec3f to = points[place] +
                     Vec3(far * random.normal(), far * random.normal(), far * random.normal()).cast<float>();
    if (partition.move(place, to, [&](std::uint32_t p) { return points[p]; }) != MoveStatus::kFull)
      points[place] = to;
    visit_segment_ranges(partition, widened(to), Vec3(Vec3::Zero()), Vec3::Constant(0.01),
                         [&](IndexRange range) {
                           visited += range.end - range.begin;
                           return true;
                         });
  }
  EXPECT_GT(visited, 20000u);
  return count.count();
}

TEST(MovingPartition, AllocatesNothing) {
  EXPECT_EQ(allocated<DynamicGrid>(), 0u);
  EXPECT_EQ(allocated<DynamicOctree>(), 0u);
  EXPECT_EQ(allocated<DynamicQuadtree3d>(), 0u);
}

}  // namespace
}  // namespace palpate::search
