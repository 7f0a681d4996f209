// Connected kNN and the density cut-off against brute force, and the table of builders.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <queue>
#include <set>

#include <palpate/generate.h>
#include "tests/toolkit/messages.h"
#include "tests/toolkit/search/cases.h"
#include "toolkit/search/knn.h"

namespace palpate::search {
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
    const cloud::Cloud cloud = cloud_of(c.points);
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
  const cloud::Cloud cloud = cloud_of(points);
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
    const cloud::Cloud cloud = cloud_of(c.points);
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

TEST(Builders, AreKnownByNameAndSayWhatIsWrong) {
  const cloud::Cloud cloud = cloud_of(sheet(20, 20, 1.0, 1.5, 2));
  std::vector<std::string> names;
  for (const NeighbourBuilder& builder : neighbour_builders()) {
    names.push_back(builder.name);
    EXPECT_FALSE(builder.summary.empty());
    EXPECT_FALSE(builder.source.empty());
    const Result<NeighbourBuild> one = build_neighbours(builder.name, cloud, 1),
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
  const auto near = test::value_of(build_neighbours("fixed-distance:distance_mm=0.01", cloud, 1));
  EXPECT_EQ(near.table.count(0), 0u);
  EXPECT_FALSE(build_neighbours("fixed-distance:distance_mm=-1", cloud, 1));
  EXPECT_FALSE(build_neighbours("fixed-distance:range=1", cloud, 1));
  EXPECT_TRUE(test::contains(build_neighbours("nearest", cloud, 1).error().message(), "directional-knn"));
  EXPECT_FALSE(build_neighbours("exact-knn", cloud::Cloud{}, 1));
}

TEST(Builders, TakeOthers) {
  NeighbourBuilder mine{"none",
                        "no neighbours",
                        "",
                        {},
                        [](const cloud::Cloud& cloud, const Options&, int) -> Result<NeighbourBuild> {
                          NeighbourBuild nothing;
                          nothing.table.of.resize(cloud.size());
                          for (std::uint32_t i = 0; i < cloud.size(); ++i) nothing.table.of[i].fill(i);
                          return nothing;
                        }};
  const std::size_t before = neighbour_builders().size();
  add_neighbour_builder(mine);
  add_neighbour_builder(mine);
  EXPECT_EQ(neighbour_builders().size(), before + 1);
  EXPECT_EQ(build_neighbours("none", cloud_of({Vec3(0, 0, 0), Vec3(1, 0, 0)}), 1)->table.count(1), 0u);
}

// The scanner's path in every order, and the look-up table with and without holes.

cloud::Cloud generated(const std::string& spec) {
  return cloud::generate(parse_named_options(spec).value())->cloud;
}

NeighbourTable sorted(NeighbourTable table) {
  for (Neighbours& row : table.of) std::sort(row.begin(), row.end());
  return table;
}

TEST(ScanOrder, ToAndFroGivesTheNeighboursOfTheRaster) {
  for (const char* points : {"4", "9", "12", "400"}) {
    const std::string spec = std::string("sinusoid:jitter=0.2:points=") + points;
    const cloud::Cloud one = generated(spec), fro = generated(spec + ":order=boustrophedon");
    const NeighbourTable a = scanner_path(one, 1).value(), b = scanner_path(fro, 3).value();
    const auto place = [&](std::uint32_t i) {
      return static_cast<std::uint32_t>(fro.raster->index(i / one.raster->columns, i % one.raster->columns));
    };
    for (std::uint32_t i = 0; i < one.size(); ++i)
      for (std::size_t k = 0; k < kNeighbours; ++k) EXPECT_EQ(place(a.of[i][k]), b.of[place(i)][k]);
    EXPECT_EQ(lookup_table(fro, scan_table_of(fro).value(), {}, 2)->of, b.of);
  }
}

TEST(ScanOrder, TurntablesHaveNoSeam) {
  const cloud::Cloud torus = generated("torus:points=700:order=turntable");
  const std::uint32_t columns = torus.raster->columns, rows = torus.raster->rows;
  const NeighbourTable table = scanner_path(torus, 2).value();
  for (std::uint32_t row = 0; row < rows; ++row)
    for (std::uint32_t column = 0; column < columns; ++column) {
      std::set<std::uint32_t> expected;
      for (const std::uint32_t r : {row + rows - 1, row, row + 1})
        for (const std::uint32_t c : {column + columns - 1, column, column + 1})
          expected.insert(r % rows * columns + c % columns);
      const std::uint32_t self = row * columns + column;
      expected.erase(self);
      EXPECT_EQ(std::set<std::uint32_t>(table.of[self].begin(), table.of[self].end()), expected);
    }
  EXPECT_EQ(lookup_table(torus, scan_table_of(torus).value(), {}, 1)->of, table.of);
  // A cylinder: columns go round, rows end.
  cloud::Cloud cylinder = cloud_of(sheet(7, 5, 1.0, 0.1, 2));
  cylinder.raster = cloud::ScanRaster{7, 5, cloud::ScanOrder::kBoustrophedon, true, false};
  const NeighbourTable open = scanner_path(cylinder, 1).value();
  for (std::uint32_t i = 0; i < 35; ++i) EXPECT_EQ(open.count(i), i < 7 || i >= 28 ? 5u : 8u);
  EXPECT_EQ(lookup_table(cylinder, scan_table_of(cylinder).value(), {}, 1)->of, open.of);
  // Two columns cannot go round.
  cylinder.raster = cloud::ScanRaster{2, 2, cloud::ScanOrder::kRaster, true, true};
  cylinder = cloud_of({Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(1, 1, 0)});
  cylinder.raster = cloud::ScanRaster{2, 2, cloud::ScanOrder::kRaster, true, true};
  EXPECT_EQ(scanner_path(cylinder, 1)->of[0], (Neighbours{1, 2, 3, 0, 0, 0, 0, 0}));
  EXPECT_EQ(lookup_table(cylinder, scan_table_of(cylinder).value(), {}, 1)->count(0), 3u);
}

TEST(ScanOrder, IsRecognisedWhereItIsNotSaid) {
  for (const char* order : {"raster", "boustrophedon"}) {
    cloud::Cloud cloud = generated(std::string("saddle:points=100:order=") + order);
    const NeighbourTable said = scanner_path(cloud, 1).value();
    cloud.raster.reset();
    EXPECT_FALSE(scanner_path(cloud, 1));
    const auto recognised = test::value_of(build_neighbours("scanner-path", cloud, 1));
    EXPECT_EQ(recognised.table.of, said.of);
    EXPECT_EQ(recognised.notes.size(), 1u);
  }
}

struct Holed {
  cloud::Cloud cloud;
  std::vector<ScanPosition> of;
};

/// A raster of which a share is missing, as properties of a shuffled file would say it.
Holed holed(std::uint32_t columns, std::uint32_t rows, double missing, std::uint32_t scans) {
  Random random(17);
  std::vector<std::pair<Vec3, ScanPosition>> points;
  for (std::uint32_t s = 0; s < scans; ++s)
    for (std::uint32_t r = 0; r < rows; ++r)
      for (std::uint32_t c = 0; c < columns; ++c)
        if (random.uniform() >= missing)
          points.push_back(
              {Vec3(c + 0.3 * random.uniform(), r + 0.3 * random.uniform(), 0.01 * s), {s, r, c}});
  for (std::size_t i = points.size() - 1; i > 0; --i)
    std::swap(points[i], points[static_cast<std::size_t>(random.uniform() * static_cast<double>(i + 1))]);
  Holed found;
  std::vector<Vec3> places;
  cloud::Property scan{"scan", {}}, row{"row", {}}, column{"column", {}};
  for (const auto& [p, at] : points) {
    places.push_back(p);
    found.of.push_back(at);
    scan.values.push_back(static_cast<float>(at.scan));
    row.values.push_back(static_cast<float>(at.row));
    column.values.push_back(static_cast<float>(at.column));
  }
  found.cloud = cloud_of(places);
  found.cloud.properties = {row, scan, column};
  return found;
}

TEST(LookupTable, FindsTheNextPointAcrossHoles) {
  for (const double missing : {0.0, 0.3, 0.9})
    for (const bool wrap : {false, true})
      for (const std::uint32_t across : {0u, 1u, 2u, 30u}) {
        SCOPED_TRACE(testing::Message() << missing << " missing, wrap " << wrap << ", across " << across);
        const Holed scan = holed(13, 9, missing, 2);
        auto table = test::value_of(scan_table_of(scan.cloud));
        EXPECT_EQ(table.of, scan.of);
        if (wrap) table.columns_wrap = 13;
        LookupReport report;
        const NeighbourTable got = lookup_table(scan.cloud, table, {across}, 3, &report).value();
        std::map<std::array<int, 3>, std::uint32_t> taken;
        for (std::uint32_t i = 0; i < scan.of.size(); ++i)
          taken[{static_cast<int>(scan.of[i].scan), static_cast<int>(scan.of[i].row),
                 static_cast<int>(scan.of[i].column)}] = i;
        std::uint64_t over = 0, fewer = 0;
        for (std::uint32_t i = 0; i < scan.of.size(); ++i) {
          std::set<std::uint32_t> expected;
          for (int dr = -1; dr <= 1; ++dr)
            for (int dc = -1; dc <= 1; ++dc) {
              if (dr == 0 && dc == 0) continue;
              bool done = false;
              for (int step = 1; step <= static_cast<int>(across) + 1 && !done; ++step) {
                const int r = static_cast<int>(scan.of[i].row) + step * dr;
                int c = static_cast<int>(scan.of[i].column) + step * dc;
                if (wrap) c = (c % 13 + 13) % 13;
                const auto found = taken.find({static_cast<int>(scan.of[i].scan), r, c});
                done = found != taken.end();
                if (done && found->second != i && expected.insert(found->second).second) over += step > 1;
              }
            }
          fewer += expected.size() < kNeighbours;
          std::set<std::uint32_t> found(got.of[i].begin(), got.of[i].end());
          found.erase(i);
          ASSERT_EQ(found, expected) << "point " << i;
          for (const std::uint32_t j : found)
            EXPECT_NE(std::find(got.of[j].begin(), got.of[j].end(), i), got.of[j].end()) << "a way back";
        }
        EXPECT_EQ(report.links_across_holes, over);
        EXPECT_EQ(report.fewer_than_eight, fewer);
      }
}

TEST(LookupTable, IsTheScannersPathWhereNothingIsMissing) {
  const cloud::Cloud cloud = generated("saddle:points=900:jitter=0.3");
  EXPECT_EQ(lookup_table(cloud, scan_table_of(cloud).value(), {}, 2)->of, scanner_path(cloud, 1)->of);
  const Holed scan = holed(20, 30, 0.0, 1);
  EXPECT_EQ(sorted(build_neighbours("lookup-table:across=0", scan.cloud, 1)->table).of,
            sorted(lookup_table(scan.cloud, {scan.of}, {5}, 1).value()).of);
}

TEST(LookupTable, RefusesWhatIsNoTable) {
  cloud::Cloud cloud = cloud_of({Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0)});
  EXPECT_FALSE(build_neighbours("lookup-table", cloud, 1)) << "no positions";
  for (const float bad : {-1.0F, 0.5F, 1e30F, std::numeric_limits<float>::quiet_NaN()}) {
    cloud.properties = {{"row", {0, 0, 1}}, {"column", {0, bad, 0}}};
    EXPECT_TRUE(test::refused(build_neighbours("lookup-table", cloud, 1), "point 2")) << bad;
  }
  EXPECT_FALSE(build_neighbours("scanner-path", cloud, 1)) << "three points are no raster";
  cloud.properties = {{"row", {0, 0, 0}}, {"column", {0, 1, 0}}};
  EXPECT_TRUE(test::refused(build_neighbours("lookup-table", cloud, 1), "points 1 and 3"));
  EXPECT_FALSE(lookup_table(cloud, {}, {}, 1)) << "a table of another cloud";
  // The ends of the range, with the longest reach.
  const std::uint32_t far = 4294967295u;
  const ScanTable edges{{{0, far, far}, {0, 0, 0}, {far, far, far - 1}}, 0, 0};
  EXPECT_EQ(lookup_table(cloud, edges, {1000}, 1)->count(0), 0u);
  cloud.raster = cloud::ScanRaster{2, 2};
  EXPECT_FALSE(scan_table_of(cloud));
}

}  // namespace
}  // namespace palpate::search
