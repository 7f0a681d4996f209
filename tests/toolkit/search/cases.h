// Clouds that break grids and trees, the nearest eight of their points by brute force, segments near them.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <palpate/cloud.h>
#include "toolkit/core/random.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

inline cloud::Cloud cloud_of(const std::vector<Vec3>& points) {
  return cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
}

struct Case {
  std::string name;
  std::vector<Vec3> points;
};

inline std::vector<Vec3> sheet(int columns, int rows, double step, double jitter, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c)
      points.emplace_back(step * (c + jitter * random.uniform(-0.5, 0.5)),
                          step * (r + jitter * random.uniform(-0.5, 0.5)), jitter * step * random.uniform());
  return points;
}

inline std::vector<Case> cases() {
  std::vector<Case> all;
  Random random(11);
  all.push_back({"one", {Vec3(1, 2, 3)}});
  all.push_back({"two", {Vec3(1, 2, 3), Vec3(1, 2, 4)}});
  all.push_back({"nine in a line", {}});
  for (int i = 0; i < 9; ++i) all.back().points.emplace_back(i, 0, 0);
  all.push_back({"lattice sheet", sheet(40, 30, 0.1, 0.0, 1)});
  all.push_back({"jittered sheet", sheet(40, 30, 0.1, 0.8, 2)});
  all.push_back({"tiny far sheet", sheet(20, 20, 1e-4, 0.5, 3)});
  for (Vec3& p : all.back().points) p += Vec3(1e5, -2e5, 3e5);
  all.push_back({"volume", {}});
  for (int i = 0; i < 1500; ++i)
    all.back().points.emplace_back(random.uniform(), random.uniform(), random.uniform());
  all.push_back({"all at one place", std::vector<Vec3>(300, Vec3(5, 5, 5))});
  all.push_back({"pile beside a sheet", sheet(20, 20, 1.0, 0.3, 4)});
  for (int i = 0; i < 400; ++i) all.back().points.emplace_back(3.25, 3.25, 0.0);
  all.push_back({"crowd and outliers", {}});
  for (int i = 0; i < 1200; ++i)
    all.back().points.emplace_back(1e-3 * random.normal(), 1e-3 * random.normal(), 1e-3 * random.normal());
  for (int i = 0; i < 5; ++i)
    all.back().points.emplace_back(1e4 * random.normal(), 1e4 * random.normal(), 0.0);
  all.push_back({"wide band of densities", {}});
  for (int i = 0; i < 1500; ++i) {
    const double r = std::pow(10.0, random.uniform(-3, 3)), a = random.uniform(0, 6.28);
    all.back().points.emplace_back(r * std::cos(a), r * std::sin(a), 0.0);
  }
  // Every distance ties with others, and the order of the points is none.
  all.push_back({"shuffled flat lattice with doubles", sheet(30, 20, 0.25, 0.0, 6)});
  std::vector<Vec3>& doubled = all.back().points;
  for (std::size_t i = 0; i < 600; i += 3) doubled.push_back(doubled[i]);
  for (std::size_t i = doubled.size() - 1; i > 0; --i)
    std::swap(doubled[i], doubled[static_cast<std::size_t>(random.uniform() * static_cast<double>(i))]);
  all.push_back({"solid lattice", {}});
  for (int i = 0; i < 1000; ++i) all.back().points.emplace_back(i % 10, i / 10 % 10, i / 100);
  // Squares of these vanish, and overflow, in single precision.
  all.push_back({"sheet below the floats' squares", sheet(20, 20, 1e-24, 0.6, 7)});
  all.push_back({"sheet of the smallest floats", sheet(20, 20, 1e-43, 0.6, 8)});
  all.push_back({"sheet beyond the floats' squares", sheet(20, 20, 1e20, 0.6, 9)});
  all.push_back({"sheet of the largest floats", sheet(20, 20, 1.5e37, 0.6, 10)});
  return all;
}

inline NeighbourTable brute(const cloud::Cloud& cloud) {
  NeighbourTable table;
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    std::vector<std::pair<double, std::uint32_t>> others;
    for (std::uint32_t j = 0; j < cloud.size(); ++j)
      if (j != i) {
        const Vec3 d = cloud.local_mm(j) - cloud.local_mm(i);
        others.emplace_back(d.x() * d.x() + d.y() * d.y() + d.z() * d.z(), j);
      }
    std::sort(others.begin(), others.end());
    Neighbours n;
    n.fill(i);
    for (std::size_t k = 0; k < std::min(others.size(), kNeighbours); ++k) n[k] = others[k].second;
    table.of.push_back(n);
  }
  return table;
}

/// Names of the typed tests: the types stand in this order.
struct PartitionNames {
  template <class>
  static std::string GetName(int i) {
    return std::array{"Grid", "Octree", "Quadtree"}.at(static_cast<std::size_t>(i));
  }
};

struct PartitionCase {
  std::string name;
  double step_mm;  ///< about a spacing
  std::vector<Vec3> points;
};

inline std::vector<Vec3> sheet(int columns, int rows, double step, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c)
      points.emplace_back(step * (c + random.uniform(-0.4, 0.4)), step * (r + random.uniform(-0.4, 0.4)),
                          step * 3.0 * std::sin(0.3 * c + 0.2 * r));
  return points;
}

inline std::vector<PartitionCase> partition_cases() {
  std::vector<PartitionCase> all;
  Random random(21);
  all.push_back({"one", 1.0, {Vec3(1, 2, 3)}});
  all.push_back({"two", 1.0, {Vec3(1, 2, 3), Vec3(1, 2, 4)}});
  all.push_back({"collinear", 1.0, {}});
  for (int i = 0; i < 200; ++i) all.back().points.emplace_back(0, 0, i);
  all.push_back({"lattice", 1.0, {}});
  for (int i = 0; i < 1600; ++i) all.back().points.emplace_back(i % 40, i / 40, 0);
  all.push_back({"sheet", 0.1, sheet(40, 40, 0.1, 2)});
  all.push_back({"far sheet", 1e-3, sheet(30, 30, 1e-3, 3)});
  for (Vec3& p : all.back().points) p += Vec3(1e6, -2e6, 3e6);
  all.push_back({"tiny sheet", 1e-4, sheet(30, 30, 1e-4, 4)});
  all.push_back({"huge sheet", 1e5, sheet(30, 30, 1e5, 5)});
  all.push_back({"volume", 0.1, {}});
  for (int i = 0; i < 1500; ++i)
    all.back().points.emplace_back(random.uniform(), random.uniform(), random.uniform());
  all.push_back({"all at one place", 1.0, std::vector<Vec3>(300, Vec3(5, 5, 5))});
  all.push_back({"pile beside a sheet", 1.0, sheet(20, 20, 1.0, 6)});
  for (int i = 0; i < 400; ++i) all.back().points.emplace_back(3.25, 3.25, 0.0);
  all.push_back({"crowds far apart", 1e-3, {}});
  for (int i = 0; i < 600; ++i)
    all.back().points.emplace_back((i % 3 - 1) * 1e3 + 1e-3 * random.normal(), 1e-3 * random.normal(),
                                   1e-3 * random.normal());
  return all;
}

/// A segment near the cloud, from point-like to longer than the cloud; some along an axis, some outside.
struct Query {
  Vec3 a_mm, b_mm, reach_mm;
};
inline Query query_near(const cloud::Cloud& cloud, double step_mm, Random& random) {
  const auto some = [&] { return cloud.local_mm(random.below(cloud.size())); };
  const auto noise = [&](double size) {
    return Vec3(size * random.normal(), size * random.normal(), size * random.normal());
  };
  Query q;
  q.a_mm = some() + noise(step_mm);
  switch (random.below(5)) {
    case 0:
      q.b_mm = q.a_mm;
      break;
    case 1:
      q.b_mm = q.a_mm + noise(3.0 * step_mm);
      break;
    case 2:
      q.b_mm = some() + noise(step_mm);
      break;
    case 3:
      q.b_mm = q.a_mm + Vec3(random.uniform(-20.0, 20.0) * step_mm, 0.0, 0.0);
      break;
    default:
      q.b_mm = q.a_mm + noise(1e4 * step_mm);
  }
  q.reach_mm = step_mm * Vec3(random.uniform(), random.uniform(), random.uniform());
  return q;
}

}  // namespace palpate::search
