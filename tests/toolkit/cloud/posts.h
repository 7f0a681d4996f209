// Clouds for tests: posts on a regular grid, and models of a specification.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <palpate/generate.h>
#include <palpate/vec.h>
#include "toolkit/core/random.h"

namespace palpate::cloud {

inline GeneratedModel made(const std::string& text) {
  auto model = generate(parse_named_options(text).value());
  EXPECT_TRUE(model) << text << ": " << (model ? "" : model.error().message());
  return std::move(*model);
}

inline Cloud cloud_of(const std::vector<Vec3>& points) {
  return build_cloud(points, NonFinite::kRefuse).value();
}

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
using Gone = std::function<bool(std::size_t column, std::size_t row)>;
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

inline double flat(std::size_t, std::size_t) {
  return 0.0;
}

/// A share of the posts, the same for the same seed.
inline Gone at_random(double share, std::uint64_t seed) {
  return [=](std::size_t c, std::size_t r) { return Random(1000 * c + r + seed).uniform() < share; };
}

/// The heights without those that are gone.
inline Heights without(const Gone& gone, const Heights& height = flat) {
  return [=](std::size_t c, std::size_t r) { return gone(c, r) ? kNone : height(c, r); };
}

inline Gone box(std::size_t c0, std::size_t r0, std::size_t wide, std::size_t high) {
  return [=](std::size_t c, std::size_t r) { return c >= c0 && c < c0 + wide && r >= r0 && r < r0 + high; };
}

}  // namespace palpate::cloud
