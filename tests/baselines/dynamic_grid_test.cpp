// The grid of moving points against brute force: after any moves it answers as if built anew.
#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <string>
#include <tuple>
#include <vector>

#include "baselines/points/dynamic_grid.h"
#include "tests/house/allocation_count.h"
#include "tests/toolkit/search/cases.h"
#include "toolkit/core/random.h"
#include "toolkit/geometry/segment_box.h"

namespace palpate::baselines {
namespace {

using search::cloud_of, search::IndexRange, search::LeafStatistics, search::partition_cases;
using search::PartitionCase, search::PartitionOptions, search::Query, search::sheet;

/// The owner of the points: stores floats by place, as a model does.
struct Model {
  DynamicGrid partition;
  std::vector<Vec3f> points;
  double step_mm;

  explicit Model(const PartitionCase& c, double spare = 0.25) : step_mm(c.step_mm) {
    const cloud::Cloud cloud = cloud_of(c.points);
    PartitionOptions options;
    options.cell_mm = 5.0 * c.step_mm;
    options.spare = spare;
    partition = DynamicGrid::build(cloud, options, 1);
    for (const std::uint32_t i : partition.order())
      points.emplace_back(cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]);
  }
  Vec3 at(std::size_t place) const { return widened(points[place]); }
  MoveStatus move(std::uint32_t place, const Vec3& to) {
    const Vec3f stored = to.cast<float>();
    const MoveStatus status = partition.move(place, points[place], stored);
    if (status != MoveStatus::kFull) points[place] = stored;
    return status;
  }

  void expect_right(Random& random, const std::string& what) const {
    std::size_t most = 0;
    for (int k = 0; k < 20; ++k) {
      Query q;
      q.a_mm = at(random.below(points.size()));
      q.b_mm = k % 2 == 0 ? Vec3(q.a_mm + step_mm * Vec3(random.normal(), random.normal(), random.normal()))
                          : Vec3(q.a_mm + 1e-3 * (at(random.below(points.size())) - q.a_mm));
      q.reach_mm = Vec3::Constant(step_mm * random.uniform());
      std::vector<int> times(points.size(), 0);
      visit_segment_ranges(partition, q.a_mm, q.b_mm, q.reach_mm, [&](IndexRange range) {
        for (std::uint32_t place = range.begin; place < range.end; ++place) ++times[place];
        return true;
      });
      const geometry::SegmentProbe probe(q.a_mm, q.b_mm);
      for (std::size_t place = 0; place < times.size(); ++place) {
        ASSERT_LE(times[place], 1) << what << " place " << place;
        if (geometry::segment_touches_box(probe, at(place), q.reach_mm)) {
          ASSERT_EQ(times[place], 1) << what << " place " << place;
          ++most;
        }
      }
    }
    EXPECT_GE(most, 20u) << what;  // each query starts at a point
    for (std::uint32_t place = 0; place < points.size(); ++place) {
      int times = 0;
      visit_point_range(partition, at(place), [&](IndexRange range) {
        times += range.begin <= place && place < range.end;
        return true;
      });
      ASSERT_EQ(times, 1) << what << " place " << place;
    }
    const LeafStatistics shape = partition.statistics();
    EXPECT_NEAR(shape.mean_points * static_cast<double>(shape.leaves), static_cast<double>(points.size()),
                1e-6 * static_cast<double>(points.size()))
        << what;
  }
};

TEST(DynamicGrid, AnswersAsIfBuiltAnewAfterAnyMoves) {
  for (const PartitionCase& c : partition_cases()) {
    Model model(c);
    const std::vector<Vec3f> start = model.points;
    Random random(31);
    const Vec3 heap = model.at(0);
    for (int round = 0; round < 8; ++round) {
      for (int k = 0; k < 300; ++k) {
        const auto place = static_cast<std::uint32_t>(random.below(model.points.size()));
        const Vec3 noise(random.normal(), random.normal(), random.normal());
        constexpr double kSteps[] = {0.1, 3.0, 50.0, 1e-3, 0.0};  // around where it is; around the heap
        const std::size_t way = random.below(6);
        const Vec3 from = way < 3 ? model.at(place) : heap;
        (void)model.move(place,
                         way < 5 ? Vec3(from + kSteps[way] * c.step_mm * noise) : widened(start[place]));
      }
      model.expect_right(random, c.name + " round " + std::to_string(round));
      if (HasFatalFailure()) return;
    }
  }
}

TEST(DynamicGrid, IsAsBuiltOnceAllPointsAreBackHome) {
  const PartitionCase c{"sheet", 0.1, sheet(60, 60, 0.1, 2)};
  Model model(c);
  const std::vector<Vec3f> start = model.points;
  const LeafStatistics built = model.partition.statistics();
  const std::size_t spare = model.partition.spare_left();
  Random random(33);
  for (int round = 0; round < 3; ++round) {
    for (std::uint32_t place = 0; place < start.size(); ++place)  // squeezed, inside the box
      (void)model.move(place, 0.1 * widened(start[place]));
    EXPECT_NE(model.partition.statistics().leaves, built.leaves);
    for (std::uint32_t place = 0; place < start.size(); ++place)
      (void)model.move(place, widened(start[place]));
    const LeafStatistics now = model.partition.statistics();
    EXPECT_EQ(std::tie(now.leaves, now.nodes, now.max_points, now.max_depth),
              std::tie(built.leaves, built.nodes, built.max_points, built.max_depth));
    EXPECT_EQ(model.partition.spare_left(), spare) << "round " << round;
  }
  model.expect_right(random, "back home");
}

// Without spare room a move is refused, or leaves fill; what is answered stays right, and a session that
// comes back finds its room again.
TEST(DynamicGrid, SaysWhenItIsFullAndStaysRight) {
  const PartitionCase c{"sheet", 0.1, sheet(60, 60, 0.1, 2)};
  Model model(c, 0.0);
  const std::vector<Vec3f> start = model.points;
  const std::size_t spare = model.partition.spare_left();
  Random random(34);
  for (std::uint32_t place = 0; place < start.size(); ++place)
    (void)model.move(place, 10.0 * widened(start[place]));
  EXPECT_EQ(model.partition.spare_left(), 0u);
  model.expect_right(random, "full");
  std::size_t refused = 0;
  for (std::uint32_t place = 0; place < start.size(); ++place)
    refused += model.move(place, widened(start[place])) == MoveStatus::kFull;
  EXPECT_EQ(refused, 0u);
  model.expect_right(random, "back");
  EXPECT_EQ(model.partition.spare_left(), spare);
  const Vec3 before = model.at(0);
  for (const double far : {1e30, -1e30, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_EQ(model.move(0, Vec3::Constant(far)), MoveStatus::kFull);
    EXPECT_EQ(model.at(0), before);
  }
  model.expect_right(random, "after far moves");
}

TEST(DynamicGrid, ReachesFarFromWhereItWasBuilt) {
  const PartitionCase c{"sheet", 0.1, sheet(20, 20, 0.1, 2)};
  Model model(c);
  Random random(35);
  for (const double far : {1e2, -1e3, 1e4, -1e5}) {
    for (std::uint32_t place = 0; place < 40; ++place)
      ASSERT_NE(model.move(place, Vec3(far + 0.1 * place, -far, 0.5 * far)), MoveStatus::kFull) << far;
    model.expect_right(random, "far " + std::to_string(far));
  }
}

// Moving and finding points within a frame does not allocate.
TEST(DynamicGrid, AllocatesNothingWhilePointsMove) {
  Random random(41);
  std::vector<Vec3> start;
  for (int i = 0; i < 4000; ++i) start.emplace_back(random.uniform(), random.uniform(), 0.0);
  const cloud::Cloud cloud = cloud::build_cloud(start, cloud::NonFinite::kRefuse).value();
  PartitionOptions options;
  options.cell_mm = 0.05;
  DynamicGrid partition = DynamicGrid::build(cloud, options, 1);
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
    if (partition.move(place, points[place], to) != MoveStatus::kFull) points[place] = to;
    visit_segment_ranges(partition, widened(to), Vec3(Vec3::Zero()), Vec3::Constant(0.01),
                         [&](IndexRange range) {
                           visited += range.end - range.begin;
                           return true;
                         });
  }
  EXPECT_EQ(count.count(), 0u);
  EXPECT_GT(visited, 20000u);
}

}  // namespace
}  // namespace palpate::baselines
