// Small height fields for tests: posts on a regular grid.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/core/vec.h"

namespace palpate::cloud {

using Heights = std::function<double(std::size_t column, std::size_t row)>;

/// Posts `step` apart from `corner` on; no point where the height is not a number.
inline std::vector<Vec3> posts(std::size_t columns, std::size_t rows, double step, const Heights& height,
                               const Vec3& corner = Vec3::Zero()) {
  std::vector<Vec3> points;
  for (std::size_t row = 0; row < rows; ++row)
    for (std::size_t column = 0; column < columns; ++column) {
      const double z = height(column, row);
      if (std::isnan(z)) continue;
      points.emplace_back(corner +
                          Vec3(step * static_cast<double>(column), step * static_cast<double>(row), z));
    }
  return points;
}

/// Rough ground on unit posts, the same for the same place; slopes up to `rise`.
inline Heights rough(double rise, std::uint64_t seed) {
  return [=](std::size_t column, std::size_t row) {
    Random random(seed + 7919 * column + 104729 * row);
    return std::floor(rise * random.uniform(0.0, 1.0) * 1024.0) / 1024.0;  // exact in single precision
  };
}

}  // namespace palpate::cloud
