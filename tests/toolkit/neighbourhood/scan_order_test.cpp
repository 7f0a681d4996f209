// The scanner's path in every order, and the look-up table with and without holes.
#include <gtest/gtest.h>

#include <array>
#include <map>
#include <set>

#include "tests/toolkit/neighbourhood/cases.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/neighbourhood/builders.h"
#include "toolkit/neighbourhood/knn.h"
#include "toolkit/neighbourhood/scan_table.h"

namespace palpate::neighbourhood {
namespace {

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
  cloud::Cloud cylinder = built(sheet(7, 5, 1.0, 0.1, 2));
  cylinder.raster = cloud::ScanRaster{7, 5, cloud::ScanOrder::kBoustrophedon, true, false};
  const NeighbourTable open = scanner_path(cylinder, 1).value();
  for (std::uint32_t i = 0; i < 35; ++i) EXPECT_EQ(open.count(i), i < 7 || i >= 28 ? 5u : 8u);
  EXPECT_EQ(lookup_table(cylinder, scan_table_of(cylinder).value(), {}, 1)->of, open.of);
  // Two columns cannot go round.
  cylinder.raster = cloud::ScanRaster{2, 2, cloud::ScanOrder::kRaster, true, true};
  cylinder = built({Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(1, 1, 0)});
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
    const Result<Built> recognised = build_neighbours("scanner-path", cloud, 1);
    ASSERT_TRUE(recognised);
    EXPECT_EQ(recognised->table.of, said.of);
    EXPECT_EQ(recognised->notes.size(), 1u);
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
  found.cloud = built(places);
  found.cloud.properties = {row, scan, column};
  return found;
}

TEST(LookupTable, FindsTheNextPointAcrossHoles) {
  for (const double missing : {0.0, 0.3, 0.9})
    for (const bool wrap : {false, true})
      for (const std::uint32_t across : {0u, 1u, 2u, 30u}) {
        SCOPED_TRACE(testing::Message() << missing << " missing, wrap " << wrap << ", across " << across);
        const Holed scan = holed(13, 9, missing, 2);
        Result<ScanTable> table = scan_table_of(scan.cloud);
        ASSERT_TRUE(table);
        EXPECT_EQ(table->of, scan.of);
        if (wrap) table->columns_wrap = 13;
        LookupReport report;
        const NeighbourTable got = lookup_table(scan.cloud, *table, {across}, 3, &report).value();
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
  cloud::Cloud cloud = built({Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0)});
  EXPECT_FALSE(build_neighbours("lookup-table", cloud, 1)) << "no positions";
  for (const float bad : {-1.0F, 0.5F, 1e30F, std::numeric_limits<float>::quiet_NaN()}) {
    cloud.properties = {{"row", {0, 0, 1}}, {"column", {0, bad, 0}}};
    const Result<Built> refused = build_neighbours("lookup-table", cloud, 1);
    ASSERT_FALSE(refused) << bad;
    EXPECT_NE(refused.error().message().find("point 2"), std::string::npos);
  }
  EXPECT_FALSE(build_neighbours("scanner-path", cloud, 1)) << "three points are no raster";
  cloud.properties = {{"row", {0, 0, 0}}, {"column", {0, 1, 0}}};
  const Result<Built> twice = build_neighbours("lookup-table", cloud, 1);
  ASSERT_FALSE(twice);
  EXPECT_NE(twice.error().message().find("points 1 and 3"), std::string::npos);
  EXPECT_FALSE(lookup_table(cloud, {}, {}, 1)) << "a table of another cloud";
  // The ends of the range, with the longest reach.
  const std::uint32_t far = 4294967295u;
  const ScanTable edges{{{0, far, far}, {0, 0, 0}, {far, far, far - 1}}, 0, 0};
  EXPECT_EQ(lookup_table(cloud, edges, {1000}, 1)->count(0), 0u);
  cloud.raster = cloud::ScanRaster{2, 2};
  EXPECT_FALSE(scan_table_of(cloud));
}

}  // namespace
}  // namespace palpate::neighbourhood
