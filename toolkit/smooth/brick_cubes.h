// Which cubes have bricks, by the points in and near them.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/point_patches.h"

namespace palpate::render {

[[nodiscard]] inline std::uint64_t code_at(const BrickGrid::Coordinate& c) {
  return partition::morton_code(static_cast<std::uint32_t>(c[0]), static_cast<std::uint32_t>(c[1]),
                                static_cast<std::uint32_t>(c[2]));
}
/// Rising, each once.
void sort_unique(std::vector<std::uint64_t>& codes, int threads);

/// Halvings from the spacing that half of the surface's area is sampled at, or more coarsely, to that of most
/// points: 0 where these are one. O(n log n).
[[nodiscard]] int coarser_levels(const SmoothPoints& points, std::span<const PointPatches> of_points);

/// Adds the codes of the cubes of a level that points lie in or near, those that are wanted. O(points).
void add_cubes_near_points(const SmoothPoints& points, std::span<const PointPatches> of_points,
                           const BrickGrid& grid, int level, int threads,
                           const std::function<bool(std::uint64_t)>& wanted,
                           std::vector<std::uint64_t>& codes);

}  // namespace palpate::render
