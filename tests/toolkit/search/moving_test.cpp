// Partitions of moving points against brute force: after any moves they answer as if built anew.
#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <set>
#include <vector>

#include "tests/toolkit/search/cases.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/search/dynamic_grid.h"
#include "toolkit/search/point_search.h"

namespace palpate::search {
namespace {

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
        switch (random.below(6)) {
          case 0:
            (void)model.move(place, model.at(place) + 0.1 * c.step_mm * noise);
            break;
          case 1:
            (void)model.move(place, model.at(place) + 3.0 * c.step_mm * noise);
            break;
          case 2:
            (void)model.move(place, model.at(place) + 50.0 * c.step_mm * noise);
            break;
          case 3:
            (void)model.move(place, heap + 1e-3 * c.step_mm * noise);
            break;
          case 4:
            (void)model.move(place, heap);
            break;
          default:
            (void)model.move(place, widened(start[place]));
        }
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
    EXPECT_EQ(now.leaves, built.leaves);
    EXPECT_EQ(now.nodes, built.nodes);
    EXPECT_EQ(now.max_points, built.max_points);
    EXPECT_EQ(now.max_depth, built.max_depth);
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

// The search for points around any place, against looking at every point.

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
