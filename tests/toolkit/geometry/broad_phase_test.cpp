// The box tree and the broad phase, against looking at every box.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/geometry/broad_phase.h"
#include "toolkit/geometry/segment_box.h"

namespace palpate::geometry {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

std::vector<Aabb> random_boxes(std::size_t n, double scale, const Vec3& around, Random& random) {
  std::vector<Aabb> boxes(n);
  for (Aabb& box : boxes) {
    const Vec3 p = around + scale * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    box.add(p);
    box.add(p + scale * 0.3 * Vec3(random.uniform(), random.uniform(), random.uniform()));
  }
  return boxes;
}

/// All boxes that meet the region, nearest first.
std::vector<BoxHit> brute_force(std::span<const Aabb> boxes, const Aabb& region) {
  std::vector<BoxHit> hits;
  for (std::uint32_t i = 0; i < boxes.size(); ++i) {
    bool meets = true;
    for (int axis = 0; axis < 3; ++axis)
      meets = meets && boxes[i].low_mm[axis] <= region.high_mm[axis] &&
              boxes[i].high_mm[axis] >= region.low_mm[axis];
    if (!meets) continue;
    double d = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
      const double c = 0.5 * (region.low_mm[axis] + region.high_mm[axis]);
      const double off = std::max({boxes[i].low_mm[axis] - c, c - boxes[i].high_mm[axis], 0.0});
      d += off * off;
    }
    hits.push_back({i, d});
  }
  std::stable_sort(hits.begin(), hits.end(),
                   [](const BoxHit& a, const BoxHit& b) { return a.distance_sq_mm2 < b.distance_sq_mm2; });
  return hits;
}

void expect_same(const BroadPhase& phase, std::span<const Aabb> boxes, const Aabb& region, std::size_t most) {
  std::vector<BoxHit> list(most);
  const BoxQuery query = phase.query(region, list);
  const std::vector<BoxHit> all = brute_force(boxes, region);
  ASSERT_EQ(query.hits, std::min(most, all.size()));
  ASSERT_EQ(query.hits + query.left_out, all.size());
  EXPECT_LE(query.nodes, 2 * boxes.size());
  for (std::uint32_t i = 0; i < query.hits; ++i) {
    EXPECT_EQ(list[i].item, all[i].item) << "rank " << i;
    EXPECT_NEAR(list[i].distance_sq_mm2, all[i].distance_sq_mm2, 1e-12 * (1.0 + all[i].distance_sq_mm2));
  }
}

TEST(BroadPhase, AgreesWithEveryBoxAtEverySizeAndScale) {
  Random random(11);
  for (const double scale : {1e-3, 1.0, 1e6})
    for (const double away : {0.0, 1e3})
      for (const std::size_t n : {1u, 2u, 3u, 7u, 64u, 1000u}) {
        const Vec3 around = Vec3::Constant(away * scale);
        const std::vector<Aabb> boxes = random_boxes(n, scale, around, random);
        const BroadPhase phase(boxes);
        for (int i = 0; i < 20; ++i) {
          Aabb region;
          region.add(around + scale * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform()));
          region = region.grown(scale * random.uniform(0.0, 0.6));
          for (const std::size_t most : {0u, 1u, 5u, 1000u}) expect_same(phase, boxes, region, most);
        }
      }
}

TEST(BroadPhase, MovedBoxesAreFoundWhereTheyAre) {
  Random random(12);
  std::vector<Aabb> boxes = random_boxes(300, 1.0, Vec3::Zero(), random);
  BroadPhase phase(boxes);
  for (int step = 0; step < 200; ++step) {
    for (Aabb& box : boxes) {
      const Vec3 by = 0.1 * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
      box = {box.low_mm + by, box.high_mm + by};
    }
    phase.update(boxes);
    expect_same(phase, boxes, Aabb{Vec3::Zero(), Vec3::Zero()}.grown(0.4), 300);
    expect_same(phase, boxes, Aabb{boxes[7].low_mm, boxes[7].high_mm}, 300);
  }
  EXPECT_GT(phase.rebuilds(), 0u) << "after 200 steps of a tenth of the scene the first tree is useless";
  // However the tree came to be.
  BroadPhase from_afar(random_boxes(300, 1.0, Vec3(5, 0, 0), random));
  from_afar.update(boxes);
  expect_same(from_afar, boxes, Aabb{Vec3::Zero(), Vec3::Zero()}.grown(0.5), 32);
}

/// A query's result with its hits, at most `Most`.
template <std::size_t Most>
struct FoundBoxes {
  std::array<BoxHit, Most> hit{};
  BoxQuery query;
  [[nodiscard]] std::span<const BoxHit> hits() const { return {hit.data(), query.hits}; }
};

/// Boxes within `reach` of a place along each axis.
template <std::size_t Most>
FoundBoxes<Most> found_near(const BroadPhase& phase, const Vec3& centre, double reach) {
  FoundBoxes<Most> found;
  found.query = phase.query(Aabb{centre, centre}.grown(reach), found.hit);
  return found;
}

TEST(BroadPhase, OddBoxes) {
  const double nan = std::nan("");
  const Aabb here{Vec3(0, 0, 0), Vec3(1, 1, 1)};
  const std::vector<Aabb> boxes = {here,
                                   Aabb{},                                            // empty
                                   {Vec3(nan, 0, 0), Vec3(1, 1, 1)},                  // unknown
                                   {Vec3::Constant(-kInf), Vec3::Constant(kInf)},     // everywhere
                                   {Vec3(-kInf, -kInf, 0.5), Vec3(kInf, kInf, 0.5)},  // a plane
                                   {Vec3(0.5, 0.5, 0.5), Vec3(0.5, 0.5, 0.5)},        // a point
                                   {Vec3(9, 9, 9), Vec3(10, 10, 10)}};
  const BroadPhase phase(boxes);
  auto found = found_near<8>(phase, Vec3(0.5, 0.5, 0.5), 0.25);
  std::vector<std::uint32_t> items;
  for (const BoxHit& hit : found.hits()) items.push_back(hit.item);
  EXPECT_EQ(items, (std::vector<std::uint32_t>{0, 3, 4, 5}));
  found = found_near<8>(phase, Vec3(nan, 0, 0), 1.0);
  EXPECT_EQ(found.query.hits, 0u);
  found = found_near<8>(phase, Vec3::Zero(), kInf);
  EXPECT_EQ(found.query.hits, 5u) << "an infinite region meets all but the empty and the unknown";
}

TEST(BroadPhase, AThousandEqualBoxesAndNone) {
  const std::vector<Aabb> same(1000, Aabb{Vec3(1, 1, 1), Vec3(2, 2, 2)});
  const BroadPhase phase(same);
  auto found = found_near<4>(phase, Vec3(1.5, 1.5, 1.5), 0.1);
  EXPECT_EQ(found.query.hits, 4u);
  EXPECT_EQ(found.query.left_out, 996u);
  for (std::uint32_t i = 0; i < 4; ++i) EXPECT_EQ(found.hits()[i].item, i) << "ties go by number";
  const BroadPhase none{std::span<const Aabb>{}};
  found = found_near<4>(none, Vec3::Zero(), 1.0);
  EXPECT_EQ(found.query.hits, 0u);
  EXPECT_EQ(BroadPhase().size(), 0u);
}

TEST(BroadPhase, FewNodesAreVisitedWhereFewBoxesAreNear) {
  std::vector<Aabb> row;
  for (int i = 0; i < 1000; ++i) row.push_back(Aabb{Vec3(10.0 * i, 0, 0), Vec3(10.0 * i + 1.0, 1, 1)});
  const BroadPhase phase(row);
  for (int i = 0; i < 1000; i += 37) {
    const auto found = found_near<4>(phase, Vec3(10.0 * i + 0.5, 0.5, 0.5), 2.0);
    ASSERT_EQ(found.query.hits, 1u);
    EXPECT_LE(found.query.nodes, 2u * 11u) << "two nodes a level, and 1000 boxes have eleven levels";
  }
}

TEST(AabbTree, NearestFirstFindsTheNearestCentre) {
  Random random(14);
  for (const std::uint32_t leaf : {1u, 4u}) {
    const std::vector<Aabb> boxes = random_boxes(500, 1.0, Vec3::Zero(), random);
    const AabbTree tree(
        500, [&](std::uint32_t i) { return boxes[i]; }, leaf);
    std::size_t looked_at = 0;
    for (int i = 0; i < 100; ++i) {
      const Vec3 p(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
      double best = kInf, truth = kInf;
      tree.visit_nearest([&](const Aabb& box) { return box.distance_sq_mm2(p); }, kInf,
                         [&](std::uint32_t item) {
                           ++looked_at;
                           return best = std::min(best, (boxes[item].centre_mm() - p).squaredNorm());
                         });
      for (const Aabb& box : boxes) truth = std::min(truth, (box.centre_mm() - p).squaredNorm());
      EXPECT_EQ(best, truth);
    }
    EXPECT_LT(looked_at, 100u * 500u / 4u) << "nothing was passed over";
  }
}

TEST(AabbTree, EveryItemIsInOneLeaf) {
  for (const std::uint32_t n : {1u, 5u, 17u, 1000u})
    for (const std::uint32_t leaf : {1u, 2u, 4u, 16u}) {
      const AabbTree tree(
          n,
          [](std::uint32_t) {
            return Aabb{Vec3::Zero(), Vec3::Zero()};
          },
          leaf);
      std::vector<int> seen(n, 0);
      tree.visit([](const Aabb&) { return true; }, [&](std::uint32_t i) { ++seen[i]; });
      EXPECT_EQ(std::count(seen.begin(), seen.end(), 1), n);
    }
}

TEST(BroadPhase, WhatLiesOnAWayOrInARegionIsAllThatBruteForceFinds) {
  Random random(5);
  for (const double scale : {1e-3, 1.0, 1e6}) {
    std::vector<Aabb> boxes = random_boxes(300, scale, Vec3::Zero(), random);
    boxes.push_back({Vec3::Constant(-kInf), Vec3::Constant(kInf)});
    boxes.emplace_back();  // empty
    boxes.push_back({Vec3::Zero(), Vec3::Zero()});
    const BroadPhase phase(boxes);
    for (int round = 0; round < 300; ++round) {
      const auto place = [&] {
        return Vec3{scale * random.uniform(-2, 2), scale * random.uniform(-2, 2),
                    scale * random.uniform(-2, 2)};
      };
      const Vec3 from = place();
      const Vec3 to = round % 5 == 0 ? from : place();
      const double reach = round % 3 == 0 ? 0.0 : 0.1 * scale;
      std::vector<std::uint32_t> found, expected;
      found.reserve(boxes.size());
      phase.along_segment(from, to, reach, found);
      for (std::uint32_t i = 0; i < boxes.size(); ++i) {
        if (boxes[i].empty()) continue;
        const Aabb grown = boxes[i].grown(reach);
        const bool infinite = !is_finite(Vec3(grown.extent_mm()));
        if (infinite || segment_touches_box({from, to}, grown.centre_mm(), 0.5 * Vec3(grown.extent_mm())))
          expected.push_back(i);
      }
      EXPECT_EQ(found, expected);

      Aabb region;
      region.add(from);
      region.add(to);
      phase.within(region, found);
      expected.clear();
      for (const BoxHit& hit : brute_force(boxes, region)) expected.push_back(hit.item);
      std::sort(expected.begin(), expected.end());
      EXPECT_EQ(found, expected);
    }
  }
}

// The swept sphere against a search along the segment.

double distance_at(const Vec3& p, const Vec3& centre, const Vec3& half) {
  const Vec3 q = (p - centre).cwiseAbs() - half;
  return q.cwiseMax(0.0).norm();
}

/// The distance is convex along the segment: thirds are cut off until nothing is left.
double searched(const Vec3& a, const Vec3& b, const Vec3& centre, const Vec3& half) {
  double low = 0.0, high = 1.0;
  for (int i = 0; i < 300; ++i) {
    const double s = low + (high - low) / 3.0, t = high - (high - low) / 3.0;
    if (distance_at(a + s * (b - a), centre, half) <= distance_at(a + t * (b - a), centre, half))
      high = t;
    else
      low = s;
  }
  return distance_at(a + 0.5 * (low + high) * (b - a), centre, half);
}

Vec3 some(Random& random, double size) {
  return {size * random.uniform(-1, 1), size * random.uniform(-1, 1), size * random.uniform(-1, 1)};
}

TEST(SweptSphere, MeasuresTheDistanceOfSegmentAndBox) {
  Random random(51);
  int apart = 0;
  for (int k = 0; k < 20000; ++k) {
    const double scale = std::pow(10.0, random.uniform(-6, 6));
    const Vec3 centre = some(random, k % 7 == 0 ? 100.0 * scale : scale);
    const Vec3 half = scale * Vec3(random.uniform(), random.uniform(), random.uniform());
    Vec3 a = centre + some(random, 2.0 * scale), b = centre + some(random, 2.0 * scale);
    if (k % 5 == 0) b = a;
    if (k % 5 == 1) b.y() = a.y();
    if (k % 5 == 2) b.tail<2>() = a.tail<2>();
    const SegmentProbe probe(a, b);
    const double expected = searched(a, b, centre, half);
    const double found = std::sqrt(segment_box_distance_sq(probe, centre, half));
    ASSERT_NEAR(found, expected, 1e-7 * scale) << k;
    apart += found > 0.0;
    // A hair on either side of the true distance.
    EXPECT_TRUE(swept_sphere_touches_box(probe, expected + 1e-6 * scale, centre, half)) << k;
    if (expected > 1e-5 * scale) {
      EXPECT_FALSE(swept_sphere_touches_box(probe, expected - 1e-6 * scale, centre, half)) << k;
    }
    if (segment_touches_box(probe, centre, half)) {
      EXPECT_TRUE(swept_sphere_touches_box(probe, 0.0, centre, half)) << k;
    }
  }
  EXPECT_GT(apart, 5000);
  EXPECT_LT(apart, 19000);
}

}  // namespace
}  // namespace palpate::geometry
