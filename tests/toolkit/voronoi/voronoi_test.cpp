// Natural neighbours against their definition: two points are neighbours where a sphere (in a plane, a
// circle) through both and two (one) others holds no point.
#include "toolkit/voronoi/voronoi.h"
#include "tests/toolkit/messages.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <numeric>
#include <set>

#include <palpate/registry.h>
#include "toolkit/core/random.h"
#include "toolkit/search/knn.h"

namespace palpate::voronoi {
namespace {

using search::kNeighbours;
using search::Neighbours;
using search::NeighbourTable;

cloud::Cloud built(const std::vector<Vec3>& points) {
  return cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
}

/// Marks all pairs of every simplex of d + 1 points whose sphere through them is empty.
template <int D>
std::vector<std::set<std::uint32_t>> slow_natural(const cloud::Cloud& cloud) {
  using Point = Eigen::Matrix<double, D, 1>;
  const auto n = static_cast<std::uint32_t>(cloud.size());
  std::vector<Point> points;
  for (std::uint32_t i = 0; i < n; ++i) points.push_back(cloud.local_mm(i).template head<D>());
  std::vector<std::set<std::uint32_t>> found(n);
  std::array<std::uint32_t, static_cast<std::size_t>(D) + 1> pick;
  std::iota(pick.begin(), pick.end(), 0u);
  for (bool more = true; more;) {
    Eigen::Matrix<double, D, D> rows;
    Point right;
    for (int k = 0; k < D; ++k) {
      const Point edge = points[pick[static_cast<std::size_t>(k) + 1]] - points[pick[0]];
      rows.row(k) = 2.0 * edge.transpose();
      right[k] = edge.squaredNorm();
    }
    const Point centre = rows.fullPivLu().solve(right);
    const double radius_sq = centre.squaredNorm();
    bool empty = true;
    for (std::uint32_t i = 0; i < n && empty; ++i)
      empty = std::find(pick.begin(), pick.end(), i) != pick.end() ||
              (points[i] - points[pick[0]] - centre).squaredNorm() > radius_sq;
    if (empty)
      for (const std::uint32_t a : pick)
        for (const std::uint32_t b : pick)
          if (a != b) found[a].insert(b);
    // The next combination.
    more = false;
    for (int k = D; k >= 0 && !more; --k) {
      const auto at = static_cast<std::size_t>(k);
      if (pick[at] + 1 + static_cast<std::uint32_t>(D - k) >= n) continue;
      ++pick[at];
      for (std::size_t j = at + 1; j < pick.size(); ++j) pick[j] = pick[j - 1] + 1;
      more = true;
    }
  }
  return found;
}

template <int D>
void expect_natural(const cloud::Cloud& cloud) {
  const auto natural = slow_natural<D>(cloud);
  VoronoiReport report;
  const NeighbourTable table = voronoi(cloud, 2, &report).value();
  std::uint64_t pairs = 0, more = 0, fewer = 0;
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    std::vector<std::pair<double, std::uint32_t>> order;
    for (const std::uint32_t j : natural[i])
      order.emplace_back((cloud.local_mm(j) - cloud.local_mm(i)).squaredNorm(), j);
    std::sort(order.begin(), order.end());
    Neighbours expected;
    expected.fill(i);
    for (std::size_t k = 0; k < std::min(order.size(), kNeighbours); ++k) expected[k] = order[k].second;
    EXPECT_EQ(table.of[i], expected) << "point " << i;
    pairs += order.size();
    more += order.size() > kNeighbours;
    fewer += order.size() < kNeighbours;
  }
  EXPECT_EQ(report.natural, pairs / 2);
  EXPECT_EQ(report.more_than_eight, more);
  EXPECT_EQ(report.fewer_than_eight, fewer);
}

TEST(Voronoi, IsTheDefinitionInSpaceAndInAPlane) {
  Random random(41);
  for (int trial = 0; trial < 3; ++trial)
    for (const double scale : {1e-3, 1.0, 1e6}) {
      std::vector<Vec3> space, plane;
      for (int i = 0; i < 26; ++i) {
        const Vec3 away(1e3, -2e3, 1e3);
        space.push_back(scale * (away + Vec3(random.uniform(), random.uniform(), random.uniform())));
      }
      for (int i = 0; i < 60; ++i) plane.push_back(scale * Vec3(random.uniform(), random.uniform(), 0.0));
      expect_natural<3>(built(space));
      expect_natural<2>(built(plane));
    }
}

TEST(Voronoi, ToleratesWhatSpansNoSpace) {
  EXPECT_EQ(voronoi(built({Vec3(1, 2, 3)}), 1)->of[0], (Neighbours{}));
  EXPECT_EQ(voronoi(built({Vec3(1, 2, 3), Vec3(2, 2, 3)}), 1)->of[0], (Neighbours{1}));
  std::vector<Vec3> line;
  for (int i = 0; i < 9; ++i) line.emplace_back(0.5 * i * i, i * i, 0.0);
  const NeighbourTable of_line = voronoi(built(line), 1).value();
  for (std::uint32_t i = 1; i < 8; ++i)
    EXPECT_EQ(of_line.of[i], (Neighbours{i - 1, i + 1, i, i, i, i, i, i}));
  // Piles: twelve points at each of two places.
  std::vector<Vec3> piles(24, Vec3(1, 1, 1));
  for (std::size_t i = 0; i < 24; i += 2) piles[i].x() = 2.0;
  VoronoiReport report;
  const NeighbourTable of_piles = voronoi(built(piles), 1, &report).value();
  EXPECT_EQ(report.places, 2u);
  EXPECT_EQ(of_piles.of[0], (Neighbours{2, 4, 6, 8, 10, 12, 14, 16}));
  EXPECT_EQ(of_piles.of[23], (Neighbours{1, 3, 5, 7, 9, 11, 13, 15}));
  EXPECT_EQ(voronoi(cloud::Cloud{}, 1)->size(), 0u);
}

TEST(Voronoi, DoesNotDependOnOrderOrThreads) {
  Random random(43);
  std::vector<Vec3> points;
  for (int i = 0; i < 2000; ++i) {
    const double x = random.uniform(-1, 1), y = random.uniform(-1, 1);
    points.emplace_back(x, y, 0.3 * x * x - 0.2 * y);
  }
  std::vector<std::uint32_t> place(points.size());
  std::iota(place.begin(), place.end(), 0u);
  for (std::size_t i = place.size() - 1; i > 0; --i) std::swap(place[i], place[random.below(i + 1)]);
  std::vector<Vec3> moved(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) moved[place[i]] = points[i];
  const NeighbourTable a = voronoi(built(points), 1).value(), b = voronoi(built(moved), 3).value();
  for (std::uint32_t i = 0; i < points.size(); ++i)
    for (std::size_t k = 0; k < kNeighbours; ++k) ASSERT_EQ(place[a.of[i][k]], b.of[place[i]][k]);
}

TEST(Voronoi, IsABuilderOnceRegistered) {
  const cloud::Cloud cloud = built({Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)});
  EXPECT_FALSE(search::build_neighbours("voronoi", cloud, 1));
  register_voronoi();
  const auto built_table = test::value_of(search::build_neighbours("voronoi", cloud, 1));
  EXPECT_EQ(built_table.table.count(0), 3u);
  EXPECT_EQ(built_table.notes.size(), 1u);
}

}  // namespace
}  // namespace palpate::voronoi
