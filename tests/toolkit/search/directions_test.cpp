// Directional kNN and fixed distance against brute force over every point.
#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <Eigen/SVD>

#include <cmath>
#include <map>
#include <numbers>

#include <palpate/generate.h>
#include "tests/toolkit/messages.h"
#include "tests/toolkit/search/cases.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {
namespace {

// Angles this close to a border may fall to either side of it.
constexpr double kAtBorderDeg = 1e-4;

double degrees(double radians) {
  return radians * 180.0 / std::numbers::pi;
}

struct Slow {
  std::vector<std::pair<double, std::uint32_t>> best;
  bool doubtful = false;  // an angle at a border, or no clear plane
};

/// The definition in directional_knn.h, by sorting all points and by angles.
Slow slow_directions(const cloud::Cloud& cloud, std::uint32_t self, const DirectionalKnnOptions& options) {
  Slow slow;
  std::vector<std::pair<double, std::uint32_t>> others;
  const Vec3 p = cloud.local_mm(self);
  for (std::uint32_t j = 0; j < cloud.size(); ++j) {
    const double sq = (cloud.local_mm(j) - p).squaredNorm();
    if (j != self && sq > 0.0) others.emplace_back(sq, j);
  }
  std::sort(others.begin(), others.end());
  const std::size_t n = std::min(others.size(), kNeighbours);
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(n + 1), 3);
  rows.row(0).setZero();
  for (std::size_t k = 0; k < n; ++k)
    rows.row(static_cast<Eigen::Index>(k + 1)) =
        (cloud.local_mm(others[k].second) - p) / std::sqrt(others[n - 1].first);
  rows.rowwise() -= rows.colwise().mean().eval();
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(rows, Eigen::ComputeFullV);
  Vec3 normal = Vec3::UnitZ();
  if (options.frame == DirectionalKnnOptions::Frame::kTangent) {
    if (n < 2) return {{}, true};
    const auto values = svd.singularValues();
    slow.doubtful = values[1] - values[2] < 1e-4 * values[0];
    normal = svd.matrixV().col(2);
  }
  int longest = 0;
  normal.cwiseAbs().maxCoeff(&longest);
  const Vec3 sizes = normal.cwiseAbs();
  for (int axis = 0; axis < 3; ++axis)
    if (axis != longest && sizes[longest] - sizes[axis] < 1e-6) slow.doubtful = true;
  if (normal[longest] < 0.0) normal = -normal;
  const Vec3 axis = longest == 0 ? Vec3::UnitY() : Vec3::UnitX();
  const Vec3 east = (axis - axis.dot(normal) * normal).normalized(), north = normal.cross(east);
  std::map<int, std::pair<double, std::uint32_t>> best;
  const double limit = n == kNeighbours ? options.reach * options.reach * others[n - 1].first
                                        : std::numeric_limits<double>::infinity();
  for (const auto& [sq, j] : others) {
    if (sq > limit) break;
    const Vec3 d = (cloud.local_mm(j) - p).normalized();
    const double elevation = degrees(std::asin(std::clamp(std::abs(d.dot(normal)), 0.0, 1.0)));
    if (std::abs(elevation - options.steepest_deg) < kAtBorderDeg) slow.doubtful = true;
    if (elevation > options.steepest_deg) continue;
    const double turn = degrees(std::atan2(d.dot(north), d.dot(east))) / 45.0 + 8.5;
    if (std::abs(turn - std::round(turn)) < kAtBorderDeg) slow.doubtful = true;
    best.try_emplace(static_cast<int>(std::floor(turn)) % 8, sq, j);
  }
  for (const auto& [direction, entry] : best) slow.best.push_back(entry);
  std::sort(slow.best.begin(), slow.best.end());
  return slow;
}

void expect_directions(const cloud::Cloud& cloud, const DirectionalKnnOptions& options, double sure_share) {
  DirectionalKnnReport report;
  const NeighbourTable table = directional_knn(cloud, options, 1, &report);
  const NeighbourTable threaded = directional_knn(cloud, options, 3);
  std::size_t sure = 0;
  std::uint64_t empty = 0, full = 0;
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    ASSERT_EQ(table.of[i], threaded.of[i]);
    empty += kNeighbours - table.count(i);
    full += table.count(i) == kNeighbours;
    const Slow slow = slow_directions(cloud, i, options);
    if (slow.doubtful) continue;
    ++sure;
    Neighbours expected;
    expected.fill(i);
    for (std::size_t k = 0; k < slow.best.size(); ++k) expected[k] = slow.best[k].second;
    ASSERT_EQ(table.of[i], expected) << "point " << i;
  }
  EXPECT_EQ(report.empty_directions, empty);
  EXPECT_EQ(report.all_eight, full);
  EXPECT_GE(static_cast<double>(sure), sure_share * static_cast<double>(cloud.size()));
}

TEST(DirectionalKnn, EqualsBruteForce) {
  Random random(21);
  std::vector<Vec3> curved, volume;
  for (int i = 0; i < 900; ++i) {
    const double x = random.uniform(-1, 1), y = random.uniform(-1, 1);
    curved.emplace_back(x, 0.5 * x * x - 0.3 * y * y + 0.01 * random.normal(), y);
    volume.emplace_back(random.uniform(), random.uniform(), random.uniform());
  }
  DirectionalKnnOptions plan;
  plan.frame = DirectionalKnnOptions::Frame::kPlan;
  DirectionalKnnOptions narrow;
  narrow.reach = 1.2;
  narrow.steepest_deg = 20.0;
  for (const auto& [scale, away] : {std::pair(1e-3, 0.0), std::pair(1.0, 300.0), std::pair(1e6, 0.0)}) {
    SCOPED_TRACE(testing::Message() << "scale " << scale << ", away " << away);
    std::vector<Vec3> moved = curved;
    for (Vec3& p : moved) p = scale * (p + Vec3(away, -2.0 * away, away));
    expect_directions(cloud_of(moved), {}, 0.9);
    expect_directions(cloud_of(moved), plan, 0.9);
    expect_directions(cloud_of(moved), narrow, 0.9);
  }
  expect_directions(cloud_of(volume), {}, 0.9);
}

TEST(DirectionalKnn, SurvivesWhatHasNoDirections) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const cloud::Cloud cloud = cloud_of(c.points);
    DirectionalKnnReport report;
    const NeighbourTable table = directional_knn(cloud, {}, 2, &report);
    ASSERT_EQ(table.size(), cloud.size());
    for (std::uint32_t i = 0; i < table.size(); ++i)
      for (const std::uint32_t j : table.of[i]) {
        ASSERT_LT(j, cloud.size());
        if (j == i) continue;
        ASSERT_GT((cloud.local_mm(j) - cloud.local_mm(i)).norm(), 0.0);
      }
    if (c.name == "nine in a line") {
      EXPECT_EQ(report.without_plane, 9u);
      for (std::uint32_t i = 1; i < 8; ++i) EXPECT_EQ(table.count(i), 2u) << "one ahead, one behind";
    }
    if (c.name == "all at one place") {
      EXPECT_EQ(report.empty_directions, 8u * cloud.size());
    }
  }
}

void expect_within(const cloud::Cloud& cloud, double distance_mm, const FixedDistanceOptions& options) {
  FixedDistanceReport report;
  const NeighbourTable table = fixed_distance(cloud, options, 1, &report);
  const NeighbourTable threaded = fixed_distance(cloud, options, 3);
  std::uint64_t more = 0, fewer = 0, all = 0;
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    std::vector<std::pair<double, std::uint32_t>> in;
    for (std::uint32_t j = 0; j < cloud.size(); ++j) {
      const double sq = (cloud.local_mm(j) - cloud.local_mm(i)).squaredNorm();
      if (j != i && sq <= distance_mm * distance_mm) in.emplace_back(sq, j);
    }
    const std::size_t kept = std::min(in.size(), kNeighbours);
    std::partial_sort(in.begin(), in.begin() + static_cast<std::ptrdiff_t>(kept), in.end());
    more += in.size() > kNeighbours;
    fewer += in.size() < kNeighbours;
    all += in.size();
    Neighbours expected;
    expected.fill(i);
    for (std::size_t k = 0; k < kept; ++k) expected[k] = in[k].second;
    ASSERT_EQ(table.of[i], expected) << "point " << i;
    ASSERT_EQ(threaded.of[i], expected) << "point " << i;
  }
  EXPECT_EQ(report.distance_mm, distance_mm);
  EXPECT_EQ(report.more_than_eight, more);
  EXPECT_EQ(report.fewer_than_eight, fewer);
  EXPECT_EQ(report.within, all);
}

TEST(FixedDistance, EqualsBruteForce) {
  for (const Case& c : cases()) {
    // Counts stop at nine a place, which brute force knows nothing of.
    if (c.name.find("pile") != std::string::npos || c.name.find("one place") != std::string::npos) continue;
    SCOPED_TRACE(c.name);
    const cloud::Cloud cloud = cloud_of(c.points);
    FixedDistanceReport report;
    (void)fixed_distance(cloud, {}, 1, &report);
    for (const double share : {0.3, 1.0, 2.5, 40.0})
      expect_within(cloud, share * report.distance_mm, {share * report.distance_mm});
  }
}

TEST(FixedDistance, TheDefaultHoldsTheEightAroundOnAGrid) {
  for (const double step : {1e-3, 0.25, 1e6}) {
    const cloud::Cloud cloud = cloud_of(sheet(60, 60, step, 0.0, 1));
    FixedDistanceReport report;
    const NeighbourTable table = fixed_distance(cloud, {}, 1, &report);
    EXPECT_EQ(report.more_than_eight, 0u);
    EXPECT_EQ(report.fewer_than_eight, 4u * 59u);
    EXPECT_EQ(table.count(61), kNeighbours);
  }
}

// The study of builders: its truths and its counts against what can be worked out by hand.

TEST(Compare, CountsSharedLinks) {
  NeighbourTable truth, table;
  truth.of = {{1, 2, 0, 0, 0, 0, 0, 0}, {0, 1, 1, 1, 1, 1, 1, 1}, {0, 1, 2, 2, 2, 2, 2, 2}};
  table.of = {{2, 0, 0, 0, 0, 0, 0, 0}, {0, 2, 1, 1, 1, 1, 1, 1}, {2, 2, 2, 2, 2, 2, 2, 2}};
  const LinkAgreement a = link_agreement(table, truth);
  EXPECT_EQ(a.true_links, 5u);
  EXPECT_EQ(a.links, 3u);
  EXPECT_EQ(a.shared, 2u);
  EXPECT_DOUBLE_EQ(a.found_percent(), 40.0);
  EXPECT_DOUBLE_EQ(link_agreement(truth, truth).found_percent(), 100.0);
}

TEST(Compare, TheTruthComesFromTheScannerOrTheMesh) {
  const auto plane = cloud::generate(parse_named_options("plane:points=400").value()).value();
  const SurfaceNeighbours path = surface_neighbours(plane.cloud, plane.original_mesh.get(), 1);
  EXPECT_EQ(path.table.of, scanner_path(plane.cloud, 1)->of);
  cloud::Cloud unordered = plane.cloud;
  unordered.raster.reset();
  // Inside, a grid cut along one diagonal has six edges at a point.
  const SurfaceNeighbours mesh = surface_neighbours(unordered, plane.original_mesh.get(), 1);
  const std::uint32_t middle = 10 * 20 + 10;
  EXPECT_EQ(mesh.table.count(middle), 6u);
  EXPECT_EQ(link_agreement(path.table, mesh.table).found_percent(), 100.0);
  EXPECT_EQ(surface_neighbours(unordered, nullptr, 1).table.of, exact_knn(unordered, 1).of);
}

TEST(Compare, KnowsTheSidesOfAThinWall) {
  for (const double thickness : {0.5, 1.0, 3.0}) {
    ThinWallOptions options;
    options.thickness_spacings = thickness;
    options.across = 30;
    const ThinWall wall = make_thin_wall(options).value();
    const double rim = 0.5 * 30 * wall.spacing_mm - 3.0 * wall.spacing_mm * std::max(1.0, thickness);
    for (std::size_t i = 0; i < wall.cloud.size(); ++i) {
      const Vec3 p = wall.cloud.point_mm(i);
      const bool inner = std::max(std::abs(p.x()), std::abs(p.y())) < rim;
      ASSERT_EQ(wall.side[i], inner ? (p.z() > 0.0 ? 1 : -1) : 0);
      if (inner) {
        ASSERT_NEAR(std::abs(p.z()), 0.5 * thickness * wall.spacing_mm, 1e-6);
      }
    }
    // Brute force: nearest eight, by side.
    const NeighbourTable nearest = brute(wall.cloud);
    std::uint64_t wrong = 0, links = 0;
    for (std::uint32_t i = 0; i < wall.cloud.size(); ++i)
      for (const std::uint32_t j : nearest.of[i]) {
        links += wall.side[i] != 0 && wall.side[j] != 0 && j != i;
        wrong += wall.side[i] * wall.side[j] == -1;
      }
    const WallLinks found = links_through_wall(wall, nearest);
    EXPECT_EQ(found.wrong, wrong);
    EXPECT_EQ(found.links, links);
    EXPECT_EQ(found.wrong > 0, thickness < 2.0);
    // A scanner on either side never sees the other face.
    const auto looked = test::value_of(build_neighbours("lookup-table", wall.cloud, 1));
    EXPECT_EQ(links_through_wall(wall, looked.table).wrong, 0u);
  }
  ThinWallOptions cube;
  cube.across = 10;
  cube.thickness_spacings = 11;
  EXPECT_FALSE(make_thin_wall(cube));
}

TEST(Compare, ScoresEveryBuilder) {
  const auto model = cloud::generate(parse_named_options("sphere:points=2000").value()).value();
  const SurfaceNeighbours truth = surface_neighbours(model.cloud, model.original_mesh.get(), 1);
  ThinWallOptions wall;
  wall.across = 30;
  const std::vector<ThinWall> walls = {make_thin_wall(wall).value()};
  const std::vector<std::string> names = {"exact-knn", "scanner-path", "directional-knn:frame=plan",
                                          "nonsense"};
  CompareNeighboursOptions options;
  options.repeats = 1;
  const std::vector<BuilderScore> scores =
      compare_neighbours(names, model.cloud, truth.table, walls, options, no_progress());
  ASSERT_EQ(scores.size(), names.size());
  for (std::size_t i = 0; i < names.size(); ++i) EXPECT_EQ(scores[i].builder, names[i]);
  EXPECT_TRUE(scores[0].failure.empty());
  EXPECT_EQ(scores[0].agreement.shared, link_agreement(exact_knn(model.cloud, 1), truth.table).shared);
  EXPECT_GT(scores[0].agreement.found_percent(), 90.0);
  EXPECT_EQ(scores[0].walls.at(0).wrong, links_through_wall(walls[0], exact_knn(walls[0].cloud, 1)).wrong);
  EXPECT_FALSE(scores[1].failure.empty());
  EXPECT_FALSE(scores[1].wall_failures.at(0).empty());
  EXPECT_TRUE(scores[2].failure.empty());
  EXPECT_FALSE(scores[3].failure.empty());
}

}  // namespace
}  // namespace palpate::search
