// Clouds that break grids and trees, for the tests of this folder.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/random.h"

namespace palpate::partition {

struct Case {
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

inline std::vector<Case> cases() {
  std::vector<Case> all;
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

inline cloud::Cloud cloud_of(const std::vector<Vec3>& points) {
  return cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
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

}  // namespace palpate::partition
