// Every builder against brute force over distributions that break grids and trees.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "tests/toolkit/search/cases.h"
#include "toolkit/core/random.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/knn_kernels.h"

namespace palpate::search {
namespace {

TEST(ExactKnn, EqualsBruteForceForAnyThreads) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const cloud::Cloud cloud = cloud_of(c.points);
    const NeighbourTable expected = brute(cloud);
    for (const int threads : {1, 3}) {
      const NeighbourTable table = exact_knn(cloud, threads);
      ASSERT_EQ(table.of.size(), expected.of.size());
      for (std::size_t i = 0; i < table.size(); ++i) ASSERT_EQ(table.of[i], expected.of[i]) << "point " << i;
    }
  }
}

// The printed procedure, step by step: refine while the block holds more than nine, grow while fewer.
Neighbours stepwise(const cloud::Cloud& cloud, std::uint32_t self, const ModifiedKnnOptions& options,
                    double start_mm, ModifiedKnnReport& report) {
  // The half edge of the smallest block that has each point in it.
  std::vector<std::pair<double, std::uint32_t>> reached;
  for (std::uint32_t j = 0; j < cloud.size(); ++j)
    reached.emplace_back((cloud.local_mm(j) - cloud.local_mm(self)).cwiseAbs().maxCoeff(), j);
  std::sort(reached.begin(), reached.end());
  const auto held = [&](double half) {
    const std::pair last(half, std::numeric_limits<std::uint32_t>::max());
    return static_cast<std::size_t>(std::upper_bound(reached.begin(), reached.end(), last) - reached.begin());
  };
  const double limit = 1.5 * start_mm * options.growth_limit;
  double half = 1.5 * start_mm;
  while (half / options.refinement <= limit) half /= options.refinement;
  std::size_t smallest_enough = held(half);
  const bool limited = smallest_enough < 9;
  std::size_t at_most = limited ? smallest_enough : 0;
  if (!limited) {
    std::size_t next = smallest_enough;
    for (int step = 0; step < 4000 && next >= 9; ++step) {
      smallest_enough = next;
      half *= options.refinement;
      next = held(half);
    }
    at_most = smallest_enough == 9 ? smallest_enough : next;
  }
  const bool at_nine = !limited && (smallest_enough == 9 || !options.complete_to_eight);
  report.stopped_at_limit += limited;
  report.stopped_at_nine += at_nine;
  const std::size_t chosen = options.complete_to_eight && !limited ? smallest_enough : at_most;
  std::vector<std::pair<double, std::uint32_t>> order;
  for (std::size_t k = 0; k < chosen; ++k)
    if (const std::uint32_t j = reached[k].second; j != self) {
      const Vec3 d = cloud.local_mm(j) - cloud.local_mm(self);
      order.emplace_back(d.x() * d.x() + d.y() * d.y() + d.z() * d.z(), j);
    }
  report.fewer_than_eight += order.size() < kNeighbours;
  std::sort(order.begin(), order.end());
  Neighbours n;
  n.fill(self);
  for (std::size_t k = 0; k < std::min(order.size(), kNeighbours); ++k) n[k] = order[k].second;
  return n;
}

TEST(ModifiedKnn, IsThePrintedProcedure) {
  for (const bool complete : {true, false}) {
    for (const Case& c : cases()) {
      if (c.name == "all at one place" || c.name == "pile beside a sheet")
        continue;  // no block separates a pile
      SCOPED_TRACE(c.name + (complete ? ", completed" : ", as printed"));
      const cloud::Cloud cloud = cloud_of(c.points);
      ModifiedKnnOptions options;
      options.complete_to_eight = complete;
      ModifiedKnnReport report;
      const NeighbourTable table = modified_knn(cloud, options, 2, &report);
      const double start = mean_spacing_mm(cloud);
      // All points of small clouds, and then the report too; every seventh of others.
      constexpr std::size_t kSmall = 1000;
      const std::uint32_t stride = cloud.size() <= kSmall ? 1 : 7;
      ModifiedKnnReport expected;
      for (std::uint32_t i = 0; i < cloud.size(); i += stride)
        ASSERT_EQ(table.of[i], stepwise(cloud, i, options, start, expected)) << "point " << i;
      if (stride > 1) continue;
      EXPECT_EQ(report.stopped_at_nine, expected.stopped_at_nine);
      EXPECT_EQ(report.stopped_at_limit, expected.stopped_at_limit);
      EXPECT_EQ(report.fewer_than_eight, expected.fewer_than_eight);
    }
  }
}

// However fine its steps: none of the sizes between the limit and the points may be left out.
TEST(ModifiedKnn, IsThePrintedProcedureInFineStepsToo) {
  const cloud::Cloud cloud = cloud_of(sheet(20, 20, 0.1, 0.3, 6));
  const double start = mean_spacing_mm(cloud);
  for (const double refinement : {0.5, 0.9, 0.98, 0.99}) {
    SCOPED_TRACE(refinement);
    ModifiedKnnOptions options;
    options.complete_to_eight = false;
    options.refinement = refinement;
    const NeighbourTable table = modified_knn(cloud, options, 2);
    ModifiedKnnReport expected;
    for (std::uint32_t i = 0; i < cloud.size(); ++i)
      ASSERT_EQ(table.of[i], stepwise(cloud, i, options, start, expected)) << "point " << i;
  }
}

TEST(ModifiedKnn, PilesKeepEightAtDistanceZero) {
  const cloud::Cloud cloud = cloud_of(std::vector<Vec3>(300, Vec3(5, 5, 5)));
  const NeighbourTable table = modified_knn(cloud, {}, 1);
  for (std::uint32_t i = 0; i < cloud.size(); ++i) EXPECT_EQ(table.count(i), 8u);
}

TEST(ScannerPath, AgreesExactlyInsideAFlatGridOnly) {
  cloud::Cloud cloud = cloud_of(sheet(60, 50, 0.25, 0.0, 1));  // 0.25 is exact, so distances tie exactly
  cloud.raster = cloud::ScanRaster{60, 50};
  const NeighbourTable path = scanner_path(cloud, 0).value();
  for (const NeighbourTable& table : {modified_knn(cloud, {}, 0), exact_knn(cloud, 0)}) {
    std::size_t equal = 0, interior = 0;
    for (std::uint32_t i = 0; i < cloud.size(); ++i) {
      if (path.count(i) < kNeighbours) continue;
      ++interior;
      Neighbours a = path.of[i], b = table.of[i];
      std::sort(a.begin(), a.end());
      std::sort(b.begin(), b.end());
      equal += a == b;
    }
    EXPECT_EQ(interior, 58u * 48u);
    EXPECT_EQ(equal, interior);
    const Agreement counted = agreement(path, table);
    EXPECT_EQ(counted.interior_equal, interior);
    EXPECT_LT(counted.equal_sets, counted.points);  // borders differ
  }
}

// The inner loops that a processor may have in wider registers, against the portable ones.

struct Sample {
  Candidates candidates;
  std::vector<Vec3> points;  ///< the same, for the tests' own sums
  std::uint32_t self = 0;
};

/// n candidates in [-size, size]^3, most of them on a lattice so that distances tie; indices in no order.
Sample sample(std::size_t n, double size, Random& random) {
  Sample s;
  s.candidates.make_room(n);
  std::vector<std::uint32_t> index(n);
  for (std::size_t i = 0; i < n; ++i) index[i] = static_cast<std::uint32_t>(i * 2654435761u);
  for (std::size_t i = 0; i < n; ++i) {
    Vec3 p(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    if (i % 4 != 0) p = (p * 4.0).array().round() / 4.0;
    s.candidates.x[i] = static_cast<float>(size * p.x());
    s.candidates.y[i] = static_cast<float>(size * p.y());
    s.candidates.z[i] = static_cast<float>(size * p.z());
    s.candidates.index[i] = index[i];
    s.points.emplace_back(static_cast<double>(s.candidates.x[i]), static_cast<double>(s.candidates.y[i]),
                          static_cast<double>(s.candidates.z[i]));
  }
  s.candidates.close(n);
  s.self = index[n / 2];
  return s;
}

double square(const Vec3& a, const Vec3& b) {
  const Vec3 d = a - b;
  return d.x() * d.x() + d.y() * d.y() + d.z() * d.z();
}

/// From where squares of floats vanish to where they overflow.
constexpr double kSizes[] = {1e-41, 1e-24, 1e-19, 1.0, 1e6, 1e19, 3e38};

std::vector<std::uint32_t> kept_of(const KnnScratch& scratch) {
  return {scratch.index.data(), scratch.index.data() + scratch.count};
}

TEST(Kernels, SievesLoseNothingAndMeasureExactly) {
  Random random(21);
  for (const Kernels* kernel : {&portable_kernels(), &kernels()})
    for (const double size : kSizes)
      for (const std::size_t n : {1u, 7u, 8u, 9u, 64u, 133u}) {
        const Sample s = sample(n, size, random);
        const Vec3 p = s.points[n / 2];
        KnnScratch scratch;
        for (const Vec3& edge : s.points) {
          // The limit is the exact distance of some candidate: the hardest to keep.
          const double ball = square(edge, p), cube = (edge - p).cwiseAbs().maxCoeff();
          kernel->keep_ball(s.candidates, p, ball, scratch);
          std::vector<std::uint32_t> kept = kept_of(scratch);
          for (std::size_t i = 0; i < n; ++i)
            ASSERT_TRUE(square(s.points[i], p) > ball ||
                        std::find(kept.begin(), kept.end(), s.candidates.index[i]) != kept.end())
                << size;
          kernel->keep_cube(s.candidates, p, cube, scratch);
          kept = kept_of(scratch);
          std::size_t at = 0, outer = 0, inner = 0;
          for (std::size_t i = 0; i < n; ++i) {
            const double along = (s.points[i] - p).cwiseAbs().maxCoeff();
            outer += along <= cube;
            inner += along <= 0.5 * cube;
            if (at == kept.size() || kept[at] != s.candidates.index[i]) {
              ASSERT_GT(along, cube);
              continue;
            }
            ASSERT_EQ(scratch.along[at], along);
            ASSERT_EQ(scratch.square[at], square(s.points[i], p));
            ++at;
          }
          ASSERT_EQ(at, kept.size());
          const CubeCounts held = kernel->count_in_cubes(scratch, cube, 0.5 * cube);
          ASSERT_EQ(held.outer, outer);
          ASSERT_EQ(held.inner, inner);
        }
      }
}

TEST(Kernels, ASieveOfAFewKeepsFew) {
  Random random(22);
  const Sample s = sample(1000, 1.0, random);
  for (const Kernels* kernel : {&portable_kernels(), &kernels()}) {
    KnnScratch scratch;
    kernel->keep_ball(s.candidates, s.points[0], 0.0, scratch);
    std::size_t same = 0;
    for (const Vec3& p : s.points) same += p == s.points[0];
    EXPECT_EQ(scratch.count, same);
  }
}

TEST(Kernels, ChooseTheEightFirstByDistanceAndIndex) {
  Random random(23);
  for (const Kernels* kernel : {&portable_kernels(), &kernels()})
    for (const double size : kSizes)
      for (const std::size_t n : {1u, 2u, 8u, 9u, 10u, 12u, 13u, 16u, 23u, 24u, 25u, 60u})
        for (const double share : {0.0, 0.3, 2.0}) {
          const Sample s = sample(n, size, random);
          const Vec3 p = s.points[n / 2];
          KnnScratch scratch;
          kernel->keep_cube(s.candidates, p, kNoLimit, scratch);
          ASSERT_EQ(scratch.count, n);
          kernel->exclude_cube(scratch, share * size);
          std::vector<std::pair<double, std::uint32_t>> expected;
          for (std::size_t i = 0; i < n; ++i)
            if ((s.points[i] - p).cwiseAbs().maxCoeff() <= share * size && s.candidates.index[i] != s.self)
              expected.emplace_back(square(s.points[i], p), s.candidates.index[i]);
          std::sort(expected.begin(), expected.end());
          Neighbours out;
          const double worst = kernel->choose_eight(s.self, scratch, out);
          ASSERT_EQ(worst, expected.size() < kNeighbours ? kNoLimit : expected[kNeighbours - 1].first);
          for (std::size_t k = 0; k < kNeighbours; ++k)
            ASSERT_EQ(out[k], k < expected.size() ? expected[k].second : s.self) << n << " place " << k;
        }
}

// Tables that a walk can follow: scan lines far apart, clumps, and no change where points lie evenly.

/// Share of walks from a random point to another that come to it.
double arrivals(const cloud::Cloud& cloud, const NeighbourTable& table, std::uint64_t seed) {
  Random random(seed);
  constexpr int kWalks = 2000;
  int arrived = 0;
  for (int w = 0; w < kWalks; ++w) {
    const auto pick = [&] {
      const double at = random.uniform() * static_cast<double>(cloud.size());
      return std::min(static_cast<std::uint32_t>(at), static_cast<std::uint32_t>(cloud.size() - 1));
    };
    std::uint32_t at = pick();
    const Vec3 goal = cloud.local_mm(pick());
    for (bool moved = true; moved;) {
      moved = false;
      std::uint32_t best = at;
      for (const std::uint32_t n : table.of[at])
        if ((cloud.local_mm(n) - goal).squaredNorm() < (cloud.local_mm(best) - goal).squaredNorm()) best = n;
      moved = best != at;
      at = best;
    }
    arrived += cloud.local_mm(at) == goal;
  }
  return static_cast<double>(arrived) / kWalks;
}

std::vector<Vec3> lines(double apart) {
  Random random(2);
  std::vector<Vec3> points;
  for (int r = 0; r < 30; ++r)
    for (int c = 0; c < 200; ++c)
      points.emplace_back(0.1 * (c + 0.2 * random.uniform()), apart * r, 0.01 * random.uniform());
  return points;
}

TEST(Walkable, ScanLinesFarApartAreJoined) {
  const cloud::Cloud cloud = cloud_of(lines(0.6));
  NeighbourTable table = exact_knn(cloud, 0);
  EXPECT_LT(arrivals(cloud, table, 1), 0.1);  // the eight nearest stay in their line
  const WalkableReport report = make_walkable(cloud, table, 0);
  EXPECT_GT(report.spread, cloud.size() / 2);
  EXPECT_GT(arrivals(cloud, table, 1), 0.99);
}

TEST(Walkable, AClumpIsLeftAgain) {
  Random random(3);
  std::vector<Vec3> points;
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 40; ++c) points.emplace_back(c, r, 0.0);
  for (int k = 0; k < 20; ++k) {
    const Vec3 middle(5.3 + (k % 5) * 7.0, 4.6 + (k / 5) * 9.0, 0.0);
    for (int i = 0; i < 12; ++i)
      points.push_back(middle + 0.01 * Vec3(random.normal(), random.normal(), random.normal()));
  }
  const cloud::Cloud cloud = cloud_of(points);
  NeighbourTable table = exact_knn(cloud, 0);
  const double before = arrivals(cloud, table, 4);
  const WalkableReport report = make_walkable(cloud, table, 0);
  EXPECT_GT(report.spread + report.returned, 0u);
  const double after = arrivals(cloud, table, 4);
  EXPECT_LT(before, 0.9);
  EXPECT_GT(after, 0.97);
}

TEST(Walkable, AnEvenLatticeStaysInside) {
  const cloud::Cloud cloud = cloud_of(sheet(30, 30, 1.0, 0.0, 1));
  NeighbourTable table = exact_knn(cloud, 0);
  const NeighbourTable before = table;
  make_walkable(cloud, table, 0);
  for (std::uint32_t r = 2; r < 28; ++r)
    for (std::uint32_t c = 2; c < 28; ++c) EXPECT_EQ(table.of[r * 30 + c], before.of[r * 30 + c]);
}

TEST(Walkable, RowsAreOrderedAndTheSameForAnyNumberOfThreads) {
  std::vector<Vec3> points = lines(0.45);
  for (int i = 0; i < 30; ++i) points.push_back(points[7]);
  const cloud::Cloud cloud = cloud_of(points);
  NeighbourTable one = exact_knn(cloud, 1), all = exact_knn(cloud, 0);
  make_walkable(cloud, one, 1);
  make_walkable(cloud, all, 0);
  EXPECT_EQ(one.of, all.of);
  for (std::uint32_t i = 0; i < one.size(); ++i)
    for (std::size_t k = 1; k < kNeighbours; ++k) {
      if (one.of[i][k] == i) continue;
      const double a = (cloud.local_mm(one.of[i][k - 1]) - cloud.local_mm(i)).squaredNorm(),
                   b = (cloud.local_mm(one.of[i][k]) - cloud.local_mm(i)).squaredNorm();
      ASSERT_TRUE(a < b || (a == b && one.of[i][k - 1] < one.of[i][k]));
    }
}

TEST(Walkable, TinyCloudsAreSurvived) {
  for (std::size_t n = 1; n < 12; ++n) {
    std::vector<Vec3> points;
    for (std::size_t i = 0; i < n; ++i)
      points.emplace_back(static_cast<double>(i % 3), i == 5 ? 1.0 : 0.0, 0.0);
    const cloud::Cloud cloud = cloud_of(points);
    NeighbourTable table = exact_knn(cloud, 0);
    make_walkable(cloud, table, 0);
    EXPECT_EQ(table.size(), n);
  }
}

}  // namespace
}  // namespace palpate::search
