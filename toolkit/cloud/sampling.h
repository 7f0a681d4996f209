// The other ways of sampling a surface: at random, at random with a least distance, in scan lines; and what
// scanners do to points: noise, outliers, an order of their own. Internal to cloud.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toolkit/cloud/shapes.h"
#include "toolkit/geometry/aabb.h"

namespace palpate::cloud {

enum class Sampling { kGrid, kRandom, kBlue, kLines, kScan };

/// What the options of sampling say.
struct SamplingOptions {
  Sampling way = Sampling::kGrid;
  double ratio = 8.0;     ///< of lines: their distance over that of the points along them
  double density = 1.0;   ///< points per area for x above the middle, over those below it
  double noise = 0.0;     ///< standard deviation along the normal, in spacings
  double outliers = 0.0;  ///< share of the points
  bool outliers_near = true;
  bool shuffle = false;
  /// Every point where the grid has it.
  [[nodiscard]] bool in_place() const { return way == Sampling::kGrid && noise == 0.0 && outliers == 0.0; }
};

struct Sampled {
  std::vector<Vec3> points_mm;
  double spacing_mm = 0.0;  ///< root of the area over the number of points
};

/// Samples the patches in another way than the grid: as many points as `common` asks for, the nearest that
/// lines can give. The same with any number of threads. O(n), for blue noise some ten candidates a point.
[[nodiscard]] Sampled sample_patches(const std::vector<Patch>& patches, const geometry::Aabb& box,
                                     const SamplingOptions& options, const Common& common);
/// How many points that would be, before any is made.
[[nodiscard]] double count_patches(const std::vector<Patch>& patches, const Common& common);

/// Noise and outliers, in place. `spacing_mm` is what both are counted in.
void disturb(const Shape& shape, double spacing_mm, const SamplingOptions& options, std::uint64_t seed,
             std::vector<Vec3>& points_mm);

/// order[i] is the place that goes to i; every order equally likely.
[[nodiscard]] std::vector<std::uint32_t> shuffled(std::size_t count, std::uint64_t seed);

}  // namespace palpate::cloud
