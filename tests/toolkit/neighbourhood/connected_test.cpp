// Connected kNN and the density cut-off against brute force, and the table of builders.
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <queue>

#include "tests/toolkit/neighbourhood/cases.h"
#include "toolkit/neighbourhood/builders.h"
#include "toolkit/neighbourhood/connected_knn.h"
#include "toolkit/neighbourhood/knn.h"

namespace palpate::neighbourhood {
namespace {

std::size_t reached_from_first(const NeighbourTable& table) {
  std::vector<bool> seen(table.size(), false);
  std::queue<std::uint32_t> queue;
  queue.push(0);
  seen[0] = true;
  std::size_t count = 0;
  for (; !queue.empty(); queue.pop(), ++count)
    for (const std::uint32_t j : table.of[queue.front()])
      if (!seen[j]) {
        seen[j] = true;
        queue.push(j);
      }
  return count;
}

std::vector<std::uint32_t> pieces_of(const NeighbourTable& table) {
  std::vector<std::uint32_t> piece(table.size());
  std::iota(piece.begin(), piece.end(), 0u);
  for (bool changed = true; changed;) {
    changed = false;
    for (std::uint32_t i = 0; i < table.size(); ++i)
      for (const std::uint32_t j : table.of[i]) {
        const std::uint32_t low = std::min(piece[i], piece[j]);
        changed = changed || piece[i] != low || piece[j] != low;
        piece[i] = piece[j] = low;
      }
  }
  return piece;
}

/// The longest joint of the shortest set that joins the pieces: Prim over all pairs of points.
double longest_joint_mm(const cloud::Cloud& cloud, const std::vector<std::uint32_t>& piece) {
  const std::size_t n = cloud.size();
  std::vector<double> nearest(n, std::numeric_limits<double>::infinity());
  std::vector<bool> in(n, false);
  double longest = 0.0;
  const auto take = [&](std::uint32_t which) {
    for (std::uint32_t i = 0; i < n; ++i) {
      if (piece[i] != which) continue;
      in[i] = true;
      for (std::uint32_t j = 0; j < n; ++j)
        if (!in[j]) nearest[j] = std::min(nearest[j], (cloud.local_mm(i) - cloud.local_mm(j)).squaredNorm());
    }
  };
  take(0);
  for (;;) {
    std::uint32_t best = static_cast<std::uint32_t>(n);
    for (std::uint32_t j = 0; j < n; ++j)
      if (!in[j] && (best == n || nearest[j] < nearest[best])) best = j;
    if (best == n) return std::sqrt(longest);
    longest = std::max(longest, nearest[best]);
    take(piece[best]);
  }
}

std::vector<Case> harder_cases() {
  std::vector<Case> all = cases();
  Random random(31);
  all.push_back({"clumps of nine", {}});
  for (int clump = 0; clump < 100; ++clump) {
    const Vec3 at(random.uniform(0, 50), random.uniform(0, 50), random.uniform(0, 50));
    for (int i = 0; i < 9; ++i)
      all.back().points.push_back(at + 0.01 * Vec3(random.normal(), random.normal(), random.normal()));
  }
  all.push_back({"two sheets and a chain of outliers", sheet(20, 20, 1.0, 0.2, 8)});
  for (Vec3 p : sheet(20, 20, 1.0, 0.2, 9)) all.back().points.push_back(p + Vec3(0, 0, 30));
  for (int i = 1; i < 10; ++i) all.back().points.emplace_back(-2.0 * i * i, 0.0, 15.0);
  all.push_back({"piles", {}});
  for (int pile = 0; pile < 6; ++pile)
    all.back().points.insert(all.back().points.end(), 60, Vec3(pile * pile, 0, 0));
  return all;
}

TEST(ConnectedKnn, ReachesEveryPointFromTheFirst) {
  for (const Case& c : harder_cases()) {
    SCOPED_TRACE(c.name);
    const cloud::Cloud cloud = built(c.points);
    const NeighbourTable before = exact_knn(cloud, 1);
    ConnectReport report;
    const NeighbourTable table = connected_knn(cloud, 2, &report);
    ASSERT_EQ(table.size(), cloud.size());
    EXPECT_EQ(reached_from_first(table), cloud.size());
    EXPECT_EQ(report.unreached, cloud.size() - reached_from_first(before));
    const std::vector<std::uint32_t> piece = pieces_of(before);
    std::uint64_t pieces = 0, changed_links = 0;
    for (std::uint32_t i = 0; i < cloud.size(); ++i) pieces += piece[i] == i;
    EXPECT_EQ(report.pieces, pieces);
    if (pieces > 1) {
      EXPECT_GE(report.longest_link_mm, longest_joint_mm(cloud, piece) * (1.0 - 1e-12));
    }
    for (std::uint32_t i = 0; i < cloud.size(); ++i) {
      double last = -1.0;
      for (const std::uint32_t j : table.of[i]) {
        if (j == i) continue;
        const double sq = (cloud.local_mm(j) - cloud.local_mm(i)).squaredNorm();
        EXPECT_GE(sq, last) << "rows stay ordered";
        last = sq;
        changed_links += std::find(before.of[i].begin(), before.of[i].end(), j) == before.of[i].end();
      }
    }
    EXPECT_LE(changed_links, report.links_given);
    if (report.unreached == 0) {
      EXPECT_EQ(table.of, before.of);
    }
  }
}

TEST(ConnectedKnn, JoinsPiecesAtTheirClosestPairsBothWays) {
  std::vector<Vec3> points = sheet(15, 15, 1.0, 0.3, 3);
  const auto other = static_cast<std::uint32_t>(points.size());
  for (const Vec3& p : sheet(15, 15, 1.0, 0.3, 4)) points.push_back(p + Vec3(5, 5, 40));
  const cloud::Cloud cloud = built(points);
  std::uint32_t a = 0, b = other;
  for (std::uint32_t i = 0; i < other; ++i)
    for (std::uint32_t j = other; j < cloud.size(); ++j)
      if ((cloud.local_mm(i) - cloud.local_mm(j)).norm() < (cloud.local_mm(a) - cloud.local_mm(b)).norm()) {
        a = i;
        b = j;
      }
  ConnectReport report;
  const NeighbourTable table = connected_knn(cloud, 1, &report);
  EXPECT_EQ(report.pieces, 2u);
  EXPECT_EQ(table.of[a].back(), b);
  EXPECT_EQ(table.of[b].back(), a);
  EXPECT_NEAR(report.longest_link_mm, (cloud.local_mm(a) - cloud.local_mm(b)).norm(), 1e-12);
}

TEST(DensityCutOff, EqualsTheDefinition) {
  for (const Case& c : harder_cases()) {
    SCOPED_TRACE(c.name);
    const cloud::Cloud cloud = built(c.points);
    const NeighbourTable before = exact_knn(cloud, 1);
    for (const double factor : {0.9, 2.0}) {
      NeighbourTable table = before;
      const CutOffReport report = cut_off_by_density(cloud, table, factor, 3);
      std::uint64_t cut = 0, points_cut = 0, without = 0;
      const auto fourth = [&](std::uint32_t i) {
        std::vector<double> all;
        for (const std::uint32_t j : before.of[i])
          if (j != i) all.push_back((cloud.local_mm(j) - cloud.local_mm(i)).norm());
        return all.empty() ? 0.0 : all[std::min<std::size_t>(all.size(), 4) - 1];
      };
      for (std::uint32_t i = 0; i < cloud.size(); ++i) {
        std::vector<double> around = {fourth(i)};
        for (const std::uint32_t j : before.of[i])
          if (j != i) around.push_back(fourth(j));
        std::sort(around.begin(), around.end());
        const double limit = factor * around[around.size() / 2];
        Neighbours expected;
        expected.fill(i);
        std::size_t kept = 0;
        for (const std::uint32_t j : before.of[i])
          if (j != i && (cloud.local_mm(j) - cloud.local_mm(i)).norm() <= limit) expected[kept++] = j;
        ASSERT_EQ(table.of[i], expected) << "point " << i;
        cut += before.count(i) - kept;
        points_cut += kept < before.count(i);
        without += kept == 0 && before.count(i) > 0;
      }
      EXPECT_EQ(report.links_cut, cut);
      EXPECT_EQ(report.points_cut, points_cut);
      EXPECT_EQ(report.points_without, without);
    }
  }
}

TEST(DensityCutOff, LetsGoOfOutliersAndKeepsGrids) {
  std::vector<Vec3> points = sheet(20, 20, 0.5, 0.0, 1);
  points.emplace_back(5.0, 5.0, 4.0);
  const cloud::Cloud cloud = built(points);
  const auto outlier = static_cast<std::uint32_t>(points.size() - 1);
  NeighbourTable table = exact_knn(cloud, 1);
  const CutOffReport report = cut_off_by_density(cloud, table, 2.0, 1);
  EXPECT_EQ(report.points_without, 1u);
  EXPECT_EQ(table.count(outlier), 0u);
  EXPECT_EQ(report.links_cut, 8u);
}

TEST(Builders, AreKnownByNameAndSayWhatIsWrong) {
  const cloud::Cloud cloud = built(sheet(20, 20, 1.0, 1.5, 2));
  std::vector<std::string> names;
  for (const Builder& builder : builders()) {
    names.push_back(builder.name);
    EXPECT_FALSE(builder.summary.empty());
    EXPECT_FALSE(builder.source.empty());
    const Result<Built> one = build_neighbours(builder.name, cloud, 1),
                        all = build_neighbours(builder.name, cloud, 3);
    ASSERT_EQ(one.ok(), !builder.follows_scanner) << "there is no scan order here";
    if (!one) {
      EXPECT_FALSE(one.error().remedy.empty());
      continue;
    }
    EXPECT_EQ(one->table.of, all->table.of) << builder.name;
  }
  for (const char* name : {"exact-knn", "density-knn", "connected-knn", "directional-knn", "fixed-distance",
                           "scanner-path", "lookup-table", "modified-knn"})
    EXPECT_NE(std::find(names.begin(), names.end(), name), names.end()) << name;
  EXPECT_EQ(build_neighbours("exact-knn", cloud, 1)->table.of, exact_knn(cloud, 1).of);
  const Result<Built> near = build_neighbours("fixed-distance:distance_mm=0.01", cloud, 1);
  ASSERT_TRUE(near);
  EXPECT_EQ(near->table.count(0), 0u);
  EXPECT_FALSE(build_neighbours("fixed-distance:distance_mm=-1", cloud, 1));
  EXPECT_FALSE(build_neighbours("fixed-distance:range=1", cloud, 1));
  EXPECT_NE(build_neighbours("nearest", cloud, 1).error().message().find("directional-knn"),
            std::string::npos);
  EXPECT_FALSE(build_neighbours("exact-knn", cloud::Cloud{}, 1));
}

TEST(Builders, TakeOthers) {
  Builder mine{
      "none", "no neighbours", "", {}, [](const cloud::Cloud& cloud, const Options&, int) -> Result<Built> {
        Built nothing;
        nothing.table.of.resize(cloud.size());
        for (std::uint32_t i = 0; i < cloud.size(); ++i) nothing.table.of[i].fill(i);
        return nothing;
      }};
  const std::size_t before = builders().size();
  add_builder(mine);
  add_builder(mine);
  EXPECT_EQ(builders().size(), before + 1);
  EXPECT_EQ(build_neighbours("none", built({Vec3(0, 0, 0), Vec3(1, 0, 0)}), 1)->table.count(1), 0u);
}

}  // namespace
}  // namespace palpate::neighbourhood
