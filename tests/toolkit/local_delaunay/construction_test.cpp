// The inner loops of the making of stars: with lanes and without, and what they promise.
#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <tuple>
#include <vector>

#include "tests/toolkit/local_delaunay/clouds.h"
#include "toolkit/core/random.h"

#include "toolkit/core/simd.h"
#include "toolkit/local_delaunay/avx2_kernels.h"
#include "toolkit/local_delaunay/candidate_triangulation.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"
#include "toolkit/local_delaunay/spatial_sort.h"

namespace palpate::local_delaunay {
namespace {

using Point = std::tuple<float, float, float, std::uint32_t>;

Point point(const GroupPoint& p) {
  return {p.at[0], p.at[1], p.at[2], p.index};
}

/// Groups of all sizes: random, on a lattice with its ties, on a line, all in one place, with zeros of both
/// signs, and with coordinates of all magnitudes.
std::vector<std::vector<GroupPoint>> groups() {
  std::vector<std::vector<GroupPoint>> all;
  Random random(71);
  for (const std::size_t size :
       {std::size_t{1}, std::size_t{8}, std::size_t{9}, std::size_t{17}, std::size_t{31}, std::size_t{40},
        std::size_t{129}, std::size_t{511}, kGroupPoints})
    for (int kind = 0; kind < 6; ++kind) {
      std::vector<GroupPoint> group;
      for (std::uint32_t i = 0; i < size; ++i) {
        const auto value = [&] { return static_cast<float>(random.uniform(-1.0, 1.0)); };
        const auto step = [&] { return std::floor(4.0F * value()); };
        const auto add = [&](float x, float y, float z) {
          group.push_back({{x, y, z}, static_cast<std::uint32_t>(size) - i, i});
        };
        if (kind == 0) add(value(), 2.0F * value(), value());
        if (kind == 1) add(step(), step(), 0.0F);
        if (kind == 2) add(value(), 0.0F, 0.0F);
        if (kind == 3) add(1.0F, 2.0F, 3.0F);
        if (kind == 4) add(i % 2 == 0 ? 0.0F : -0.0F, step(), -0.0F);
        if (kind == 5) add(std::exp(80.0F * value()), -std::exp(40.0F * value()), value());
      }
      all.push_back(group);
    }
  return all;
}

/// What split_at_medians() promises, the slow way.
void halve_sorted(std::vector<Point>& points, std::size_t first, std::size_t last) {
  const std::size_t blocks = (last - first + kBlockPlaces - 1) / kBlockPlaces;
  if (blocks < 2) return;
  const auto at = [](const Point& p) {
    return std::array<float, 3>{std::get<0>(p), std::get<1>(p), std::get<2>(p)};
  };
  std::array<float, 3> low = at(points[first]), high = low;
  for (std::size_t i = first; i < last; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], at(points[i])[axis]);
      high[axis] = std::max(high[axis], at(points[i])[axis]);
    }
  std::size_t longest = 0;
  for (std::size_t axis = 1; axis < 3; ++axis)
    if (high[axis] - low[axis] > high[longest] - low[longest]) longest = axis;
  const auto before = [&](const Point& a, const Point& b) {
    return at(a)[longest] != at(b)[longest] ? at(a)[longest] < at(b)[longest] : a < b;
  };
  const std::size_t middle = first + (blocks + 1) / 2 * kBlockPlaces;
  std::vector<Point> sorted(points.begin() + static_cast<std::ptrdiff_t>(first),
                            points.begin() + static_cast<std::ptrdiff_t>(last));
  std::sort(sorted.begin(), sorted.end(), before);
  const Point bound = sorted[middle - first];
  std::stable_partition(points.begin() + static_cast<std::ptrdiff_t>(first),
                        points.begin() + static_cast<std::ptrdiff_t>(last),
                        [&](const Point& p) { return before(p, bound); });
  halve_sorted(points, first, middle);
  halve_sorted(points, middle, last);
}

TEST(Halving, PutsPointsInBlocksInTheOrderThatTheyCameIn) {
  for (std::vector<GroupPoint> group : groups()) {
    std::vector<Point> expected;
    for (const GroupPoint& p : group) expected.push_back(point(p));
    halve_sorted(expected, 0, expected.size());
    split_at_medians(group);
    for (std::size_t i = 0; i < group.size(); ++i)
      ASSERT_EQ(point(group[i]), expected[i]) << i << " of " << group.size();
  }
}

/// Points in a plane that is tilted, or at random in space, and frames of four of them.
struct Neighbourhood {
  std::vector<SortedPoint> points;
  std::array<std::array<std::uint32_t, 16>, 4> near;
  std::array<PlanarFrame, 4> frames;
  double reach = 0.0;

  Neighbourhood(Random& random, int kind) {
    const auto value = [&] { return static_cast<float>(random.uniform(-1.0, 1.0)); };
    for (int i = 0; i < 30; ++i) {
      const float x = kind == 1 ? std::floor(3.0F * value()) : value();
      const float y = kind == 1 ? std::floor(3.0F * value()) : value();
      const float z = kind == 2 ? value() : 0.3F * x + 0.05F * value();
      points.push_back({x, y, z, 0.01F * value()});
    }
    reach = kind == 3 ? 0.3 : 3.0;
    for (std::uint32_t c = 0; c < 4; ++c) {
      PlanarFrame& frame = frames[c];
      frame.at = points[c].at();
      std::vector<std::uint32_t> others;
      for (std::uint32_t i = 0; i < points.size(); ++i)
        if (i != c) others.push_back(i);
      std::sort(others.begin(), others.end(), [&](std::uint32_t a, std::uint32_t b) {
        return (points[a].at() - frame.at).squaredNorm() < (points[b].at() - frame.at).squaredNorm();
      });
      std::copy_n(others.begin(), 16, near[c].begin());
      frame.normal = Vec3(-0.3, 0.05, 1.0).normalized();
      frame.e = frame.normal.unitOrthogonal();
      frame.f = frame.normal.cross(frame.e);
      frame.weight = static_cast<double>(points[c].weight);
      frame.steepest_sq = 0.36;
      frame.near = near[c].data();
      frame.count = c == 3 ? 7 : 16;
    }
  }
};

/// One neighbour as PlanarNeighbours has it.
void cut_one(const Neighbourhood& around, const PlanarFrame& frame, std::uint32_t other,
             PlanarVoronoiCell& cell) {
  const SortedPoint& placed = around.points[other];
  const Vec3 d = placed.at() - frame.at;
  const double square = d.squaredNorm(), weights = frame.weight - static_cast<double>(placed.weight);
  const double half_square = 0.5 * (square + weights);
  if (half_square > 0.0 && half_square * half_square >= cell.reach_sq() * square) return;
  const double height = frame.normal.dot(d), u = frame.e.dot(d), v = frame.f.dot(d);
  if (height * height > frame.steepest_sq * square || !(u * u + v * v > 0.0)) return;
  const double unfold = std::sqrt(square / (u * u + v * v));
  cell.cut({u * unfold, v * unfold, half_square}, other);
}

TEST(WideCells, AreCutAsOneByOne) {
  if (!has_avx2()) GTEST_SKIP() << "no AVX2 here";
  Random random(72);
  std::size_t cut_wide = 0, cells_in_all = 0;
  for (int round = 0; round < 4000; ++round) {
    const Neighbourhood around(random, round % 4);
    std::array<PlanarVoronoiCell, 4> wide, narrow;
    for (std::size_t c = 0; c < 4; ++c) {
      wide[c].start(around.reach);
      narrow[c].start(around.reach);
    }
    const std::array<std::size_t, 4> done = cut_four(around.points.data(), around.frames, wide);
    for (std::size_t c = 0; c < 4; ++c) {
      const PlanarFrame& frame = around.frames[c];
      ASSERT_LE(done[c], frame.count);
      cut_wide += done[c];
      cells_in_all += frame.count;
      for (std::size_t k = done[c]; k < frame.count; ++k) cut_one(around, frame, frame.near[k], wide[c]);
      for (std::size_t k = 0; k < frame.count; ++k) cut_one(around, frame, frame.near[k], narrow[c]);
      ASSERT_EQ(wide[c].size(), narrow[c].size()) << round;
      ASSERT_EQ(wide[c].reach_sq(), narrow[c].reach_sq()) << round;
      for (std::size_t j = 0; j < narrow[c].size(); ++j) {
        ASSERT_EQ(wide[c].side(j), narrow[c].side(j)) << round;
        ASSERT_EQ(wide[c].corner_sq(j), narrow[c].corner_sq(j)) << round;
      }
    }
  }
  EXPECT_GT(cut_wide, cells_in_all * 9 / 10);  // few have more than eight corners
}

TEST(WideNear, PlacesBetweenAreAsOneByOne) {
  Random random(73);
  for (int round = 0; round < 1000; ++round) {
    const Neighbourhood around(random, round % 3);
    const PlanarFrame& frame = around.frames[0];
    const auto square = [&](std::size_t k) {
      return (around.points[frame.near[k]].at() - frame.at).squaredNorm();
    };
    const double beyond = square(3), within = square(11);
    unsigned expected = 0;
    for (unsigned k = 0; k < 16; ++k)
      expected |= static_cast<unsigned>(square(k) > beyond && square(k) <= within) << k;
    EXPECT_EQ(points_between(around.points.data(), frame.near, frame.at, beyond, within), expected);
  }
}

TEST(WideNear, PlanesAreAsOneByOne) {
  if (!has_avx2()) GTEST_SKIP() << "no AVX2 here";
  Random random(74);
  for (int round = 0; round < 1000; ++round) {
    const Neighbourhood around(random, round % 3);
    std::array<std::uint32_t, 4> place;
    std::array<const std::uint32_t*, 4> near;
    for (std::uint32_t c = 0; c < 4; ++c) {
      place[c] = c;
      near[c] = around.near[c].data();
    }
    PlaneBatch planes;
    fit_four_planes(around.points.data(), place, near, planes);
    for (std::size_t c = 0; c < 4; ++c) {
      Vec3 first = Vec3::Zero();
      surface::SymmetricMatrix3 s;
      for (std::size_t k = 0; k < kPlaneNear; ++k) {
        const Vec3 d = around.points[near[c][k]].at() - around.points[place[c]].at();
        first += d;
        s = {s.xx + d.x() * d.x(), s.xy + d.x() * d.y(), s.xz + d.x() * d.z(),
             s.yy + d.y() * d.y(), s.yz + d.y() * d.z(), s.zz + d.z() * d.z()};
      }
      const double share = 1.0 / static_cast<double>(kPlaneNear + 1);
      const Vec3& m = first;
      s = {s.xx - share * m.x() * m.x(), s.xy - share * m.x() * m.y(), s.xz - share * m.x() * m.z(),
           s.yy - share * m.y() * m.y(), s.yz - share * m.y() * m.z(), s.zz - share * m.z() * m.z()};
      EXPECT_EQ(std::memcmp(&planes.covariance[c], &s, sizeof s), 0);
      Vec3 normal;
      ASSERT_EQ(surface::smallest_eigenvector(s, normal), planes.has_normal[c]);
      if (planes.has_normal[c]) {
        EXPECT_EQ(planes.normal[c], normal);
      }
    }
  }
}

// A refined surface: as sound as what it is made of, nearer to smooth surfaces by the order that was
// promised, and not rounder at creases.

/// Over a sphere around the world's origin: how far the middles of facets are off it, and how far their
/// normals are turned, as root mean squares.
struct Off {
  double height = 0.0, turn = 0.0;
};
Off off_sphere(const LocalDelaunayMesh& mesh, double radius) {
  Off off;
  std::size_t count = 0;
  each_triangle(mesh, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const Vec3 middle = (mesh.at(a) + mesh.at(b) + mesh.at(c)) / 3.0 + mesh.origin_mm();
    const Vec3 n = (mesh.at(b) - mesh.at(a)).cross(mesh.at(c) - mesh.at(a)).normalized();
    off.height += std::pow(middle.norm() - radius, 2);
    off.turn += (n - middle.normalized()).squaredNorm();
    ++count;
  });
  off.height = std::sqrt(off.height / static_cast<double>(count));
  off.turn = std::sqrt(off.turn / static_cast<double>(count));
  return off;
}

TEST(Refined, IsSoundOnAnyPoints) {
  for (const Named& cloud : all_clouds()) {
    SCOPED_TRACE(cloud.name);
    const LocalDelaunayMesh coarse = LocalDelaunayMesh::build(cloud_of(cloud.points), 2);
    const LocalDelaunayMesh fine = refined(coarse, 1, 2);
    expect_sound(fine);
    EXPECT_EQ(fine.counts().triangles, 4 * coarse.counts().triangles);
    EXPECT_EQ(fine.counts().closed_components, coarse.counts().closed_components);
  }
}

TEST(Refined, IsNearerToASphereByAnOrder) {
  const LocalDelaunayMesh coarse = LocalDelaunayMesh::build(cloud_of(random_spheres({10.0}, 0.5, 41)), 2);
  const Off before = off_sphere(coarse, 10.0);
  const Off once = off_sphere(refined(coarse, 1, 2), 10.0);
  const Off twice = off_sphere(refined(coarse, 2, 2), 10.0);
  EXPECT_LT(once.height, 0.3 * before.height);
  EXPECT_LT(twice.height, 0.3 * once.height);
  EXPECT_LT(once.turn, 0.55 * before.turn);
  EXPECT_LT(twice.turn, 0.55 * once.turn);
}

TEST(Refined, KeepsThePointsAndTheCreases) {
  // A floor and a wall, joined by points of both.
  std::vector<Vec3> points;
  for (int y = 0; y <= 20; ++y)
    for (int k = -10; k <= 10; ++k) points.emplace_back(std::min(k, 0), y, std::max(k, 0));
  const LocalDelaunayMesh coarse = LocalDelaunayMesh::build(cloud_of(points), 2);
  // The ends of the crease may have a triangle more or less.
  ASSERT_NEAR(static_cast<double>(coarse.counts().triangles), 2.0 * 20.0 * 20.0, 2.0);
  const LocalDelaunayMesh fine = refined(coarse, 2, 2);
  std::size_t kept = 0;
  for (std::uint32_t i = 0; i < fine.size(); ++i) {
    const Vec3 p = fine.at(i) + fine.origin_mm();
    if (p.y() > 1.0 && p.y() < 19.0) {
      EXPECT_LT(std::min(std::abs(p.x()), std::abs(p.z())), 1e-6);
    }
    kept += static_cast<std::size_t>((points[fine.order()[i]] - p).norm() < 1e-6);
  }
  EXPECT_EQ(kept, points.size());
}

TEST(Refined, IsTheSameForAnyNumberOfThreads) {
  const LocalDelaunayMesh coarse = LocalDelaunayMesh::build(cloud_of(random_torus(20000, 0.0, 42)), 2);
  const LocalDelaunayMesh one = refined(coarse, 1, 1), many = refined(coarse, 1, 0);
  ASSERT_EQ(one.size(), many.size());
  EXPECT_EQ(one.order(), many.order());
  for (std::uint32_t i = 0; i < one.size(); ++i) {
    ASSERT_EQ(one.at(i), many.at(i));
    const Ring a = one.ring(i), b = many.ring(i);
    ASSERT_TRUE(std::equal(a.of, a.of + a.size, b.of, b.of + b.size) && a.open == b.open);
  }
}

/// A place at most `reach` along the curve from another.
std::uint32_t place_beside(std::uint32_t place, std::uint32_t reach, std::uint32_t count, Random& random) {
  const auto low = place < reach ? 0u : place - reach, high = std::min(place + reach, count - 1);
  return low + static_cast<std::uint32_t>(random.below(high - low + 1));
}

// Short and long stars, with places so near and so far that they are stored in either way.
TEST(StarTable, HoldsStarsAndNearestPointsAsTheyAre) {
  constexpr std::uint32_t kCount = 200000;
  Random random(73);
  StarTable stars;
  NearTable nearest;
  stars.resize(kCount);
  nearest.resize(kCount);
  for (int round = 0; round < 20000; ++round) {
    const auto place = static_cast<std::uint32_t>(random.below(kCount));
    const std::array<std::uint32_t, 4> reaches{40, kMaxPlaceOffset, kMaxPlaceOffset + 2, kCount};
    const std::uint32_t reach = reaches[random.below(4)];
    Star star;
    for (const auto size = random.below(kMaxCorners + 1); star.size < size;) {
      const std::uint32_t other = place_beside(place, reach, kCount, random);
      if (other != place && star.find(other) == star.size) star.ring[star.size++] = other;
    }
    star.open = static_cast<std::uint32_t>(random.below(std::uint64_t{1} << star.size));
    NearestPoints near;
    for (std::uint32_t& other : near) other = place_beside(place, reach, kCount, random);
    stars.put(place, star);
    nearest.put(place, near);
    EXPECT_EQ(nearest[place], near);
    star.agreed = static_cast<std::uint32_t>(random.below(std::uint64_t{1} << star.size));
    stars.set_agreed(place, star.agreed);
    const Star held = stars[place];
    ASSERT_EQ(stars.size(place), star.size);
    ASSERT_TRUE(held.size == star.size && held.open == star.open && held.agreed == star.agreed);
    ASSERT_TRUE(std::equal(star.ring.begin(), star.ring.begin() + star.size, held.ring.begin()));
    for (std::uint32_t k = 0; k <= star.size; ++k) {
      const std::uint32_t b = k < star.size ? star.ring[k] : place_beside(place, reach, kCount, random);
      ASSERT_EQ(stars.find(place, b), star.find(b));
      for (std::uint32_t j = 0; j < star.size; ++j)
        ASSERT_EQ(stars.holds(place, k, star.ring[j]), star.holds(k, star.ring[j]));
    }
    const StarTable::Line before = stars.line(place);
    stars.put(place, {});
    ASSERT_EQ(stars.size(place), 0u);
    stars.put_back(place, before);
    ASSERT_EQ(stars[place].ring[0], held.ring[0]);
  }
}

}  // namespace
}  // namespace palpate::local_delaunay
